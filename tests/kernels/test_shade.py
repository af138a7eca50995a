"""The colours of what rays meet: what must hold of them on every device."""

from __future__ import annotations

import numpy as np
import pytest

from clvox.camera import View
from clvox.device import Session
from clvox.ops.raymarch import SIDE, Paint, shade_surface
from clvox.reference.raymarch import first_voxels
from tests.kernels.models import MODELS, sample

SIZE = 5, 4
OFFSETS = np.array([(1, 0, 0), (0, -2, 1), (0.5, 1, 3)], np.float32)
PAINT = Paint((0.3, 0.5, 0.7), (0.0, 0.0, 0.0, 0.0), OFFSETS)


@pytest.mark.parametrize("number", range(len(MODELS)))
def test_opacity_is_the_share_of_rays_that_hit(session: Session, number: int) -> None:
    """And there is colour where, and only where, something is hit."""
    shape, brick = MODELS[number]
    model = sample(session, number, shape, brick)
    samples = SIDE * SIZE[0], SIDE * SIZE[1]
    spacing = (1.0, 2.0, 0.5)
    view = View.fit(
        [(0, 0, 0), shape], shape, spacing, samples, direction=(-1, 2, -1), up=(0, 0, 1)
    )
    hits = first_voxels(model.voxels, view.rays, samples)
    pixels = shade_surface(
        session, model.arrays, view, spacing, session.upload(hits), view.rays, PAINT
    ).get()
    share = (hits[..., 0] >= 0).reshape(SIZE[1], SIDE, SIZE[0], SIDE).mean(axis=(1, 3))
    np.testing.assert_array_equal(pixels[..., 3], np.rint(255 * share))
    assert (pixels[share == 0, :3] == 0).all()
    assert (pixels[share > 0, :3].max(axis=-1) > 0).all()
