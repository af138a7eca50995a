"""What rays meet, and how far they run inside, against a look at all voxels."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from clvox.camera import Camera
from clvox.device import Session
from clvox.errors import GridError
from clvox.grid import Grid, Shape
from clvox.ops import raymarch
from clvox.ops.distances import MOST
from clvox.ops.layout import Cells, VoxelArrays, cell_shape
from clvox.ops.raymarch import Hits, Pixels, Scene, march, measure_lengths
from clvox.picture_rays import Plane, Rays, View
from clvox.reference.multilevel import pack_bits, pack_bricks, rank
from clvox.reference.raymarch import _ray, first_voxels, lengths, places_of_rays

SIZE = 11, 9
BRICKS = (8, 8, 8), (2, 4, 3), (3, 5, 2), (4, 4, 4)
ONES = 1.0, 1.0, 1.0


def solid(rng: np.random.Generator) -> NDArray[np.bool_]:
    """A box of voxels, some of them inside, few or many."""
    shape = rng.integers(1, 12, 3)
    voxels: NDArray[np.bool_] = rng.random(shape) < rng.choice([0.03, 0.2, 0.8, 1.0])
    return voxels


def dense(session: Session, voxels: NDArray[np.bool_]) -> VoxelArrays:
    return VoxelArrays(shape_of(voxels), session.upload(pack_bits(voxels)))


def two_levels(session: Session, voxels: NDArray[np.bool_], brick: Shape) -> VoxelArrays:
    """With a brick in some cells that need none; cells beyond the grid are what the rest is."""
    shape = shape_of(voxels)
    cells = cell_shape(shape, brick)
    padding = [(0, n * m - k) for n, m, k in zip(cells, brick, shape, strict=True)][::-1]
    sides = [side for pair in zip(cells[::-1], brick[::-1], strict=True) for side in pair]

    def blocks(array: NDArray[np.bool_], beyond: bool) -> NDArray[np.bool_]:
        padded = np.pad(array, padding, constant_values=beyond)
        return padded.reshape(sides).transpose(0, 2, 4, 1, 3, 5)

    some = blocks(voxels, False).any(axis=(3, 4, 5))
    every = blocks(voxels, True).all(axis=(3, 4, 5))
    spare = np.arange(some.size).reshape(some.shape) % 5 == 0
    boundary = (some & ~every) | spare
    words = pack_bits(boundary)
    bricks = pack_bricks(blocks(voxels, False)[boundary])
    ranks = session.upload(rank(words))
    held = Cells(cells, brick, session.upload(words), ranks, len(bricks))
    inside = session.upload(pack_bits(every & ~boundary))
    return VoxelArrays(shape, session.upload(bricks), held, inside)


def models(
    session: Session, voxels: NDArray[np.bool_], rng: np.random.Generator
) -> list[VoxelArrays]:
    brick = BRICKS[rng.integers(len(BRICKS))]
    return [dense(session, voxels), two_levels(session, voxels, brick)]


def shape_of(voxels: NDArray[np.bool_]) -> Shape:
    nz, ny, nx = voxels.shape
    return nx, ny, nz


def voxels_of(hits: Hits, size: tuple[int, int]) -> NDArray[np.int32]:
    """What is met first, (rows, columns, 3)."""
    voxels: NDArray[np.int32] = hits.voxels.get().reshape(size[1], size[0], 4)[..., :3]
    return voxels


def view_of(rays: Rays, shape: Shape, low: Shape = (0, 0, 0), high: Shape | None = None) -> View:
    """A view of which only the rays and the voxels that are drawn matter."""
    nothing = np.zeros(3)
    return View(rays, nothing, nothing, nothing, low, high or shape, (1.0, 0.0), 0.0)


def check_rays(
    session: Session,
    voxels: NDArray[np.bool_],
    view: View,
    rng: np.random.Generator,
    spacing: tuple[float, float, float] = ONES,
) -> NDArray[np.int32]:
    """Compare both kernels with their twins, on a model of one level and on one of two."""
    rays, box = view.rays, (view.low, view.high, view.cut)
    expected = first_voxels(voxels, rays, SIZE, *box)
    within = lengths(voxels, rays, SIZE, spacing, *box)
    diagonal = float(np.linalg.norm(np.array(shape_of(voxels)) * spacing))
    for arrays in models(session, voxels, rng):
        scene = Scene(arrays, spacing)
        hits = march(session, scene, view, Pixels.whole(SIZE))
        np.testing.assert_array_equal(voxels_of(hits, SIZE), expected)
        found = np.isfinite(hits.far.get()).reshape(expected.shape[:2])
        np.testing.assert_array_equal(found, expected[..., 0] >= 0)
        got = measure_lengths(session, scene, view, Pixels.whole(SIZE)).get()
        np.testing.assert_allclose(got.reshape(within.shape), within, rtol=0, atol=1e-5 * diagonal)
    return expected


@given(seed=st.integers(0, 2**32 - 1), begins=st.booleans(), turning=st.booleans())
def test_rays_through_edges_and_corners(
    session: Session, seed: int, begins: bool, turning: bool
) -> None:
    """Places and directions are small integers, so that rays run through edges all the time."""
    rng = np.random.default_rng(seed)
    voxels = solid(rng)
    direction = rng.integers(-2, 3, 3)
    direction[rng.integers(3)] = rng.choice([-1, 1])
    triples = [direction, *(8 * rng.integers(-2, 3, (2, 3))), 8 * rng.integers(-8, 20, 3)]
    ahead, right, down, start = ((int(x), int(y), int(z)) for x, y, z in triples)
    rays = Rays(4, 0, 1 << 20, ahead, start, right, down, begins=begins)
    if turning:
        turns = rng.integers(-1, 2, (2, 3)).tolist()
        # Every other ray has half a step more, and no ray stands still along all axes.
        turn_right, turn_down = ((int(x), int(y), 0) for x, y, _ in turns)
        ahead = 2 * ahead[0], 2 * ahead[1], 2 * (ahead[2] or 1)
        rays = replace(rays, turn=1, direction=ahead, turn_right=turn_right, turn_down=turn_down)
    shape = shape_of(voxels)
    low = rng.integers(0, np.array(shape) + 1)
    high = rng.integers(low, np.array(shape) + 1)
    box = ((0, 0, 0), shape) if rng.random() < 0.5 else (tuple(low.tolist()), tuple(high.tolist()))
    check_rays(session, voxels, view_of(rays, shape, *box), rng)


@given(seed=st.integers(0, 2**32 - 1))
def test_rays_of_cameras(session: Session, seed: int) -> None:
    """From anywhere, also from within, along an axis, through a box, with unequal spacings."""
    rng = np.random.default_rng(seed)
    voxels = solid(rng)
    shape = shape_of(voxels)
    spacing = tuple(rng.choice([0.1, 1.0, 3.0], 3).tolist())
    grid = Grid(rng.normal(size=3), spacing, shape)
    low, high = grid.bounds
    target = rng.uniform(low, high)
    if rng.random() < 0.3:
        axis = np.eye(3)[rng.integers(3)] * rng.choice([-1, 1])
        eye = target + axis * np.linalg.norm(high - low) * rng.choice([0.1, 3.0])
    else:
        eye = rng.uniform(low - (high - low), high + (high - low))
    box = None if rng.random() < 0.5 else np.sort(rng.uniform(low, high, (2, 3)), axis=0)
    lens = {"fov": 70.0} if rng.random() < 0.6 else {"height": float((high - low).max())}
    # Sometimes along an axis, and through rays that are parallel to it.
    normal = rng.normal(size=3) if rng.random() < 0.6 else np.eye(3)[rng.integers(3)] * -1
    cut = None if rng.random() < 0.4 else (rng.uniform(low - 1, high + 1), normal)
    camera = Camera(eye, target, rng.normal(size=3), box=box, cut=cut, **lens)  # type: ignore[arg-type]
    check_rays(session, voxels, camera.view(grid, SIZE), rng, grid.spacing)


@given(seed=st.integers(0, 2**32 - 1), begins=st.booleans())
def test_planes_through_edges_and_corners(session: Session, seed: int, begins: bool) -> None:
    """Of small integers, so that rays meet them at edges, or are parallel to them."""
    rng = np.random.default_rng(seed)
    voxels = solid(rng)
    shape = shape_of(voxels)
    direction = rng.integers(-2, 3, 3)
    direction[rng.integers(3)] = rng.choice([-1, 1])
    triples = [direction, *(8 * rng.integers(-2, 3, (2, 3))), 8 * rng.integers(-8, 20, 3)]
    ahead, right, down, start = ((int(x), int(y), int(z)) for x, y, z in triples)
    rays = Rays(4, 0, 1 << 20, ahead, start, right, down, begins=begins)
    normal = rng.integers(-2, 3, 3)
    normal[rng.integers(3)] = rng.choice([-1, 1])
    most = int(normal @ (8 * rng.integers(-1, 2 * np.array(shape) + 2)))
    x, y, z = normal.tolist()
    cut = Plane((x, y, z), most, np.zeros(3), (0.0, 0.0, 0.0, 0.0))
    check_rays(session, voxels, replace(view_of(rays, shape), cut=cut), rng)


def test_a_plane_halves_a_full_box(session: Session) -> None:
    """The lengths on both sides of it make the whole, and neither is nothing."""
    voxels = np.ones((8, 8, 8), bool)
    grid = Grid((0, 0, 0), 1.0, (8, 8, 8))
    scene = Scene(two_levels(session, voxels, (2, 4, 3)), ONES)
    whole = Camera.around(grid, aspect=SIZE[0] / SIZE[1])
    sums = []
    for normal in ((1.0, 2.0, -0.5), (-1.0, -2.0, 0.5)):
        view = replace(whole, cut=((4, 4, 4), normal)).view(grid, SIZE)
        sums.append(measure_lengths(session, scene, view, Pixels.whole(SIZE)).get())
    full = measure_lengths(session, scene, whole.view(grid, SIZE), Pixels.whole(SIZE)).get()
    np.testing.assert_allclose(sums[0] + sums[1], full, atol=1e-4)
    assert all(0.3 * full.sum() < half.sum() < 0.7 * full.sum() for half in sums)


@pytest.mark.parametrize("lens", [{"fov": 40.0}, {"height": 8.0}])
def test_most_rays_of_a_view_of_a_full_box_hit(session: Session, lens: Any) -> None:
    """Two programs that never find anything would agree, too."""
    voxels = np.ones((4, 5, 6), bool)
    camera = Camera.around(Grid((0, 0, 0), 1.0, (6, 5, 4)), aspect=SIZE[0] / SIZE[1])
    camera = Camera(camera.eye, camera.target, camera.up, **lens)
    view = camera.view(Grid((0, 0, 0), 1.0, (6, 5, 4)), SIZE)
    hits = check_rays(session, voxels, view, np.random.default_rng(1))
    assert 0.1 < (hits[..., 0] >= 0).mean() < 0.9


@pytest.mark.parametrize("size", [(0, 5), (1, 1), (7, 9), (8, 8), (13, 5)])
def test_any_number_of_rays(session: Session, size: tuple[int, int]) -> None:
    """None, one, and one below, at and above that of a work-group."""
    voxels = np.ones((2, 2, 2), bool)
    rays = Rays(4, 0, 1 << 20, (1, 3, 2), (-40, 3, 5), (3, 1, 0), (0, 2, 3))
    scene, view = Scene(dense(session, voxels), ONES), view_of(rays, (2, 2, 2))
    hits = march(session, scene, view, Pixels.whole(size))
    np.testing.assert_array_equal(voxels_of(hits, size), first_voxels(voxels, rays, size))
    within = measure_lengths(session, scene, view, Pixels.whole(size)).get()
    expected = lengths(voxels, rays, size, ONES)
    np.testing.assert_allclose(within.reshape(expected.shape), expected, atol=1e-5)


def test_rays_alone_and_side_by_side(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    """Meet the same, at the same places, whatever the device would choose."""
    voxels = np.random.default_rng(11).random((9, 10, 11)) < 0.2
    grid, size = Grid((0, 0, 0), 1.0, (11, 10, 9)), (13, 5)
    view = Camera.around(grid).view(grid, size)
    scene, pixels = Scene(two_levels(session, voxels, (4, 3, 5)), ONES), Pixels.whole(size)
    found = []
    for wide in (1, 8):
        monkeypatch.setattr(raymarch, "width_of", lambda _, wide=wide: wide)
        hits = march(session, scene, view, pixels)
        within = measure_lengths(session, scene, view, pixels)
        found.append([part.get() for part in (*hits, within)])
    for alone, beside in zip(*found, strict=True):
        np.testing.assert_array_equal(alone, beside)
    np.testing.assert_array_equal(
        found[0][0].reshape(5, 13, 4)[..., :3], first_voxels(voxels, view.rays, size)
    )


@pytest.mark.parametrize("listed", [False, True])
@pytest.mark.parametrize("samples", [1, 2, 3])
def test_some_pixels_of_a_picture(session: Session, listed: bool, samples: int) -> None:
    """In a row or from a list, with a few rays for each or one of them."""
    voxels = np.ones((4, 5, 6), bool)
    grid = Grid((0, 0, 0), 1.0, (6, 5, 4))
    columns, rows = SIZE
    fine = columns * samples**2, rows * samples**2
    view = Camera.around(grid).view(grid, fine)
    scene = Scene(two_levels(session, voxels, (2, 4, 3)), ONES)
    expected = first_voxels(voxels, view.rays, fine)
    by_pixel = np.empty((rows * columns, samples**2, 3), int)
    for row, column in np.ndindex(rows, columns):
        places = np.array(sorted(places_of_rays(column, row, samples), key=by_row))
        by_pixel[row * columns + column] = expected[places[:, 1], places[:, 0]]
    numbers = np.random.default_rng(5).permutation(rows * columns).astype(np.uint32)
    chosen = session.upload(numbers) if listed else None
    pixels = Pixels(SIZE, samples, 7, 40, chosen)
    wanted = by_pixel[numbers[7:47]] if listed else by_pixel[7:47]
    got = march(session, scene, view, pixels).voxels.get()[..., :3]
    np.testing.assert_array_equal(got.reshape(wanted.shape), wanted)
    parts = [part.count for part in pixels.parts(16 * samples**2)]
    assert parts == [16, 16, 8]
    one = march(session, scene, view, replace(pixels, each=False)).voxels.get()[..., :3]
    for number, met in zip(numbers[7:47] if listed else range(7, 47), one, strict=True):
        column, row = places_of_rays(int(number) % columns, int(number) // columns, samples)[0]
        np.testing.assert_array_equal(met, expected[row, column])


@pytest.mark.parametrize("samples", [1, 2, 3, 4, 8])
def test_rays_of_a_pixel_are_spread_evenly(samples: int) -> None:
    """One in each column and row of places; and so are the first ones of pixels in a line."""
    side = samples**2
    lines = [places_of_rays(3, 4, samples)]
    lines.append([places_of_rays(k, 4, samples)[0] for k in range(side)])
    lines.append([places_of_rays(3, k, samples)[0] for k in range(side)])
    for line in lines:
        for axis in (0, 1):
            assert sorted(place[axis] % side for place in line) == list(range(side))
    middle = np.mean(lines[0], axis=0) + 0.5
    np.testing.assert_allclose(middle, (3.5 * side, 4.5 * side))


def by_row(place: tuple[int, int]) -> tuple[int, int]:
    return place[1], place[0]


@pytest.mark.parametrize("lens", [{"fov": 40.0}, {"fov": 120.0}, {"height": 90.0}])
@pytest.mark.parametrize("size", [(11, 9), (1920, 1080), (2, 16384)])
def test_rays_are_those_of_the_camera(lens: Any, size: tuple[int, int]) -> None:
    """Behind the grid they are at most a fiftieth of a voxel from where float64 has them."""
    grid = Grid((1, 2, 3), (1.0, 0.5, 2.0), (100, 200, 80))
    camera = Camera((-70, -90, 150), (50, 40, 90), (0.1, 0.2, 1), **lens)
    columns, rows = size
    right, above, back = camera.frame()
    view = camera.view(grid, size)
    if camera.fov is None:
        assert camera.height is not None
        wide = camera.height / rows
    else:
        wide = 2 * np.tan(np.radians(camera.fov) / 2) / rows
    corners = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    depths = -(corners * np.subtract(*grid.bounds[::-1]) + grid.origin - camera.eye) @ back
    for column, row in ((0, 0), (columns - 1, 0), (columns // 2, rows // 3), (0, rows - 1)):
        aside = wide * ((column - (columns - 1) / 2) * right - (row - (rows - 1) / 2) * above)
        place, direction = _ray(view.rays, column, row)
        begin = (np.array(place) / 2.0**view.rays.bits) * grid.spacing + grid.origin
        ahead = np.array(direction, float) * grid.spacing
        far = float(depths.max())
        end = begin + ahead * (((begin - camera.eye) @ back + far) / -(ahead @ back))
        expected = camera.eye + aside * (1 if camera.fov is None else far) - far * back
        np.testing.assert_allclose((end - expected) / grid.spacing, 0, atol=0.02)


def test_rays_far_off_miss(session: Session) -> None:
    """Their moments would not fit; nothing may come of it but a miss."""
    voxels = np.ones((2, 2, 2), bool)
    rays = Rays(16, 0, 1 << 30, (1 << 17, 3, 5), (0, 1 << 60, 0), (0, 1 << 50, 0), (0, 0, 1))
    scene = Scene(two_levels(session, voxels, (2, 2, 2)), ONES)
    hits = march(session, scene, view_of(rays, (2, 2, 2)), Pixels.whole(SIZE))
    assert (hits.voxels.get()[..., :3] == -1).all()


def test_voxels_beyond_the_grid_are_never_met(session: Session) -> None:
    """A cell that is wholly inside may reach beyond the grid."""
    voxels = np.ones((9, 9, 9), bool)
    grid = Grid((0, 0, 0), 1.0, (9, 9, 9))
    scene = Scene(two_levels(session, voxels, (8, 8, 8)), ONES)
    for direction in ((-1, -1, -1), (1, -1, 2), (-3, 1, 1), (0, 0, -1)):
        view = Camera.around(grid, direction=direction, up=(0, 1, 0)).view(grid, SIZE)
        assert march(session, scene, view, Pixels.whole(SIZE)).voxels.get()[..., :3].max() == 8


@given(
    shape=st.tuples(*[st.sampled_from([1, 7, 64, 512, 131071])] * 3),
    spacing=st.tuples(*[st.sampled_from([0.01, 1.0, 5.0])] * 3),
    direction=st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda d: max(map(abs, d)) > 1e-3),
    size=st.sampled_from([(1, 1), (3840, 2160), (32768, 2), (2, 32768)]),
    parallel=st.booleans(),
)
@settings(max_examples=200)
def test_moments_fit_into_64_bits(
    shape: Shape,
    spacing: tuple[float, float, float],
    direction: tuple[float, ...],
    size: tuple[int, int],
    parallel: bool,
) -> None:
    """Of every ray that is followed, at all planes of the grid and of cells beyond it."""
    up = (0.3, 0.5, 0.7)
    if np.linalg.norm(np.cross(direction, up)) < 1e-2:
        up = (0.7, 0.5, 0.3)
    grid = Grid((0, 0, 0), spacing, shape)
    camera = Camera.around(
        grid, direction=direction, up=up, parallel=parallel, aspect=size[0] / size[1]
    )
    try:
        rays = camera.view(grid, size).rays
    except GridError:
        # Refused, since 64 bits would not do: voxels or pictures hundreds of times as wide as high.
        extents = np.array(shape) * spacing
        assert extents.max() > 100 * extents.min() or max(size) > 100 * min(size)
        return
    widest = []
    corners = [(u, v) for u in (0, size[0]) for v in (0, size[1])]
    for axis in range(3):
        parts = [
            rays.direction[axis] + u * rays.turn_right[axis] + v * rays.turn_down[axis]
            for u, v in corners
        ]
        starts = [rays.start[axis] + u * rays.right[axis] + v * rays.down[axis] for u, v in corners]
        assert max(map(abs, starts + parts)) < 2**63
        widest.append(max(map(abs, parts)) >> rays.turn)
        # A ray through the middle of the grid is followed.
        middle = rays.start[axis] + size[0] // 2 * rays.right[axis] + size[1] // 2 * rays.down[axis]
        assert abs(middle >> rays.fraction) < rays.reach
    for axis in range(3):
        others = [max(1, part + 1) for other, part in enumerate(widest) if other != axis]
        # A place, mirrored or not, and the planes of the padded grid and of one more cell; or of as
        # many cells as a ray may pass at once, which the longest axis has.
        beyond = 64 * max(3, min(max(shape), MOST))
        farthest = rays.reach + ((shape[axis] + beyond) << rays.bits)
        assert farthest * others[0] * others[1] < 2**63
