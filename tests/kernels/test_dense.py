"""A dense grid is filled by a running xor along y, and rays that end inside are counted."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from numpy.typing import NDArray

from clvox.ops.dense import SPAN, fill

if TYPE_CHECKING:
    from clvox.device import Session


def words(seed: int, *shape: int) -> NDArray[np.uint32]:
    return np.random.default_rng(seed).integers(0, 2**32, shape).astype(np.uint32)


@pytest.mark.parametrize("planes", [1, 5, 70])
@pytest.mark.parametrize("rows", [1, 2, 9])
@pytest.mark.parametrize("width", [1, SPAN - 1, SPAN, SPAN + 1, 2 * SPAN, 2 * SPAN + 3])
def test_fill_is_a_running_xor(session: Session, width: int, rows: int, planes: int) -> None:
    """One work-item does SPAN words, or fewer at the end of a row, in another way."""
    flips, beyond = words(51, planes, rows, width), words(52, planes, width)
    voxels = session.upload(flips)
    odd = fill(session, voxels, session.upload(beyond))
    expected = np.bitwise_xor.accumulate(flips, axis=1)
    np.testing.assert_array_equal(voxels.get(), expected, strict=True)
    ends = expected[:, -1] ^ beyond
    assert odd == int(np.unpackbits(ends.view(np.uint8)).sum())


def test_rays_that_end_outside_are_not_odd(session: Session) -> None:
    flips = words(53, 4, 6, SPAN + 2)
    beyond = np.bitwise_xor.reduce(flips, axis=1)
    assert fill(session, session.upload(flips), session.upload(beyond)) == 0
    beyond[3, SPAN + 1] ^= np.uint32(1 << 31)
    assert fill(session, session.upload(flips), session.upload(beyond)) == 1
