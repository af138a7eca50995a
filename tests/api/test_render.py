"""Pictures: what can be said of them without looking."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

import clvox
from clvox.camera import View
from clvox.ops.raymarch import SIDE, Paint, march_surface, shade_surface

SIZE = 96, 72
PAINT = Paint((0.3, 0.5, 0.7), (0.0, 0.0, 0.0, 0.0), np.ones((4, 3), np.float32))


@pytest.fixture(scope="module")
def ball() -> clvox.VoxelModel:
    return clvox.voxelize(trimesh.creation.icosphere(radius=1.0), resolution=64)


def box_model(**options: Any) -> clvox.VoxelModel:
    """A box of 20 x 10 x 6 in a larger grid."""
    voxels = np.zeros((40, 48, 56), bool)
    voxels[16:22, 8:18, 24:44] = True
    return clvox.VoxelModel.from_array(voxels, clvox.Grid((5, 5, 5), 0.5, (56, 48, 40)), **options)


def opaque(image: NDArray[np.uint8]) -> NDArray[np.bool_]:
    covered: NDArray[np.bool_] = image[..., 3] > 127
    return covered


def test_picture_is_an_array_of_rows_of_pixels(ball: clvox.VoxelModel) -> None:
    image = clvox.render(ball, size=SIZE)
    assert image.shape == (72, 96, 4)
    assert image.dtype == np.uint8


def test_ball_is_round_centred_and_fills_the_picture(ball: clvox.VoxelModel) -> None:
    """From wherever it is seen."""
    for direction in ((-0.6, 1, -0.7), (1, 0, 0), (0, -1, 0), (0.3, 0.2, 0.9)):
        covered = opaque(clvox.render(ball, size=(80, 80), direction=direction, up=(0.1, 0.2, 1)))
        rows, columns = np.nonzero(covered)
        assert abs(rows.mean() - 39.5) < 0.6
        assert abs(columns.mean() - 39.5) < 0.6
        height, width = np.ptp(rows) + 1, np.ptp(columns) + 1
        assert abs(height - width) <= 1
        assert 40 < height < 80
        assert abs(covered.sum() / (np.pi / 4 * height * width) - 1) < 0.05


def test_ball_is_lit_from_the_upper_left(ball: clvox.VoxelModel) -> None:
    """Its sides differ, and it is neither black nor white anywhere in the middle."""
    image = clvox.render(ball, size=(80, 80)).astype(float)[..., :3].mean(axis=-1)
    assert image[28, 30] > image[52, 50] + 20
    middle = image[25:55, 25:55]
    assert middle.min() > 40
    assert middle.max() < 250


def test_ball_has_no_speckle(ball: clvox.VoxelModel) -> None:
    """Neighbouring pixels of a smooth surface are of nearly one colour."""
    middle = clvox.render(ball, size=(160, 160)).astype(float)[50:110, 50:110, :3]
    assert np.abs(np.diff(middle, axis=0)).max() < 30
    assert np.abs(np.diff(middle, axis=1)).max() < 30
    assert np.abs(np.diff(middle, axis=1)).mean() < 3


def test_view_is_of_the_solid_and_not_of_its_grid() -> None:
    image = clvox.render(box_model(), size=SIZE, direction=(0, 0, -1), up=(0, 1, 0))
    rows, columns = np.nonzero(opaque(image))
    assert np.ptp(columns) + 1 > 0.6 * SIZE[0]
    assert np.ptp(rows) + 1 == pytest.approx((np.ptp(columns) + 1) / 2, abs=2)


def test_levels_do_not_show() -> None:
    """A picture depends on the voxels alone; only rounding may differ."""
    voxels = np.ones((16, 16, 16), bool)
    voxels[9:, 3:7, 5:] = False
    grid = clvox.Grid((0, 0, 0), (1.0, 2.0, 0.5), (16, 16, 16))
    pictures = [
        clvox.render(clvox.VoxelModel.from_array(voxels, grid, levels=levels), size=SIZE)
        for levels in ([(16, 16, 16)], [(2, 2, 2), (8, 8, 8)], [(4, 6, 16), (4, 3, 1)])
    ]
    for picture in pictures[1:]:
        np.testing.assert_allclose(picture.astype(int), pictures[0].astype(int), atol=3)


def test_unequal_spacing_keeps_proportions() -> None:
    """Twice as many voxels of half the width are the same solid."""
    grids = clvox.Grid((0, 0, 0), 1.0, (8, 8, 8)), clvox.Grid((0, 0, 0), (1, 1, 0.5), (8, 8, 16))
    seen = [
        opaque(
            clvox.render(clvox.VoxelModel.from_array(np.ones(grid.array_shape), grid), size=SIZE)
        )
        for grid in grids
    ]
    assert (seen[0] != seen[1]).mean() < 0.01


def test_long_pictures_are_drawn_in_bands_that_do_not_show(
    ball: clvox.VoxelModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = clvox.render(ball, size=SIZE)
    monkeypatch.setattr(import_module("clvox.render.image"), "SAMPLES_PER_LAUNCH", 1000)
    np.testing.assert_array_equal(clvox.render(ball, size=SIZE), whole)


def test_empty_model_is_an_empty_picture() -> None:
    for levels in ([(8, 8, 8)], [(1, 1, 1), (8, 8, 8)]):
        grid = clvox.Grid((0, 0, 0), 1.0, (8, 8, 8))
        model = clvox.VoxelModel.from_array(np.zeros((8, 8, 8), bool), grid, levels=levels)
        assert not clvox.render(model, size=SIZE).any()
        paper = clvox.render(model, size=SIZE, background=(250, 128, 7))
        assert (paper == (250, 128, 7, 255)).all()


def test_one_voxel_is_drawn() -> None:
    """Where a normal can hardly be told."""
    model = clvox.VoxelModel.from_array([[[True]]], clvox.Grid((0, 0, 0), 1.0, (1, 1, 1)))
    image = clvox.render(model, size=SIZE)
    assert opaque(image).mean() > 0.2
    assert image[opaque(image)][:, :3].min() > 20


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"size": (0, 10)}, "size must be from 1 to 16384 pixels a side, got (0, 10)"),
        ({"size": (10, 20000)}, "size must be from 1 to 16384"),
        ({"size": 10}, "size must be two integers, columns and rows, got 10"),
        ({"size": (1.5, 2.0)}, "size must be two integers"),
        ({"direction": (0, 0, 0)}, "direction must be three finite numbers, not all 0"),
        ({"direction": (1, 0, np.nan)}, "direction must be three finite numbers"),
        ({"direction": (0, 0, -1)}, "up must not be parallel to the direction (0, 0, -1)"),
        ({"up": "z"}, "up must be three finite numbers, not all 0, got 'z'"),
        ({"background": (0, 0, 256)}, "background must be from 0 to 255"),
        ({"background": (0, 0)}, "background must be three integers, got (0, 0)"),
    ],
)
def test_what_makes_no_sense_is_refused(
    ball: clvox.VoxelModel, options: dict[str, Any], message: str
) -> None:
    with pytest.raises(clvox.GridError) as refused:
        clvox.render(ball, **options)
    assert message in str(refused.value)


def test_voxels_too_unequal_to_draw_are_refused() -> None:
    grid = clvox.Grid((0, 0, 0), (1e-12, 1.0, 1.0), (8, 8, 8))
    model = clvox.VoxelModel.from_array(np.ones((8, 8, 8), bool), grid)
    with pytest.raises(clvox.GridError, match="too unequal to draw"):
        clvox.render(model, size=SIZE)


def test_opacity_is_the_share_of_rays_that_hit() -> None:
    """And without a hit there is no colour at all."""
    rng = np.random.default_rng(4)
    voxels = rng.random((6, 7, 8)) < 0.3
    grid = clvox.Grid((0, 0, 0), 1.0, (8, 7, 6))
    model = clvox.VoxelModel.from_array(voxels, grid, levels=[(2, 2, 2), (4, 4, 4)])
    session, arrays = model._session, model._arrays
    size = SIDE * SIZE[0], SIDE * SIZE[1]
    view = View.fit(
        [(0, 0, 0), (8, 7, 6)], (8, 7, 6), (1, 1, 1), size, direction=(-1, 2, -1), up=(0, 0, 1)
    )
    hits = march_surface(session, arrays, view.rays, size)
    pixels = shade_surface(session, arrays, view, (1.0, 1.0, 1.0), hits, view.rays, PAINT).get()
    covered = hits.get()[..., 0] >= 0
    share = covered.reshape(SIZE[1], SIDE, SIZE[0], SIDE).mean(axis=(1, 3))
    np.testing.assert_array_equal(pixels[..., 3], np.rint(255 * share))
    assert 0 < share.mean() < 1
    assert (pixels[share == 0, :3] == 0).all()
    assert (pixels[share > 0, :3] > 0).any(axis=-1).all()
    paper = replace(PAINT, background=(1.0, 1.0, 1.0, 1.0))
    pixels = shade_surface(session, arrays, view, (1.0, 1.0, 1.0), hits, view.rays, paper).get()
    assert (pixels[..., 3] == 255).all()
    assert (pixels[share == 0] == 255).all()
