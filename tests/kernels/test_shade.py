"""The colours of what rays meet: what must hold of them on every device."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from clvox.camera import Camera
from clvox.device import Session
from clvox.grid import Grid
from clvox.ops.attributes import number_touched
from clvox.ops.raymarch import Paint, Scene, march, shade, shade_volume
from clvox.reference.attributes import pack_normal
from tests.kernels.models import MODELS, sample

SIZE = 5, 4
SAMPLES = 2
OFFSETS = np.array([(1, 0, 0), (0, -2, 1), (0.5, 1, 3)], np.float32)
NOTHING = 0.0, 0.0, 0.0, 0.0
PAINT = Paint(((0.3, 0.5, 0.7),) * 4, 0.3, 0.8, 0.2, 20.0, 0.0, NOTHING, OFFSETS)
SPACING = 1.0, 2.0, 0.5


def scene_of(session: Session, number: int, stored: bool) -> Scene:
    """A model of random bits, with a random normal for each voxel that is touched."""
    shape, brick = MODELS[number]
    model = sample(session, number, shape, brick)
    if not stored:
        return Scene(model.arrays, SPACING)
    touched = number_touched(session, model.arrays, model.marks)
    vectors = np.random.default_rng(number).integers(-9, 10, (touched.count, 3)).tolist()
    packed = np.array([pack_normal(*vector) for vector in vectors], np.uint32)
    return Scene(model.arrays, SPACING, touched, session.upload(packed))


@pytest.mark.parametrize("number", range(len(MODELS)))
@pytest.mark.parametrize("stored", [False, True])
@pytest.mark.parametrize("lines", [False, True])
def test_opacity_is_the_share_of_rays_that_hit(
    session: Session, number: int, stored: bool, lines: bool
) -> None:
    """And there is colour where, and only where, something is hit."""
    scene = scene_of(session, number, stored)
    grid = Grid((0, 0, 0), SPACING, scene.arrays.shape)
    samples = SAMPLES * SIZE[0], SAMPLES * SIZE[1]
    view = Camera.around(grid, fov=50.0).view(grid, samples)
    hits = march(session, scene, view, view.rays, samples)
    paint = replace(PAINT, lines=lines)
    pixels = shade(session, scene, view, view.rays, hits, SAMPLES, paint).get()
    met = hits.voxels.get()[..., 0] >= 0
    share = met.reshape(SIZE[1], SAMPLES, SIZE[0], SAMPLES).mean(axis=(1, 3))
    np.testing.assert_array_equal(pixels[..., 3], np.rint(255 * share))
    assert (pixels[share == 0, :3] == 0).all()
    assert (pixels[share > 0, :3].max(axis=-1) > 0).all()
    paint = replace(paint, background=(1.0, 1.0, 1.0, 1.0))
    pixels = shade(session, scene, view, view.rays, hits, SAMPLES, paint).get()
    assert (pixels[..., 3] == 255).all()
    assert (pixels[share == 0] == 255).all()


def test_emission_alone_is_the_colour_itself(session: Session) -> None:
    scene = scene_of(session, 2, stored=False)
    grid = Grid((0, 0, 0), SPACING, scene.arrays.shape)
    view = Camera.around(grid).view(grid, SIZE)
    hits = march(session, scene, view, view.rays, SIZE)
    paint = Paint(((0.0, 0.25, 1.0),) * 4, 0.0, 0.0, 0.0, 1.0, 1.0, NOTHING, OFFSETS[:0])
    pixels = shade(session, scene, view, view.rays, hits, 1, paint).get()
    met = pixels[..., 3] == 255
    assert met.any()
    # The rim is a little brighter, whatever the material.
    np.testing.assert_allclose(pixels[met][:, 1], 137, atol=14)
    assert (pixels[met][:, 2] == 255).all()


@pytest.mark.parametrize("counted", [False, True])
def test_volumes_hold_back_light(session: Session, counted: bool) -> None:
    """By Beer and Lambert's law, or in proportion; without light there is the thick colour."""
    lengths = np.array([[0.0, 0.5, 1.0, 9.0]], np.float32)
    colours = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
    pixels = shade_volume(
        session, session.upload(lengths), 1, colours, 0.5, counted=counted, background=NOTHING
    ).get()[0]
    depth = 0.5 * lengths[0]
    opacity = np.minimum(depth, 1.0) if counted else 1 - np.exp(-depth)
    np.testing.assert_allclose(pixels[:, 3], 255 * opacity, atol=1)
    assert pixels[0].tolist() == [0, 0, 0, 0]
    assert pixels[3, 2] > pixels[1, 2]
    assert pixels[3, 0] < pixels[1, 0]
    on_white = shade_volume(
        session,
        session.upload(lengths),
        1,
        colours,
        0.5,
        counted=counted,
        background=(1.0, 1.0, 1.0, 1.0),
    ).get()[0]
    assert on_white[0].tolist() == [255, 255, 255, 255]


def test_volume_pixels_are_means_of_their_samples(session: Session) -> None:
    lengths = np.zeros((4, 6), np.float32)
    lengths[0, 1] = lengths[3, 4] = lengths[3, 5] = 1e9
    colours = (1.0, 1.0, 1.0), (1.0, 1.0, 1.0)
    pixels = shade_volume(
        session, session.upload(lengths), 2, colours, 1.0, counted=False, background=NOTHING
    ).get()
    np.testing.assert_array_equal(pixels[..., 3], [[64, 0, 0], [0, 0, 128]])
