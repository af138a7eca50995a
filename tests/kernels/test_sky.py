"""How full blocks of voxels are, and what is left of that when it is blurred."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from clvox.device import Session
from clvox.ops.layout import Cells, VoxelArrays
from clvox.ops.sky import MARGIN, ONE, Part, blur_weights, measure_sky
from clvox.reference.multilevel import pack_bits, rank
from clvox.reference.raymarch import block_shares, blurred
from tests.kernels.cases import INTERPRETED
from tests.kernels.test_raymarch import dense, models, shape_of, solid


@given(seed=st.integers(0, 2**32 - 1))
def test_sky(session: Session, seed: int) -> None:
    """Of any model, with any spacing, and of a part of it."""
    rng = np.random.default_rng(seed)
    voxels = solid(rng)
    shape = shape_of(voxels)
    spacing = tuple(rng.choice([0.3, 1.0, 2.0], 3).tolist())
    low = rng.integers(0, np.array(shape) + 1)
    high = rng.integers(low, np.array(shape) + 1)
    normal = rng.normal(size=3).astype(np.float32)
    plane = (*normal.tolist(), float(np.float32(normal @ (np.array(shape) * 0.5))))
    parts = [None, Part(tuple(low.tolist()), tuple(high.tolist())), Part((0, 0, 0), shape, plane)]
    part = parts[rng.integers(3)]
    for arrays in models(session, voxels, rng):
        sky = measure_sky(session, arrays, spacing, part)
        drawn = voxels.copy()
        if part is not None:
            keep = np.zeros(voxels.shape, bool)
            box = tuple(slice(a, b) for a, b in zip(part.low[::-1], part.high[::-1], strict=True))
            keep[box] = True
            drawn &= keep
        shares = block_shares(drawn, sky.side, MARGIN, part.plane if part else (0, 0, 0, 0))
        widths = np.array(spacing) * sky.side
        expected = blurred(shares, [blur_weights(sky.reach / width) for width in widths])
        np.testing.assert_array_equal(sky.values.get().reshape(expected.shape), expected)


@pytest.mark.skipif(INTERPRETED, reason="values, not accesses, are what may go wrong")
@pytest.mark.parametrize("width", [2.0**-7, 2.0**-14, 2.0**-40])
def test_blocks_of_voxels_far_from_cubic(session: Session, width: float) -> None:
    """They are as wide as they are high, so that 2**32 voxels, or more, fit into one."""
    voxels = np.ones((5120, 3, 2), bool)
    sky = measure_sky(session, dense(session, voxels), (width, width, 1.0))
    assert np.prod(sky.side) >= 2**32
    assert max(sky.side) <= 2**20
    # Their share of a block is too small to tell.
    assert not sky.values.get().any()


@pytest.mark.skipif(INTERPRETED, reason="values, not accesses, are what may go wrong")
def test_blocks_with_very_many_voxels_inside(session: Session) -> None:
    """More than 2**32 in each, of cells that are wholly inside; the last block is cut off."""
    brick, cells = (1 << 13, 1 << 13, 8), (8, 8, 16383)
    none = session.zeros((1,), np.uint32)
    words = pack_bits(np.ones(cells[::-1], bool))
    empty = np.zeros_like(words)
    held = Cells(cells, brick, session.upload(empty), session.upload(rank(empty)), 0)
    shape = 1 << 16, 1 << 16, 131064
    arrays = VoxelArrays(shape, none, held, session.upload(words))
    sky = measure_sky(session, arrays, (0.025, 0.025, 1.0))
    assert sky.side == (1 << 16, 1 << 16, 1640)
    along = np.full(80, 255, np.uint8)
    along[-1] = (1504 * 255 + 820) // 1640
    shares = np.pad(along.reshape(-1, 1, 1), MARGIN)
    widths = np.array((0.025, 0.025, 1.0)) * sky.side
    expected = blurred(shares, [blur_weights(sky.reach / width) for width in widths])
    np.testing.assert_array_equal(sky.values.get().reshape(expected.shape), expected)


@pytest.mark.parametrize("deviation", [1e-9, 0.1, 0.7, 2.0, 4.0, 100.0])
def test_blurs_neither_add_nor_take(deviation: float) -> None:
    weights = blur_weights(deviation)
    assert weights[0] + 2 * weights[1:].sum() == ONE
    assert (np.diff(weights) <= 0).all()
