"""How full blocks of voxels are, and what is left of that when it is blurred."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from clvox.device import Session
from clvox.ops.sky import MARGIN, ONE, Part, blur_weights, measure_sky
from clvox.reference.raymarch import block_shares, blurred
from tests.kernels.test_raymarch import models, shape_of, solid


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


@pytest.mark.parametrize("deviation", [1e-9, 0.1, 0.7, 2.0, 4.0, 100.0])
def test_blurs_neither_add_nor_take(deviation: float) -> None:
    weights = blur_weights(deviation)
    assert weights[0] + 2 * weights[1:].sum() == ONE
    assert (np.diff(weights) <= 0).all()
