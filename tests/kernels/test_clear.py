"""Every word of a cleared buffer is zero, and no other is touched."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

if TYPE_CHECKING:
    from clvox.device import Session

GROUP = 64
SIZES = [1, 2, GROUP - 1, GROUP, GROUP + 1, 1000]


@pytest.mark.parametrize("size", [0, *SIZES])
def test_zeros_are_zero(session: Session, size: int) -> None:
    dirty = session.upload(np.full(size, 7, np.uint32))
    del dirty  # its memory, in a pool, is what the next array gets
    found = session.zeros(size, np.uint32).get()
    np.testing.assert_array_equal(found, np.zeros(size, np.uint32), strict=True)


@pytest.mark.parametrize("size", SIZES)
def test_words_behind_the_last_are_left_alone(session: Session, size: int) -> None:
    """Work-items come in whole groups; those too many do nothing."""
    words = session.upload(np.full(size + 2 * GROUP, 7, np.uint32))
    session.run(session.kernel("buffers/clear.cl", "clear"), size, np.uint64(size), words)
    found = words.get()
    assert not found[:size].any()
    assert (found[size:] == 7).all()


def test_other_types_and_shapes(session: Session) -> None:
    found = session.zeros((3, 5), np.uint64).get()
    np.testing.assert_array_equal(found, np.zeros((3, 5), np.uint64), strict=True)


def test_half_a_word_is_refused(session: Session) -> None:
    with pytest.raises(TypeError, match="5 bytes"):
        session.zeros(5, np.uint8)
