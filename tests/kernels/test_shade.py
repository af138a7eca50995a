"""The colours of what rays meet: what must hold of them on every device."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from clvox.camera import Camera
from clvox.device import Session
from clvox.grid import Grid
from clvox.ops.attributes import number_touched
from clvox.ops.raymarch import Pixels, Scene, march
from clvox.ops.shading import Fog, Paint, shade, shade_volume
from clvox.ops.sky import measure_sky
from clvox.reference.attributes import pack_normal
from tests.kernels.models import MODELS, sample

SIZE = 5, 4
SAMPLES = 2
NOTHING = 0.0, 0.0, 0.0, 0.0
PAINT = Paint(((0.3, 0.5, 0.7),) * 4, 0.3, 0.8, 0.2, 20.0, 0.0, NOTHING)
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
    places = SAMPLES**2 * SIZE[0], SAMPLES**2 * SIZE[1]
    view = Camera.around(grid, fov=50.0).view(grid, places)
    chosen = Pixels.whole(SIZE, SAMPLES)
    hits = march(session, scene, view, chosen)
    sky = measure_sky(session, scene.arrays, SPACING)

    def colours(paint: Paint) -> NDArray[np.uint8]:
        canvas = session.empty((SIZE[1], SIZE[0], 4), np.uint8)
        shade(session, scene, view, chosen, hits, paint, sky, canvas)
        found: NDArray[np.uint8] = canvas.get()
        return found

    paint = replace(PAINT, lines=lines)
    pixels = colours(paint)
    met = hits.voxels.get()[..., 0] >= 0
    share = met.reshape(SIZE[1], SIZE[0], SAMPLES**2).mean(axis=2)
    np.testing.assert_array_equal(pixels[..., 3], np.rint(255 * share))
    assert (pixels[share == 0, :3] == 0).all()
    assert (pixels[share > 0, :3].max(axis=-1) > 0).all()
    paint = replace(paint, background=(1.0, 1.0, 1.0, 1.0))
    pixels = colours(paint)
    assert (pixels[..., 3] == 255).all()
    assert (pixels[share == 0] == 255).all()


def test_emission_alone_is_the_colour_itself(session: Session) -> None:
    scene = scene_of(session, 2, stored=False)
    grid = Grid((0, 0, 0), SPACING, scene.arrays.shape)
    view = Camera.around(grid).view(grid, SIZE)
    chosen = Pixels.whole(SIZE)
    hits = march(session, scene, view, chosen)
    paint = Paint(((0.0, 0.25, 1.0),) * 4, 0.0, 0.0, 0.0, 1.0, 1.0, NOTHING)
    canvas = session.empty((SIZE[1], SIZE[0], 4), np.uint8)
    shade(session, scene, view, chosen, hits, paint, None, canvas)
    pixels = canvas.get()
    met = pixels[..., 3] == 255
    assert met.any()
    # The rim is a little brighter, whatever the material.
    np.testing.assert_allclose(pixels[met][:, 1], 137, atol=14)
    assert (pixels[met][:, 2] == 255).all()


@pytest.mark.parametrize("counted", [False, True])
def test_volumes_hold_back_light(session: Session, counted: bool) -> None:
    """By Beer and Lambert's law, or in proportion; without light there is the thick colour."""
    lengths = np.array([0.0, 0.5, 1.0, 9.0], np.float32)
    fog = Fog((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0.5, counted, NOTHING)
    pixels = fogged(session, lengths, fog, (4, 1), 1)[0]
    depth = 0.5 * lengths
    opacity = np.minimum(depth, 1.0) if counted else 1 - np.exp(-depth)
    np.testing.assert_allclose(pixels[:, 3], 255 * opacity, atol=1)
    assert pixels[0].tolist() == [0, 0, 0, 0]
    assert pixels[3, 2] > pixels[1, 2]
    assert pixels[3, 0] < pixels[1, 0]
    paper = replace(fog, background=(1.0, 1.0, 1.0, 1.0))
    assert fogged(session, lengths, paper, (4, 1), 1)[0, 0].tolist() == [255, 255, 255, 255]


def test_volume_pixels_are_means_of_their_samples(session: Session) -> None:
    """Of those of one pixel, which are kept together."""
    lengths = np.zeros((2, 3, 4), np.float32)
    lengths[0, 0, 1] = lengths[1, 2, 2] = lengths[1, 2, 3] = 1e9
    fog = Fog((1.0, 1.0, 1.0), (1.0, 1.0, 1.0), 1.0, False, NOTHING)
    pixels = fogged(session, lengths.reshape(-1), fog, (3, 2), 2)
    np.testing.assert_array_equal(pixels[..., 3], [[64, 0, 0], [0, 0, 128]])


def fogged(
    session: Session, lengths: NDArray[np.float32], fog: Fog, size: tuple[int, int], samples: int
) -> NDArray[np.uint8]:
    canvas = session.empty((size[1], size[0], 4), np.uint8)
    shade_volume(session, session.upload(lengths), Pixels.whole(size, samples), fog, canvas)
    pixels: NDArray[np.uint8] = canvas.get()
    return pixels
