"""Pictures: what can be said of them without looking."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from PIL import Image

import clvox
from clvox.ops.raymarch import Pixels, Scene, measure_lengths
from clvox.reference.raymarch import lengths

SIZE = 96, 72


@pytest.fixture(scope="module")
def ball() -> clvox.VoxelModel:
    return clvox.voxelize(trimesh.creation.icosphere(radius=1.0), resolution=64)


def box_model(**options: Any) -> clvox.VoxelModel:
    """A box of 20 x 10 x 6 in a larger grid."""
    voxels = np.zeros((40, 48, 56), bool)
    voxels[16:22, 8:18, 24:44] = True
    return clvox.VoxelModel.from_array(voxels, clvox.Grid((5, 5, 5), 0.5, (56, 48, 40)), **options)


def seen(model: clvox.VoxelModel, size: tuple[int, int], **options: Any) -> NDArray[np.uint8]:
    """A picture from a camera that these options describe."""
    camera = clvox.Camera.around(model, aspect=size[0] / size[1], **options)
    return clvox.render(model, camera=camera, size=size)


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
        covered = opaque(seen(ball, (80, 80), direction=direction, up=(0.1, 0.2, 1), parallel=True))
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
    image = seen(box_model(), SIZE, direction=(0, 0, -1), up=(0, 1, 0), parallel=True)
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
    monkeypatch.setattr(import_module("clvox.ops.drawing"), "RAYS_AT_ONCE", 1000)
    np.testing.assert_array_equal(clvox.render(ball, size=SIZE), whole)


@pytest.mark.parametrize("style", ["surface", "volume", "voxels"])
def test_rays_are_saved_where_they_make_no_difference(ball: clvox.VoxelModel, style: Any) -> None:
    """Edges are as smooth as with all rays everywhere, and nothing else changes visibly."""
    few, all_rays = (
        clvox.render(ball, size=(160, 120), style=style, samples=3, adaptive=adaptive).astype(int)
        for adaptive in (True, False)
    )
    differ = np.abs(few - all_rays).max(axis=-1)
    assert differ.max() <= 40
    assert (differ > 6).mean() < 0.02
    partly = (all_rays[..., 3] > 0) & (all_rays[..., 3] < 255) & (style != "volume")
    assert partly.any() == (style != "volume")
    np.testing.assert_array_equal(few[partly], all_rays[partly])


def wires() -> trimesh.Trimesh:
    """Wires and fins a third of a pixel wide, nearly along the rows or columns of a picture."""
    parts: list[trimesh.Trimesh] = []
    for k in range(6):
        ends = np.array([(-1, 0, 0.1 * k), (1, 0, 0.1 * k + 0.01 * k * k)])
        parts.append(trimesh.creation.cylinder(0.0016, segment=ends, sections=6))
        fin = trimesh.creation.box(extents=(0.003, 0.2, 0.4))
        parts.append(fin.apply_translation((0.3111 * k - 0.8, 0.1, -0.3)))
    together = trimesh.util.concatenate(parts)
    assert isinstance(together, trimesh.Trimesh)
    return together


def test_wires_narrower_than_a_pixel_are_whole() -> None:
    """No ray in the middle of a pixel may meet them, but each is seen from end to end."""
    model = clvox.voxelize(wires(), resolution=1024, attributes=("edge",))
    looking = clvox.Camera((0, -5, 0), (0, 0, 0), height=1.8)
    few, all_rays = (
        clvox.render(model, camera=looking, size=(320, 180), style="voxels", adaptive=adaptive)
        for adaptive in (True, False)
    )
    shown = all_rays[..., 3] > 0
    assert shown.sum() > 1000
    assert (few[..., 3] == all_rays[..., 3])[shown].mean() > 0.995
    # Each wire crosses each of these columns, and each fin each of these rows.
    for line in (*few[:95, 70:250, 3].T, *few[110:135, ..., 3]):
        assert np.count_nonzero(np.diff((line > 0).astype(int)) == 1) == 6


def test_steep_edges_have_as_many_shades_as_a_pixel_has_rays() -> None:
    """So that they do not look like stairs: nearly upright, level, or in between."""
    box = trimesh.creation.box(extents=(1, 1, 1))
    model = clvox.voxelize(box, resolution=512, attributes=("normals",))
    for degrees in (2, 40, 88):
        up = np.cos(np.radians(degrees)), 0, np.sin(np.radians(degrees))
        looking = clvox.Camera((0, -5, 0), (0, 0, 0), up, height=2)
        opacity = clvox.render(model, camera=looking, size=(120, 120))[..., 3]
        counts = [np.count_nonzero(opacity == shade) for shade in (64, 128, 191)]
        assert min(counts) > 0.1 * sum(counts) > 5


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
    for samples in (1, 2, 3, 8):
        assert clvox.render(model, size=(1, 1), samples=samples)[0, 0, 3] > 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"size": (0, 10)}, "size must be from 1 to 16384 pixels a side, got (0, 10)"),
        ({"size": (10, 20000)}, "size must be from 1 to 16384"),
        ({"size": 10}, "size must be two integers, columns and rows, got 10"),
        ({"size": (1.5, 2.0)}, "size must be two integers"),
        ({"style": "shiny"}, "style must be one of 'surface', 'voxels', 'volume', got 'shiny'"),
        ({"samples": 0}, "samples must be an integer from 1 to 8, got 0"),
        ({"absorption": "none"}, "absorption must be 'beer' or 'count', got 'none'"),
        ({"density": -1}, "density must be a number, 0 or more, got -1"),
        ({"background": (0, 0, 256)}, "background must be from 0 to 255"),
        ({"background": (0, 0)}, "background must be three integers, got (0, 0)"),
        ({"background": (0, (1, 2), 0)}, "background must be three integers, got (0, (1, 2), 0)"),
        ({"size": ((1, 2), 3)}, "size must be two integers, columns and rows, got ((1, 2), 3)"),
        ({"samples": True}, "samples must be an integer from 1 to 8, got True"),
        ({"camera": "front"}, "camera must be a clvox.Camera, got a str"),
        ({"material": (1, 2, 3)}, "material must be a clvox.Material, got a tuple"),
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


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: clvox.Camera((0, 0, 0), (0, 0, 0)), "eye and target must differ"),
        (lambda: clvox.Camera((0, 0, 5), (0, 0, 0)), "up must not be parallel to the view"),
        (lambda: camera(target="here"), "target must be three finite numbers, got 'here'"),
        (lambda: camera(fov=0), "fov must be a number above 0 and below 170, got 0"),
        (lambda: camera(height=-1), "height must be a number above 0, got -1"),
        (lambda: camera(fov=30, height=1), "give fov= (degrees) or height="),
        (lambda: camera(near=-1), "near must be a length, 0 or more, got -1"),
        (lambda: camera(near="1"), "near must be a length, 0 or more, got '1'"),
        (lambda: camera().turned(np.nan), "degrees must be a finite number, got nan"),
        (lambda: around(aspect=0), "aspect must be a number above 0, got 0"),
        (lambda: around(aspect=-1), "aspect must be a number above 0, got -1"),
        (lambda: around(fov=20, parallel=True), "rays are parallel, or there is a fov"),
        (lambda: clvox.Camera.around("part.stl"), "a camera goes around a VoxelModel, a mesh or"),
        (lambda: camera(box=((1, 1, 1), (0, 0, 0))), "box must be a lowest and a highest corner"),
        (lambda: camera(cut=((0, 0, 0), (0, 0, 0))), "cut must be a point and a normal"),
        (lambda: camera(cut=(1, 2, 3)), "cut must be a point and a normal"),
        (lambda: camera(cut=((0, 0, np.nan), (0, 0, 1))), "cut must be a point and a normal"),
        (lambda: around(direction=(0, 0, 0)), "direction must be three finite numbers, not all 0"),
        (lambda: around(direction=(1, 0, np.nan)), "direction must be three finite numbers"),
        (lambda: around(direction=(0, 0, -1)), "up must not be parallel to the view"),
        (lambda: around(up="z"), "up must be three finite numbers, got 'z'"),
        (lambda: clvox.Material(color=(0, 0, 300)), "color must be from 0 to 255"),
        (lambda: clvox.Material(diffuse=-1), "diffuse must be a number, 0 or more, got -1"),
    ],
)
def test_cameras_and_materials_that_make_no_sense_are_refused(make: Any, message: str) -> None:
    with pytest.raises(clvox.GridError) as refused:
        make()
    assert message in str(refused.value)


def camera(**options: Any) -> clvox.Camera:
    return clvox.Camera((0, -30, 10), **{"target": (0, 0, 0), **options})


def around(**options: Any) -> clvox.Camera:
    return clvox.Camera.around(clvox.Grid((0, 0, 0), 1.0, (2, 2, 2)), **options)


def test_a_camera_may_be_around_a_mesh_or_a_grid() -> None:
    """All that has bounds."""
    box = trimesh.creation.box(bounds=[(0, 0, 0), (2, 2, 2)])
    assert clvox.Camera.around(box) == around()


def test_perspective_makes_near_things_larger() -> None:
    """The front of a box is wider than its back, and with parallel rays it is not."""
    model = box_model()
    middle = model.bounds.mean(axis=0)
    eye = middle + np.array([0, -14, 14])
    lenses: tuple[tuple[Any, bool], ...] = (({"fov": 50.0}, True), ({"height": 14.0}, False))
    for lens, larger in lenses:
        looking = clvox.Camera(tuple(eye), tuple(middle), **lens)
        widths = opaque(clvox.render(model, camera=looking, size=SIZE)).sum(axis=1)
        (rows,) = np.nonzero(widths)
        top, bottom = widths[rows[0] + 2], widths[rows[-1] - 2]
        assert (bottom > 1.05 * top) == larger


def test_a_box_cuts_a_model_open() -> None:
    """Half of it is gone, and what the cut shows has its own colour and is flat."""
    model = box_model()
    low, high = model.bounds
    looking = clvox.Camera.around(model, direction=(-1, 0.2, -0.2), parallel=True)
    half = tuple(low), ((low[0] + high[0]) / 2, high[1], high[2])
    opened = clvox.Camera(looking.eye, looking.target, height=looking.height, box=half)
    options: dict[str, Any] = {"size": SIZE, "occlusion": False}
    material = clvox.Material(color=(0, 0, 255), cut_color=(255, 0, 0))
    whole = clvox.render(model, camera=looking, material=material, **options)
    cut = clvox.render(model, camera=opened, material=material, **options)
    assert 0.3 < opaque(cut).sum() / opaque(whole).sum() < 0.95
    red = opaque(cut) & (cut[..., 0] > cut[..., 2])
    assert red.sum() > 200
    off = np.abs(cut[red].astype(int) - np.median(cut[red], axis=0)).max(axis=1)
    assert (off < 30).mean() > 0.7
    assert not (opaque(whole) & (whole[..., 0] > whole[..., 2])).any()


def test_a_plane_cuts_a_model_open() -> None:
    """At an angle; what it shows has its own colour and is flat."""
    model = box_model()
    looking = clvox.Camera.around(model, direction=(-1, 0.4, -0.3), parallel=True)
    middle = tuple(model.bounds.mean(axis=0))
    opened = replace(looking, cut=(middle, (1.0, 0.3, 0.2)))
    options: dict[str, Any] = {"size": SIZE, "occlusion": False}
    material = clvox.Material(color=(0, 0, 255), cut_color=(255, 0, 0))
    whole = clvox.render(model, camera=looking, material=material, **options)
    cut = clvox.render(model, camera=opened, material=material, **options)
    assert 0.3 < opaque(cut).sum() / opaque(whole).sum() < 0.98
    red = (cut[..., 3] == 255) & (cut[..., 0] > 1.5 * cut[..., 2])
    assert red.sum() > 100
    off = np.abs(cut[red].astype(int) - np.median(cut[red], axis=0)).max(axis=1)
    assert (off < 6).mean() > 0.9
    for style in ("voxels", "volume"):
        assert opaque(clvox.render(model, camera=opened, style=style, **options)).any()


@pytest.mark.parametrize("far", [1e30, 1e300, 1.7e308])
def test_a_plane_may_be_as_far_off_as_numbers_go(far: float) -> None:
    """Then it cuts away nothing, or everything."""
    model = box_model()
    looking = clvox.Camera.around(model)
    whole, nothing, everything = (
        clvox.render(model, camera=replace(looking, cut=cut), size=SIZE)
        for cut in (None, ((far, 0, 0), (1, 0, 0)), ((far, 0, 0), (-1, 0, 0)))
    )
    np.testing.assert_array_equal(nothing, whole)
    assert not everything.any()


def test_a_near_plane_opens_what_it_runs_through(ball: clvox.VoxelModel) -> None:
    looking = clvox.Camera((0, -5, 0), (0, 0, 0), height=3.0)
    opened = clvox.Camera((0, -5, 0), (0, 0, 0), height=3.0, near=5.0)
    material = clvox.Material(color=(0, 0, 255), cut_color=(255, 0, 0))
    pictures = [
        clvox.render(ball, camera=view, size=SIZE, material=material) for view in (looking, opened)
    ]
    first, second = (opaque(picture).sum() for picture in pictures)
    np.testing.assert_allclose(first, second, rtol=0.03)
    assert pictures[0][36, 48, 2] > pictures[0][36, 48, 0]
    assert pictures[1][36, 48, 0] > pictures[1][36, 48, 2]


def test_voxels_are_told_apart_by_what_they_are() -> None:
    """On a section: touched ones around, those inside, and cells in the middle."""
    sphere = trimesh.creation.icosphere(radius=1.0)
    model = clvox.voxelize(sphere, resolution=48, attributes=("edge",))
    half = (-1, -1, -1), (1, 0, 1)
    looking = clvox.Camera((0, 5, 0), (0, 0, 0), height=2.4, box=half)
    image = clvox.render(
        model, camera=looking, size=(200, 200), style="voxels", samples=1, occlusion=False
    )
    assert len({tuple(pixel) for pixel in image[opaque(image)] // 24}) >= 3
    middle = image[100, 100].astype(int)
    assert middle[2] > middle[0]
    rim = image[100][opaque(image)[100]].astype(int)
    assert rim[0, 0] > rim[0, 2]
    assert rim[-1, 0] > rim[-1, 2]


def test_volume_of_a_ball_is_darkest_in_the_middle(ball: clvox.VoxelModel) -> None:
    image = clvox.render(ball, size=(80, 80), style="volume").astype(int)
    assert image[40, 40, 3] > image[40, 24, 3] > image[40, 18, 3]
    more = clvox.render(ball, size=(80, 80), style="volume", density=9.0).astype(int)
    assert more[40, 40, 3] > image[40, 40, 3]


def test_lengths_are_those_of_the_solid(ball: clvox.VoxelModel) -> None:
    """Chords of a ball, up to its voxels; and of the voxels themselves, exactly."""
    looking = clvox.Camera((3, -4, 2), (0, 0, 0), height=2.0)
    view = looking.view(ball.grid, (9, 9))
    scene = Scene(ball._arrays, ball.grid.spacing)
    got = measure_lengths(ball._session, scene, view, Pixels.whole((9, 9))).get().reshape(9, 9)
    expected = lengths(ball.to_array(), view.rays, (9, 9), ball.grid.spacing)
    np.testing.assert_allclose(got, expected, atol=1e-5 * np.sqrt(12))
    place = (np.arange(9) - 4) * 2 / 9
    square = 1 - place[:, None] ** 2 - place**2
    chords = 2 * np.sqrt(np.maximum(square, 0))
    assert np.abs(got - chords)[square > 0.1].max() < 0.1


def test_normals_of_the_mesh_make_no_speckle() -> None:
    sphere = trimesh.creation.icosphere(radius=1.0, subdivisions=5)
    model = clvox.voxelize(sphere, resolution=64, attributes=("normals",))
    middle = clvox.render(model, size=(160, 160)).astype(float)[50:110, 50:110, :3]
    assert np.abs(np.diff(middle, axis=0)).max() < 30
    assert np.abs(np.diff(middle, axis=1)).mean() < 3
    inside_out = sphere.copy()
    inside_out.invert()
    other = clvox.voxelize(inside_out, resolution=64, attributes=("normals",))
    again = clvox.render(other, size=(160, 160)).astype(float)[50:110, 50:110, :3]
    np.testing.assert_allclose(again, middle, atol=2)


def test_faces_behind_a_rim_do_not_darken_it() -> None:
    """Voxels at the far edge of a face are of the face behind it; nothing of it is seen."""
    slab = trimesh.creation.box(extents=(10, 8, 1))
    turn: Any = trimesh.transformations
    slab.apply_transform(turn.rotation_matrix(0.13, (0.2, 0.4, 0.9)))
    options: dict[str, Any] = {"size": (200, 150), "samples": 1, "occlusion": False}
    grid = clvox.Grid.fit(slab, resolution=96)
    for levels in (None, [grid.shape]):
        model = clvox.voxelize(slab, grid=grid, levels=levels, attributes=("normals",))
        image = clvox.render(model, **options)
        columns = np.flatnonzero(opaque(image).sum(axis=0) > 20)
        rim = opaque(image).argmax(axis=0)[columns]
        bright = image[..., :3].mean(axis=2)
        assert (bright[rim, columns] > 0.85 * bright[rim + 4, columns]).mean() > 0.98


def test_a_sheet_is_seen_from_both_sides() -> None:
    sheet = trimesh.Trimesh([(0, 0, 0), (9, 0, 1), (9, 9, 1), (0, 9, 0)], [(0, 1, 2), (0, 2, 3)])
    model = clvox.voxelize(sheet, resolution=48, fill="surface", attributes=("normals",))
    middles = []
    for towards in (1, -1):
        eye = 4.5, 4.5, 30 * towards
        camera = clvox.Camera(eye, (4.5, 4.5, 0.5), (0, 1, 0), height=8)
        image = clvox.render(model, camera=camera, size=(40, 40), occlusion=False)
        middles.append(image[20, 20].astype(int))
        assert middles[-1][:3].mean() > 100
    flipped = sheet.copy()
    flipped.invert()
    other = clvox.voxelize(flipped, resolution=48, fill="surface", attributes=("normals",))
    again = clvox.render(other, camera=camera, size=(40, 40), occlusion=False)[20, 20].astype(int)
    np.testing.assert_allclose(again, middles[-1], atol=2)


def test_levels_do_not_show_where_the_mesh_is_thin() -> None:
    """A plate between the middles of voxels has none inside: only touched ones are drawn."""
    plate = trimesh.creation.box(bounds=[(0, 0, 0.3), (10, 10, 0.4)])
    grid = clvox.Grid((-7, -7, -11), 0.5, (48, 48, 48))
    dense, levelled = (
        clvox.voxelize(plate, grid=grid, levels=levels, attributes=("normals",))
        for levels in ([(48, 48, 48)], [(6, 6, 6), (8, 8, 8)])
    )
    assert dense.count == 0
    camera = clvox.Camera.around(levelled, aspect=SIZE[0] / SIZE[1])
    for style in ("surface", "voxels"):
        one, other = (
            clvox.render(model, camera=camera, size=SIZE, style=style)
            for model in (dense, levelled)
        )
        assert opaque(other).mean() > 0.1
        np.testing.assert_array_equal(opaque(one), opaque(other))


@pytest.mark.skipif(
    len(clvox.devices()) < 2, reason="needs two OpenCL devices: run on Intel's runtime"
)
@pytest.mark.parametrize("style", ["surface", "voxels", "volume"])
def test_devices_differ_by_rounding(style: Any) -> None:
    """By one step of a byte, in all but one of 10,000 pixels."""
    mesh = trimesh.creation.torus(3, 1)
    pictures = []
    for device in clvox.devices()[:2]:
        model = clvox.voxelize(mesh, resolution=96, attributes=("normals",), device=device)
        pictures.append(clvox.render(model, size=(320, 200), style=style).astype(int))
    differ = np.abs(pictures[0] - pictures[1]).max(axis=2)
    assert np.ptp(pictures[0]) > 100
    assert np.count_nonzero(differ > 1) <= differ.size / 10_000


def test_notebooks_show_a_picture(ball: clvox.VoxelModel) -> None:
    assert ball._repr_png_().startswith(b"\x89PNG")


def test_turntable_is_an_animation(ball: clvox.VoxelModel, tmp_path: Any) -> None:
    path = tmp_path / "ball.gif"
    clvox.turntable(ball, path, frames=4, size=(40, 30))
    with Image.open(path) as pictures:
        assert getattr(pictures, "n_frames", 1) == 4
        assert pictures.size == (40, 30)


def test_turntable_of_equal_pictures_lasts_as_long(tmp_path: Any) -> None:
    """Pillow makes one frame of them, and adds up how long they are shown."""
    nothing = clvox.VoxelModel.from_array(
        np.zeros((4, 4, 4), bool), clvox.Grid((0, 0, 0), 1.0, (4, 4, 4))
    )
    path = tmp_path / "nothing.gif"
    clvox.turntable(nothing, path, frames=64, seconds=654.9, size=(8, 6))
    with Image.open(path) as pictures:
        assert getattr(pictures, "n_frames", 1) == 1
        assert 654_000 < pictures.info["duration"] < 655_000


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"frames": 1}, "frames must be at least 2, an integer, got 1"),
        ({"frames": 2.5}, "frames must be at least 2, an integer, got 2.5"),
        ({"seconds": 0}, "seconds must be a number above 0 and below 655, got 0"),
        ({"seconds": 655}, "seconds must be a number above 0 and below 655, got 655"),
        ({"size": (0, 0)}, "size must be from 1 to 16384 pixels a side"),
        ({"size": 7}, "size must be two integers"),
        ({"camera": 7}, "camera must be a clvox.Camera, got a int"),
        ({"style": "shiny"}, "style must be one of"),
        ({"path": "a.png"}, "a.png: the suffix must be .gif, got .png"),
        ({"path": "none/a.gif"}, "there is no such folder"),
        ({"model": "part.stl"}, "what is drawn must be a VoxelModel, got a str"),
    ],
)
def test_turntables_that_make_no_sense_are_refused(
    ball: clvox.VoxelModel, tmp_path: Any, options: dict[str, Any], message: str
) -> None:
    """And nothing is written."""
    given = {"model": ball, "path": "a.gif", "frames": 2, "size": (8, 6), **options}
    model, path = given.pop("model"), tmp_path / given.pop("path")
    with pytest.raises((clvox.ClvoxError, OSError)) as refused:
        clvox.turntable(model, path, **given)
    assert message in str(refused.value)
    assert not any(tmp_path.iterdir())


def test_only_models_of_voxels_are_drawn() -> None:
    mesh: Any = trimesh.creation.box(extents=(1, 1, 1))
    with pytest.raises(clvox.GridError, match=r"got a Trimesh; clvox\.voxelize makes one"):
        clvox.render(mesh)


def test_numbers_of_numpy_are_numbers(ball: clvox.VoxelModel) -> None:
    volume: Any = {"style": "volume", "density": np.float32(1), "samples": np.int64(1)}
    assert clvox.render(ball, size=(8, 8), **volume).any()
    half: Any = np.float32(0.5)
    assert clvox.render(ball, size=(8, 8), material=clvox.Material(diffuse=half)).any()


def test_a_camera_walks_around_its_target() -> None:
    first = clvox.Camera((3, 0, 4), (0, 0, 1), fov=30)
    np.testing.assert_allclose(first.turned(90).eye, (0, 3, 4), atol=1e-12)
    np.testing.assert_allclose(first.turned(360).eye, first.eye, atol=1e-12)
