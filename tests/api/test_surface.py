"""The surface of a solid of samples: closed, oriented, of the right topology, in the right place.

The first part is the proof of docs/algorithms/surface.md, by enumeration of the 256 cubes; the
second tries whole solids, and knows nothing of cubes.
"""

from __future__ import annotations

import itertools
import tracemalloc
from collections import Counter
from collections.abc import Iterator
from fractions import Fraction
from typing import Any, TypeAlias

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray
from skimage.measure import euler_number, marching_cubes

from clvox import _cubes
from clvox._cubes import LEVEL, table
from clvox.errors import GridError
from clvox.grid import Grid, Shape
from clvox.surface import Read, extract

Solid: TypeAlias = NDArray[np.bool_]
Point: TypeAlias = tuple[int, ...]
Side: TypeAlias = tuple[Point, Point]
Mesh: TypeAlias = tuple[NDArray[np.float64], NDArray[np.integer[Any]]]


def grid_of(solid: Solid, **place: Any) -> Grid:
    nz, ny, nx = solid.shape
    return Grid(place.get("origin", (0, 0, 0)), place.get("spacing", 1), (nx, ny, nz))


def reader(solid: NDArray[Any]) -> Read:
    def read(start: Shape, stop: Shape) -> NDArray[Any]:
        for low, high, count in zip(start, stop, solid.shape[::-1], strict=True):
            assert 0 <= low < high <= count
        return solid[start[2] : stop[2], start[1] : stop[1], start[0] : stop[0]]

    return read


def states(solid: Solid, cell: Shape) -> NDArray[np.uint8]:
    """Per cell: 0 all out, 1 all in, 2 neither; voxels beyond the grid count for neither."""
    shape = [-(-count // width) for count, width in zip(solid.shape, cell[::-1], strict=True)]
    result = np.empty(shape, dtype=np.uint8)
    for at in np.ndindex(*shape):
        part = solid[tuple(slice(i * w, (i + 1) * w) for i, w in zip(at, cell[::-1], strict=True))]
        result[at] = 2 if part.any() != part.all() else part.all()
    return result


def signed_volume(mesh: Mesh) -> float:
    a, b, c = np.moveaxis(mesh[0][mesh[1]], 1, 0)
    return float((a * np.cross(b, c)).sum() / 6)


def check(solid: Solid, mesh: Mesh) -> None:
    """Closed, oriented, without repeated vertices, right side out, and of the right topology."""
    vertices, faces = mesh
    assert faces.shape[1:] == (3,)
    assert vertices.shape[1:] == (3,)
    sides = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).astype(np.int64)
    assert (sides[:, 0] != sides[:, 1]).all()
    forth = np.sort(sides[:, 0] * len(vertices) + sides[:, 1])
    back = np.sort(sides[:, 1] * len(vertices) + sides[:, 0])
    # Each directed side once, and its reverse once: two triangles, in opposite directions.
    assert (forth[1:] != forth[:-1]).all()
    assert (forth == back).all()
    assert (np.bincount(faces.ravel(), minlength=len(vertices)) > 0).all()
    # Connectivity 1 is that of voxels which share a face: 6-connected.
    chi = len(vertices) - len(sides) // 2 + len(faces)
    assert chi == 2 * euler_number(solid, connectivity=1)  # type: ignore[no-untyped-call]
    assert (signed_volume(mesh) > 0) == bool(solid.any())


# The proof, cube by cube.


def triangles(case: int) -> list[tuple[Point, Point, Point]]:
    """The triangles of a cube, each vertex at twice its place, z, y, x: 0, 1 or 2."""
    known = table()
    at = 2 * known.edges[:, 1:]
    at[np.arange(12), 2 - known.edges[:, 0]] += 1
    rows = known.triangles[known.start[case] : known.start[case] + known.count[case]]
    return [(tuple(a), tuple(b), tuple(c)) for a, b, c in at[rows].tolist()]


def sides(case: int) -> list[Side]:
    return [side for a, b, c in triangles(case) for side in ((a, b), (b, c), (c, a))]


def bits(case: int) -> NDArray[np.int64]:
    return np.array([case >> bit & 1 for bit in range(8)]).reshape(2, 2, 2)


def shared_faces(*points: Point) -> list[tuple[int, int]]:
    """The faces of the cube, as (axis, 0 or 2), that hold all the points."""
    return [
        (axis, place)
        for axis, place in itertools.product(range(3), (0, 2))
        if all(point[axis] == place for point in points)
    ]


def border(case: int) -> list[Side]:
    own = sides(case)
    return [(a, b) for a, b in own if (b, a) not in own]


def test_a_cube_has_a_vertex_on_each_edge_that_changes_side() -> None:
    for case in range(256):
        samples = bits(case)
        expected = set()
        for low in itertools.product((0, 1), repeat=3):
            for axis in range(3):
                high = tuple(min(1, at + (a == axis)) for a, at in enumerate(low))
                if samples[low] != samples[high]:
                    expected.add(tuple(a + b for a, b in zip(low, high, strict=True)))
        assert {point for triangle in triangles(case) for point in triangle} == expected


def test_a_side_in_a_face_belongs_to_one_triangle_and_an_inner_side_to_two() -> None:
    for case in range(256):
        own = sides(case)
        assert max(Counter(own).values(), default=1) == 1
        for a, b in own:
            assert len(shared_faces(a, b)) == (0 if (b, a) in own else 1)


@pytest.mark.parametrize("axis", range(3))
def test_cubes_agree_on_the_face_between_them(axis: int) -> None:
    """Sides in a face depend on its samples only; neighbours run along them in opposite ways."""
    below: dict[bytes, set[Side]] = {}
    above: dict[bytes, set[Side]] = {}
    for case in range(256):
        for place, found in ((2, below), (0, above)):
            lines = {
                (a[:axis] + a[axis + 1 :], b[:axis] + b[axis + 1 :])
                for a, b in border(case)
                if (axis, place) in shared_faces(a, b)
            }
            pattern = bits(case).take(place // 2, axis=axis).tobytes()
            assert found.setdefault(pattern, lines) == lines
    assert len(below) == 16
    assert {pattern: {(b, a) for a, b in lines} for pattern, lines in above.items()} == below


def test_the_triangles_at_a_vertex_are_one_fan() -> None:
    """From one of the two faces that its edge belongs to, to the other."""
    for case in range(256):
        links: dict[Point, list[Side]] = {}
        for a, b, c in triangles(case):
            for at, first, last in ((a, b, c), (b, c, a), (c, a, b)):
                links.setdefault(at, []).append((first, last))
        for at, link in links.items():
            onward = dict(link)
            assert len(onward) == len(link)
            (start,) = set(onward) - set(onward.values())
            path = [start]
            while path[-1] in onward:
                path.append(onward[path[-1]])
            assert len(path) == len(link) + 1
            ends = shared_faces(at, path[0]) + shared_faces(at, path[-1])
            assert sorted(ends) == sorted(shared_faces(at))


def test_the_euler_number_is_right_in_every_cube() -> None:
    """What a cube shares with n - 1 others counts 1/n."""
    for case in range(256):
        cube = bits(case)
        own, rim = sides(case), border(case)
        points = {point for side in own for point in side}
        surface = (
            Fraction(len(points), 4)
            - Fraction(len(own) - len(rim), 2)
            - Fraction(len(rim), 2)
            + len(triangles(case))
        )
        solid = Fraction(int(cube.sum()), 8) - int(cube.prod())
        for axis in range(3):
            solid -= Fraction(int(cube.prod(axis=axis).sum()), 4)
            solid += Fraction(sum(int(cube.take(place, axis=axis).prod()) for place in (0, 1)), 2)
        assert surface == 2 * solid


def test_the_triangles_of_a_cube_meet_only_in_what_they_share() -> None:
    """So the surface does not cut itself.

    A plane stands between any two triangles, and touches them in common vertices only; and none
    lies in a face, where a neighbour might have another.
    """
    normals = np.array(list(itertools.product(range(-2, 3), repeat=3)))
    for case in range(256):
        for one in triangles(case):
            assert not shared_faces(*one)
        for one, other in itertools.combinations(triangles(case), 2):
            low, high = normals @ np.transpose(one), normals @ np.transpose(other)
            top, bottom = low.max(axis=1, keepdims=True), high.min(axis=1, keepdims=True)
            shared = np.array([point in other for point in one])
            touches = (low == top)[:, ~shared].any(axis=1)
            shared = np.array([point in one for point in other])
            touches |= (high == bottom)[:, ~shared].any(axis=1)
            apart = (top < bottom)[:, 0] | ((top == bottom)[:, 0] & ~touches)
            assert apart.any(), case


# Whole solids.


def solids() -> Iterator[Solid]:
    """A thousand small grids."""
    checker = np.indices((6, 6, 6)).sum(axis=0) % 2 == 1
    yield from (checker, ~checker, np.zeros((6, 6, 6), bool), np.ones((6, 6, 6), bool))
    yield from (np.ones((1, 1, 1), bool), np.zeros((1, 1, 1), bool), np.ones((1, 5, 2), bool))
    for at in itertools.product((0, 3, 5), repeat=3):
        single = np.zeros((6, 6, 6), bool)
        single[at] = True
        yield from (single, ~single)
    for other in itertools.product((-1, 0, 1), repeat=3):  # contacts: face, edge, corner
        pair = np.zeros((6, 6, 6), bool)
        pair[2, 2, 2] = pair[2 + other[0], 2 + other[1], 2 + other[2]] = True
        yield from (pair, ~pair)
    random = np.random.default_rng(20)
    for number in range(1000 - 7 - 2 * 27 - 2 * 27):
        shape = (6, 6, 6) if number % 2 else tuple(random.integers(1, 8, size=3))
        yield random.random(shape) < random.choice([0.05, 0.2, 0.35, 0.5, 0.65, 0.8, 0.95])


def test_a_thousand_grids_are_closed_oriented_and_of_the_right_euler_number() -> None:
    count = 0
    for solid in solids():
        check(solid, extract(grid_of(solid), reader(solid)))
        count += 1
    assert count == 1000


def canonical(points: NDArray[Any]) -> list[Any]:
    """Triangles as a sorted list, each from its lowest vertex on; *points* is (m, 3, 3)."""
    rows = [[tuple(point) for point in triangle] for triangle in points.tolist()]
    turned = ([row[(row.index(min(row)) + n) % 3] for n in range(3)] for row in rows)
    return sorted(turned)


@st.composite
def cut_solids(draw: st.DrawFn) -> tuple[Solid, NDArray[np.uint8], Shape, int]:
    """A solid, the states of its cells, some of them needlessly "may differ", and a block."""
    shape = draw(st.tuples(*[st.integers(1, 9)] * 3))
    cell = draw(st.tuples(*[st.integers(1, 4)] * 3))
    # Whole cells in or out, and some voxels changed: so that uniform cells exist, and meet.
    counts = tuple(-(-count // width) for count, width in zip(shape, cell[::-1], strict=True))
    solid = draw(hnp.arrays(np.bool_, counts))
    for axis, width in enumerate(cell[::-1]):
        solid = solid.repeat(width, axis=axis)
    solid = solid[: shape[0], : shape[1], : shape[2]].copy()
    for at in draw(st.lists(st.integers(0, solid.size - 1), max_size=4)):
        solid.flat[at] ^= True
    uniform = states(solid, cell)
    for at in draw(st.lists(st.integers(0, uniform.size - 1), max_size=3)):
        uniform.flat[at] = 2
    return solid, uniform, cell, draw(st.integers(1, 11))


@given(cut_solids())
@settings(max_examples=200, deadline=None)
def test_blocks_and_skipped_cells_do_not_show(
    case: tuple[Solid, NDArray[np.uint8], Shape, int],
) -> None:
    """The same bytes as from one block, and the same triangles as scikit-image's own."""
    solid, uniform, cell, block = case
    grid = grid_of(solid)
    vertices, faces = extract(grid, reader(solid), uniform, cell, block=block)
    whole = extract(grid, reader(solid), block=100)
    assert np.array_equal(vertices, whole[0])
    assert np.array_equal(faces, whole[1])
    assert faces.dtype == whole[1].dtype == np.int64
    expected: list[Any] = []
    if solid.any():
        padded = np.pad(solid, 1).astype(np.float32)
        there, them, _, _ = marching_cubes(padded, LEVEL)  # type: ignore[no-untyped-call]
        # Twice the place, in samples of the padded array; sample p is at (p - 1/2) voxels.
        expected = canonical((np.rint(2 * there[:, ::-1]) / 2 - 0.5)[them])
    assert canonical(vertices[faces]) == expected


@pytest.mark.parametrize(("cubes", "places"), [(1, 1), (7, 20), (1 << 14, 1)])
def test_runs_of_cubes_do_not_show(
    monkeypatch: pytest.MonkeyPatch, cubes: int, places: int
) -> None:
    """However few cubes, over however few places, are worked on at a time."""
    solid = np.random.default_rng(5).random((9, 8, 7)) < 0.4
    solid[5] = True
    whole = extract(grid_of(solid), reader(solid))
    monkeypatch.setattr(_cubes, "_CUBES", cubes)
    monkeypatch.setattr(_cubes, "_PLACES", places)
    runs = extract(grid_of(solid), reader(solid))
    assert np.array_equal(runs[0], whole[0])
    assert np.array_equal(runs[1], whole[1])


def test_the_numbering_is_sorted() -> None:
    """By the lower of the two voxels that a vertex lies between, then by the axis."""
    solid = np.random.default_rng(3).random((9, 8, 7)) < 0.5
    vertices, _ = extract(grid_of(solid), reader(solid), block=3)
    whole = vertices == np.floor(vertices)  # half-way between centres, at n + 1/2
    assert (whole.sum(axis=1) == 1).all()
    axis = np.argmax(whole, axis=1)
    x, y, z = (vertices - 0.5 * whole).T
    assert np.array_equal(np.lexsort((axis, x, y, z)), np.arange(len(vertices)))
    assert len(np.unique(vertices, axis=0)) == len(vertices)


def test_a_voxel_becomes_an_octahedron_in_its_place() -> None:
    solid = np.zeros((4, 3, 5), dtype=np.uint8)
    solid[3, 0, 2] = 7  # whatever is not zero is inside
    grid = Grid((10, -20, 30), (1, 2, 4), (5, 3, 4))
    vertices, faces = extract(grid, reader(solid))
    center = np.array([12.5, -19, 44])
    axes = np.array([[0, 0, 2], [0, 1, 0], [0.5, 0, 0]])
    assert np.array_equal(vertices, center + np.vstack([-axes, axes[::-1]]))
    assert faces.shape == (8, 3)
    assert signed_volume((vertices, faces)) == pytest.approx(8 / 6)


def test_a_full_grid_becomes_its_box() -> None:
    grid = Grid((-1, 2, 3), (0.5, 0.25, 1), (6, 9, 3))
    vertices, faces = extract(grid, reader(np.ones((3, 9, 6), bool)), block=4)
    assert np.array_equal([vertices.min(axis=0), vertices.max(axis=0)], grid.bounds)
    volume = signed_volume((vertices, faces))
    assert 0.8 * grid.size * grid.voxel_volume < volume < grid.size * grid.voxel_volume


def test_an_empty_solid_has_an_empty_surface() -> None:
    vertices, faces = extract(Grid((0, 0, 0), 1, (5, 6, 7)), reader(np.zeros((7, 6, 5), bool)))
    assert vertices.shape == (0, 3)
    assert vertices.dtype == np.float64
    assert faces.shape == (0, 3)
    assert faces.dtype == np.int64


class Ball:
    """A ball in a grid of n voxels each way, that notes what is read of it."""

    def __init__(self, count: int, radius: float) -> None:
        self.grid = Grid((-count / 2,) * 3, 1, (count,) * 3)
        self.radius = radius
        middles = np.arange(4, count, 8) - count / 2
        away = np.sqrt(middles[:, None, None] ** 2 + middles[:, None] ** 2 + middles**2)
        # No voxel centre of a cell is further from its middle than half its diagonal.
        self.uniform = np.where(away < radius, 1, 0).astype(np.uint8)
        self.uniform[np.abs(away - radius) < 7] = 2
        self.boxes: list[Shape] = []

    def read(self, start: Shape, stop: Shape) -> Solid:
        centers = (
            np.arange(low, high) + (0.5 - self.grid.shape[0] / 2)
            for low, high in zip(start, stop, strict=True)
        )
        x, y, z = (at.astype(np.float32) ** 2 for at in centers)
        solid: Solid = z[:, None, None] + y[:, None] + x < self.radius**2
        self.boxes.append(solid.shape)
        return solid


def test_a_ball_is_a_sphere_and_little_of_it_is_read() -> None:
    ball = Ball(128, 50)
    seen: list[tuple[int, int]] = []
    mesh = extract(
        ball.grid,
        ball.read,
        ball.uniform,
        (8, 8, 8),
        block=16,
        progress=lambda done, total: seen.append((done, total)),
    )
    check(ball.read((0, 0, 0), (128, 128, 128)), mesh)
    assert signed_volume(mesh) == pytest.approx(4 / 3 * np.pi * 50**3, rel=0.002)
    boxes = np.array(ball.boxes[:-1])
    assert boxes.max() <= 17
    # The blocks that the surface runs through are about 310 of 512.
    assert boxes.prod(axis=1).sum() < 0.5 * 128**3
    assert seen == [(done, 512) for done in range(1, 513)]


def test_of_a_block_only_the_cells_in_question_are_read() -> None:
    solid = np.zeros((32, 32, 32), bool)
    solid[13, 9, 23] = True
    boxes: list[tuple[Shape, Shape]] = []

    def read(start: Shape, stop: Shape) -> Solid:
        boxes.append((start, stop))
        return solid[start[2] : stop[2], start[1] : stop[1], start[0] : stop[0]]

    check(solid, extract(grid_of(solid), read, states(solid, (8, 8, 4)), (8, 8, 4)))
    # The cell of the voxel, and one voxel more all around.
    assert boxes == [((15, 7, 11), (25, 17, 17))]


def test_peak_memory_is_below_a_tenth_of_the_dense_grid() -> None:
    ball = Ball(512, 150)
    tracemalloc.start()
    try:
        mesh = extract(ball.grid, ball.read, ball.uniform, (8, 8, 8))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert len(mesh[0]) > 400_000
    assert peak < 512**3 * 4 / 10


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"block": 0}, "block=0"),
        ({"cell": (8, 0, 8)}, r"cell=\(8, 0, 8\)"),
        ({"uniform": np.zeros((2, 2, 2), np.uint8), "cell": (2, 2, 2)}, r"\(3, 2, 2\)"),
    ],
)
def test_what_does_not_fit_is_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(GridError, match=words):
        extract(Grid((0, 0, 0), 1, (4, 4, 5)), reader(np.zeros((5, 4, 4), bool)), **options)


def test_a_read_of_the_wrong_shape_is_refused() -> None:
    with pytest.raises(GridError, match=r"must return the shape \(5, 4, 3\)"):
        extract(Grid((0, 0, 0), 1, (3, 4, 5)), lambda _start, _stop: np.zeros((3, 4, 5), bool))


def test_far_and_wide_grids_need_no_memory() -> None:
    """Of a layer of 1.7e10 cubes only those that are listed take room."""
    grid = Grid((0, 0, 0), 1, (131_000, 131_000, 2))
    region = _cubes.Region.of(((0, 131_001), (0, 131_001), (0, 3)))
    # The cube c lies between voxels c - 1 and c: one voxel is in eight of them.
    z, y, x = (part.ravel() for part in np.indices((2, 2, 2)))
    cases = (1 << (7 - (4 * z + 2 * y + x))).astype(np.uint8)
    keys = region.keys(z, y + 130_000, x + 120_000, cases)
    tracemalloc.start()
    vertices, faces = _cubes.march(grid, region, np.sort(keys))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 10 << 20
    assert faces.shape == (8, 3)
    assert np.array_equal(vertices.mean(axis=0), (120_000.5, 130_000.5, 0.5))
    assert signed_volume((vertices, faces)) == pytest.approx(1 / 6)
