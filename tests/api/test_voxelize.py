"""What must be true of voxels and crossings, whatever the kernels do inside.

Nothing here knows the twins: two programs may share a mistake, a property does not.
"""

from __future__ import annotations

import gc
import itertools
import math
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
import pytest
import trimesh
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray

import clvox
from clvox.device import Session
from clvox.errors import DeviceError, GridError, MeshError, NotClosedError
from clvox.grid import Axis, Grid, Lattice, Shape
from clvox.mesh import check
from clvox.models import levels as levels_module
from tests.strategies import BOX, FAMILIES, Mesh, closed_meshes, join

Points: TypeAlias = NDArray[np.float64]
Solid: TypeAlias = tuple[Points, NDArray[np.int32]]

BITS = 8
SHAPE = (9, 8, 7)
GRID = Grid((0, 0, 0), 1, SHAPE)
"""The grid of the meshes from tests.strategies, with voxels one unit wide."""


def world(mesh: Mesh) -> Solid:
    """A mesh on the lattice of `GRID`, in units: no number is rounded.

    A box beyond the grid joins it, so that no mesh is flat or empty.
    """
    corners = np.array([[i & 1, i >> 1 & 1, i >> 2] for i in range(8)]) - 3
    vertices, faces = join([mesh, (corners << BITS, BOX)])
    return vertices / 2.0**BITS + 0.5, faces


# Not "wide", whose meshes span all of the lattice: with a voxel beside them they span more.
solids = closed_meshes(BITS, SHAPE, [name for name in FAMILIES if name != "wide"]).map(world)


def voxels(mesh: Any, grid: Grid = GRID, **options: Any) -> NDArray[np.bool_]:
    """The voxels of a mesh as an array, on the lattice of `GRID`."""
    model = clvox.voxelize(mesh, grid=grid, lattice_bits=options.pop("bits", BITS), **options)
    assert model.report.odd_rays == 0
    array = model.to_array()
    assert array.shape == grid.array_shape
    assert model.count == array.sum()
    return array


def centers(grid: Grid) -> Points:
    """The centres of all voxels, in the order of an array's ravel()."""
    k, j, i = np.indices(grid.array_shape).reshape(3, -1)
    return grid.centers(np.stack([i, j, k], axis=1))


def box(low: Any, high: Any) -> trimesh.Trimesh:
    found: trimesh.Trimesh = trimesh.creation.box(bounds=[low, high])
    return found


def ball(radius: float = 1.0, fineness: int = 3, center: Any = (0, 0, 0)) -> trimesh.Trimesh:
    found: trimesh.Trimesh = trimesh.creation.icosphere(subdivisions=fineness, radius=radius)
    found.apply_translation(center)
    return found


# --- the right voxels ---------------------------------------------------------------------------

halves = st.integers(-4, 22).map(lambda k: k / 2) | st.integers(-1024, 2560).map(lambda k: k / 256)


@given(ends=st.tuples(*[st.tuples(halves, halves).filter(lambda e: e[0] != e[1])] * 3))
def test_a_box_holds_the_centres_between_its_faces(ends: Any) -> None:
    """And of those on its faces the ones on the lower: the sample lies a little further up."""
    low, high = np.sort(np.array(ends), axis=1).T
    where = centers(GRID)
    expected = ((low <= where) & (where < high)).all(axis=1).reshape(GRID.array_shape)
    assert np.array_equal(voxels(box(low, high)), expected)


@pytest.mark.parametrize(
    ("mesh", "inside"),
    [
        (ball(9.0), lambda p: 9.0 - np.linalg.norm(p, axis=1)),
        (
            trimesh.creation.cylinder(6.0, 11.0, sections=96),
            lambda p: np.minimum(6.0 - np.hypot(p[:, 0], p[:, 1]), 5.5 - abs(p[:, 2])),
        ),
        (
            trimesh.creation.torus(7.0, 3.0, major_sections=96, minor_sections=64),
            lambda p: 3.0 - np.hypot(np.hypot(p[:, 0], p[:, 1]) - 7.0, p[:, 2]),
        ),
        (
            trimesh.util.concatenate([ball(9.0), ball(4.0)]),
            lambda p: np.minimum(9.0 - np.linalg.norm(p, axis=1), np.linalg.norm(p, axis=1) - 4.0),
        ),
    ],
    ids=["ball", "cylinder", "torus", "hollow ball"],
)
@pytest.mark.parametrize("spacing", [(0.25, 0.25, 0.25), (0.25, 0.5, 0.3), (1.5, 0.2, 0.7)])
def test_solids_with_a_formula(
    mesh: trimesh.Trimesh, inside: Callable[[Points], Points], spacing: Any
) -> None:
    """Centres deeper or further off than the facets' error and a lattice step are no question."""
    grid = Grid.fit(mesh, pitch=spacing)
    model = clvox.voxelize(mesh, grid=grid)
    depth = inside(centers(grid)).reshape(grid.array_shape)
    found = model.to_array()
    facets = 0.08
    assert found[depth > facets].all()
    assert not found[depth < -facets].any()
    low, high = model.volume_bounds
    enclosed = float(mesh.volume) if mesh.body_count == 1 else float(ball(9.0).volume)
    if mesh.body_count == 2:
        enclosed -= float(ball(4.0).volume)
    assert low <= enclosed <= high
    assert low < model.volume < high
    assert model.volume == pytest.approx(enclosed, rel=0.05)


@pytest.mark.parametrize("resolution", [16, 64, 256])
def test_a_box_that_fits_is_full(resolution: int) -> None:
    model = clvox.voxelize(box((-1, -2, -4), (1, 2, 4)), resolution=resolution)
    assert model.count == model.grid.size
    assert model.volume == pytest.approx(64)
    assert (model.grid.array_shape[0], model.levels[1]) == (resolution, (8, 8, 8))


# --- what changes nothing -----------------------------------------------------------------------


@given(mesh=solids, steps=st.tuples(*[st.integers(-(2**20), 2**20)] * 3))
def test_moving_mesh_and_grid_together_changes_nothing(
    mesh: Solid, steps: tuple[int, int, int]
) -> None:
    """By whole steps of the lattice, which float64 does not round."""
    move = np.array(steps) / 2.0**BITS
    moved = Grid(np.array(GRID.origin) + move, GRID.spacing, SHAPE)
    assert np.array_equal(voxels((mesh[0] + move, mesh[1]), moved), voxels(mesh))


@given(mesh=solids, seed=st.integers(0, 2**32))
def test_the_order_of_triangles_and_vertices_changes_nothing(mesh: Solid, seed: int) -> None:
    """Nor the corner that a triangle begins with, nor all of them turned inside out."""
    vertices, faces = mesh
    rng = np.random.default_rng(seed)
    places = rng.permutation(len(vertices))
    numbers = np.argsort(places)
    shuffled = numbers[np.roll(faces, rng.integers(3), axis=1)][rng.permutation(len(faces))]
    expected = voxels(mesh)
    assert np.array_equal(voxels((vertices, faces[::-1])), expected)
    assert np.array_equal(voxels((vertices[places], shuffled)), expected)
    assert np.array_equal(voxels((vertices, faces[:, ::-1])), expected)


@given(mesh=solids)
def test_unwelded_triangles_change_nothing(mesh: Solid) -> None:
    """Each triangle on vertices of its own, as in an STL file."""
    vertices, faces = mesh
    loose = np.arange(faces.size).reshape(-1, 3)
    assert np.array_equal(voxels((vertices[faces.ravel()], loose)), voxels(mesh))


@given(one=solids, other=solids)
def test_two_meshes_as_one_are_in_where_one_of_them_is(one: Solid, other: Solid) -> None:
    """Parity: where both are, neither is."""
    vertices = np.concatenate([one[0], other[0]])
    joined = vertices, np.concatenate([one[1], other[1] + np.int32(len(one[0]))])
    # Of a triangle that both have, one copy is kept: then parity is not that of both.
    kept = [len(check(mesh).faces) for mesh in (one, other, joined)]
    assume(kept[2] == kept[0] + kept[1] - len(BOX))
    assert np.array_equal(voxels(joined), voxels(one) ^ voxels(other))


@given(cut=st.integers(-2, 18), sides=st.tuples(*[st.integers(1, 16)] * 3), axis=st.integers(0, 2))
def test_boxes_that_touch_or_lie_apart_unite(cut: int, sides: Any, axis: int) -> None:
    """No voxel is lost or taken twice where they share a face."""
    low, high = np.array([1.0, 0.5, -1.0]), np.array([1.0, 0.5, -1.0]) + np.array(sides) / 2
    start = cut / 2
    first, second = high.copy(), low.copy()
    low[axis], first[axis], second[axis], high[axis] = start - 2, start, start, start + 3
    one, other, whole = box(low, first), box(second, high), box(low, high)
    together = trimesh.util.concatenate([one, other])
    assert np.array_equal(voxels(together), voxels(one) | voxels(other))
    assert np.array_equal(voxels(together), voxels(whole))
    assert not (voxels(one) & voxels(other)).any()


@pytest.mark.parametrize("order", [(1, 2, 0), (2, 0, 1), (0, 2, 1), (2, 1, 0)])
def test_the_axes_are_alike(order: tuple[int, int, int]) -> None:
    """Where no centre lies on the surface, a mesh with its axes exchanged has such voxels."""
    mesh = ball(5.0, 2, (0.1234567, 0.2345678, 0.3456789))
    mesh.vertices *= (1.0, 0.8, 1.3)
    grid = Grid((-5, -6, -7), (0.5, 0.4, 0.6), (23, 31, 25))
    turned = Grid(
        *(np.array(values)[list(order)] for values in (grid.origin, grid.spacing, grid.shape))
    )
    faces = mesh.faces
    expected = voxels((mesh.vertices, faces), grid, bits=14)
    found = voxels((mesh.vertices[:, order], faces), turned, bits=14)
    back = [2 - order.index(2 - axis) for axis in range(3)]
    assert np.array_equal(found.transpose(back), expected)
    assert 0 < expected.sum() < expected.size


@pytest.mark.parametrize("scale", [2.0**-20, 2.0**20, 1.0])
@pytest.mark.parametrize("offset", [0.0, 2.0**20, -(2.0**20)])
def test_far_away_and_tiny(scale: float, offset: float) -> None:
    """A mesh of binary fractions and its grid, moved and scaled so that nothing is rounded."""
    mesh = ball(7.0, 2)
    vertices = np.rint(mesh.vertices * 1024) / 1024
    grid = Grid((-8, -8, -8), 0.5, (33, 32, 31))
    far = Grid((np.array(grid.origin) + offset) * scale, 0.5 * scale, grid.shape)
    assert np.array_equal(
        voxels(((vertices + offset) * scale, mesh.faces), far),
        voxels((vertices, mesh.faces), grid),
    )


@pytest.mark.parametrize(("scale", "offset"), [(1e-6, 0.0), (1.0, 1e6), (1e6, 1e6), (1e-6, 1.0)])
def test_far_away_and_tiny_in_tenths(scale: float, offset: float) -> None:
    """The volume is right within what float64 leaves of the mesh."""
    mesh = ball(7.0)
    mesh.vertices *= scale
    volume = float(mesh.volume)
    mesh.apply_translation((offset, -offset, offset))
    model = clvox.voxelize(mesh, resolution=48)
    low, high = model.volume_bounds
    assert low < volume < high
    assert model.volume == pytest.approx(volume, rel=0.02)


# --- grids --------------------------------------------------------------------------------------


@given(
    mesh=solids,
    first=st.tuples(*[st.integers(-12, 10)] * 3),
    shape=st.tuples(*[st.integers(1, 20)] * 3),
)
def test_a_grid_cut_out_of_a_larger_one_has_its_voxels(
    mesh: Solid, first: Shape, shape: Shape
) -> None:
    """Smaller than the mesh, beside it, inside it, or reaching beyond: each voxel is the same."""
    outer = Grid((-12, -12, -12), 1, (42, 42, 42))
    (i, j, k), (nx, ny, nz) = np.array(first) + 12, shape
    expected = voxels(mesh, outer)[k : k + nz, j : j + ny, i : i + nx]
    assert np.array_equal(voxels(mesh, Grid(first, 1, shape)), expected)


@pytest.mark.parametrize("levels", [None, "dense"])
@pytest.mark.parametrize(
    ("origin", "shape", "expected"),
    [
        ((-1, -1, -1), (8, 8, 8), True),
        ((-1.5, -1, -1), (1, 1, 1), True),
        ((-1, -1, -1), (33, 17, 5), True),
        ((40, 0, 0), (9, 9, 9), False),
        ((0, -40, 0), (9, 9, 9), False),
        ((0, 0, 40), (9, 9, 9), False),
        ((0, 40, 0), (9, 9, 9), False),
        ((-40, 30, -40), (70, 3, 70), False),
    ],
)
def test_a_grid_wholly_inside_is_full_and_one_beside_is_empty(
    origin: Any, shape: Shape, expected: bool, levels: Any
) -> None:
    """Also at the ends of its rays, which begin or end inside the mesh."""
    model = clvox.voxelize(ball(20.0), grid=Grid(origin, 0.125, shape), levels=levels and [shape])
    assert (model.to_array() == expected).all()
    assert model.count == (model.grid.size if expected else 0)
    assert model.volume_bounds[0] <= model.volume <= model.volume_bounds[1]
    if levels is None:
        assert (model.to_array(level=0) == expected).all()


@given(
    mesh=solids,
    brick=st.sampled_from([(8, 8, 8), (1, 1, 1), (3, 5, 2), (4, 6, 10), (9, 1, 7), (33, 2, 1)]),
    shape=st.tuples(*[st.integers(1, 18)] * 3),
)
def test_two_levels_have_the_voxels_of_one(mesh: Solid, brick: Shape, shape: Shape) -> None:
    """Whatever the bricks, and whether or not they fill the grid exactly."""
    grid = Grid((-3, -2, -1), 1, shape)
    cells = [-(-n // b) for n, b in zip(shape, brick, strict=True)]
    dense = voxels(mesh, grid, levels=[shape])
    assert np.array_equal(voxels(mesh, grid, levels=[cells, brick]), dense)
    assert np.array_equal(voxels(mesh, grid), dense)


@pytest.mark.parametrize("brick", [(8, 8, 8), (64, 64, 64), (4, 6, 10), (20, 1, 33), (1, 1, 1)])
def test_two_levels_have_the_voxels_of_one_on_a_large_mesh(brick: Shape) -> None:
    mesh = trimesh.creation.torus(7.0, 3.0)
    grid = Grid.fit(mesh, resolution=101)
    cells = [-(-n // b) for n, b in zip(grid.shape, brick, strict=True)]
    dense = clvox.voxelize(mesh, grid=grid, levels=[grid.shape])
    model = clvox.voxelize(mesh, grid=grid, levels=[cells, brick])
    assert model.levels == (tuple(cells), brick)
    assert dense.levels == (grid.shape,)
    assert np.array_equal(model.to_array(), dense.to_array())
    assert model == dense
    assert model.volume_bounds == dense.volume_bounds


def test_levels_alone_fill_the_bounding_box() -> None:
    """Cells and bricks as in the thesis: the voxels take the proportions of the mesh."""
    mesh = box((1, 2, 3), (5, 4, 9))
    model = clvox.voxelize(mesh, levels=[(4, 5, 6), (4, 6, 10)])
    assert model.grid.shape == (16, 30, 60)
    assert np.array_equal(model.grid.bounds, mesh.bounds)
    assert model.count == 16 * 30 * 60


def test_a_single_voxel() -> None:
    mesh = box((0, 0, 0), (1, 1, 1))
    for levels in (None, [(1, 1, 1)], [(1, 1, 1), (1, 1, 1)]):
        grid = Grid((0, 0, 0), 1, (1, 1, 1))
        assert clvox.voxelize(mesh, grid=grid, levels=levels).to_array().tolist() == [[[True]]]


def test_a_level_between_where_there_would_be_too_many_cells() -> None:
    model = clvox.voxelize(box((0, 0, 0), (1, 1, 1)), grid=Grid((2, 2, 2), 1, (8192, 8192, 8)))
    assert model.levels == ((1024, 1024, 1), (8, 8, 8))
    flat = Grid((2, 2, 2), 1, (2**15, 2**15, 65))
    model = clvox.voxelize(box((0, 0, 0), (1, 1, 1)), grid=flat)
    assert model.levels == ((1024, 1024, 3), (8, 8, 8), (4, 4, 4))
    assert model.count == 0


def test_default_levels_of_three_need_few_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    """At most a quarter more than the best of many choices, at a size that a test can do."""
    ball = trimesh.creation.icosphere(subdivisions=4)
    monkeypatch.setattr(levels_module, "MOST_CELLS", 1 << 13)
    grid = Grid.fit(ball, resolution=384)
    sides = itertools.product((4, 8, 12, 16), (4, 6, 8, 12))
    choices = [((math.ceil(384 / (a * b)),) * 3, (a,) * 3, (b,) * 3) for a, b in sides]
    best = min(clvox.voxelize(ball, grid=grid, levels=levels).nbytes for levels in choices)
    model = clvox.voxelize(ball, grid=grid)
    assert model.levels[1:] == ((8, 8, 8), (4, 4, 4))
    assert model.nbytes <= 1.25 * best


# --- crossings ----------------------------------------------------------------------------------


@given(mesh=solids, axis=st.sampled_from(["x", "y", "z"]))
def test_every_ray_crosses_a_closed_mesh_an_even_number_of_times(mesh: Solid, axis: Axis) -> None:
    """Along each axis, through whatever vertices, edges and flat triangles it runs."""
    counts = clvox.count_crossings(mesh, grid=GRID, axis=axis, lattice_bits=BITS)
    shape = [n for n, name in zip(GRID.array_shape, "zyx", strict=True) if name != axis]
    assert counts.shape == tuple(shape)
    assert counts.dtype == np.uint32
    assert not (counts % 2).any()


@pytest.mark.parametrize(("axis", "along"), [("x", 2), ("y", 1), ("z", 0)])
def test_a_convex_solid_is_crossed_twice_where_it_is_met(axis: Axis, along: int) -> None:
    mesh = ball(5.0, 3, (0.01, 0.02, 0.03))
    grid = Grid.fit(mesh, pitch=(0.3, 0.4, 0.5))
    counts = clvox.count_crossings(mesh, grid=grid, axis=axis)
    met = clvox.voxelize(mesh, grid=grid).to_array().any(axis=along)
    assert set(np.unique(counts)) == {0, 2}
    # A ray may pass between two centres without holding either.
    assert (counts[met] == 2).all()
    assert (counts == 2).mean() == pytest.approx(math.pi / 4, abs=0.05)


def test_an_open_mesh_has_crossings_but_no_voxels() -> None:
    mesh = box((0, 0, 0), (4, 4, 4))
    mesh.update_faces(mesh.face_normals[:, 1] < 0.5)
    grid = Grid((0, 0, 0), 1, (4, 5, 6))
    assert (clvox.count_crossings(mesh, grid=grid)[:4] == 1).all()
    assert (clvox.count_crossings(mesh, grid=grid)[4:] == 0).all()
    with pytest.raises(NotClosedError, match="4 edges belong to one triangle only") as caught:
        clvox.voxelize(mesh, grid=grid)
    assert "fill_holes" in str(caught.value)


# --- what is refused ----------------------------------------------------------------------------

TETRAHEDRON = np.eye(4, 3), np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])


@pytest.mark.parametrize(
    ("mesh", "words"),
    [
        (([[0, 0, 0], [1, 0, np.nan], [0, 1, 0]], [[0, 1, 2]]), r"vertex 1 is \(1.0, 0.0, nan\)"),
        ((TETRAHEDRON[0], np.zeros((0, 3), int)), "no triangles"),
        ((TETRAHEDRON[0] * [1, 1, 0], TETRAHEDRON[1]), "flat"),
        ((TETRAHEDRON[0], TETRAHEDRON[1][:3]), "open"),
        ((TETRAHEDRON[0], TETRAHEDRON[1] + 1), "vertex"),
        (7, "must be a trimesh.Trimesh, a path, or"),
    ],
)
def test_meshes_that_are_refused(mesh: Any, words: str) -> None:
    with pytest.raises(MeshError, match=words):
        clvox.voxelize(mesh, grid=GRID)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({}, "give one of resolution="),
        ({"resolution": 4, "pitch": 1}, "give one of resolution="),
        ({"resolution": 4, "grid": GRID}, "give one of resolution="),
        ({"pitch": 1, "grid": GRID}, "give one of resolution="),
        ({"resolution": 0}, "resolution must be between 1 and 131071, got 0"),
        ({"resolution": 2.5}, "resolution must be an integer, got"),
        ({"resolution": 2**17}, "resolution must be between"),
        ({"resolution": "many"}, "resolution must be an integer"),
        ({"pitch": -0.5}, "pitch must be positive, got -0.5"),
        ({"pitch": 0}, "pitch must be positive, got 0"),
        ({"pitch": (1, 2)}, "pitch must be three finite numbers"),
        ({"pitch": np.nan}, "pitch must be three finite numbers"),
        ({"pitch": 1e-9}, "cuts an extent of 1 into 1e.09 voxels"),
        ({"grid": GRID, "levels": []}, "one to three levels, got 0|triples of integers"),
        ({"grid": GRID, "levels": [(1, 1, 1)] * 4}, "one to three levels, got 4"),
        ({"grid": GRID, "levels": [(9, 8)]}, "triples of integers"),
        ({"grid": GRID, "levels": [(9, 8, 7.5)]}, "triples of integers"),
        ({"grid": GRID, "levels": [(9, 8, 6)]}, r"the grid's shape \(9, 8, 7\), got"),
        ({"grid": GRID, "levels": [(2, 1, 1), (8, 8, 0)]}, "levels must be positive"),
        ({"grid": GRID, "levels": [(1, 1, 1), (65, 8, 8)]}, "1 to 64 cells or voxels a side"),
        ({"grid": GRID, "levels": [(1, 1, 1), (8, 8, 8)]}, r"has \(2, 1, 1\) coarse cells"),
        ({"grid": GRID, "levels": 5}, "triples of integers"),
        ({"grid": GRID, "lattice_bits": 6}, "lattice_bits must be from 7 to 14, got 6"),
        ({"grid": GRID, "lattice_bits": 15}, "lattice_bits must be from 7 to 14, got 15"),
        ({"grid": GRID, "lattice_bits": 8.5}, "lattice_bits must be an integer"),
        ({"grid": Grid((2e5, 0, 0), 1, SHAPE)}, "together span 200009 voxels"),
        ({"grid": Grid((3e4, 0, 0), 1, SHAPE), "lattice_bits": 12}, "leaves no room for a span"),
    ],
)
def test_numbers_that_are_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(GridError, match=words):
        clvox.voxelize(TETRAHEDRON, **options)


def test_an_axis_and_a_device_that_there_are_not() -> None:
    with pytest.raises(GridError, match="axis must be 'x', 'y' or 'z', got 'w'"):
        clvox.count_crossings(TETRAHEDRON, grid=GRID, axis="w")  # type: ignore[arg-type]
    with pytest.raises(DeviceError, match="no OpenCL device matches 'abacus'; devices here: 0: "):
        clvox.voxelize(TETRAHEDRON, grid=GRID, device="abacus")
    with pytest.raises(DeviceError, match="no OpenCL device matches 99"):
        clvox.count_crossings(TETRAHEDRON, grid=GRID, device=99)


def test_a_lattice_may_be_coarser_than_it_need_be() -> None:
    """Far from the grid only as many bits as fit are taken, and the report says how many."""
    for distance, bits in [(0, 14), (1200, 13), (10000, 10), (100000, 7)]:
        grid = Grid((-distance - 9, 0, 0), 1, SHAPE)
        assert clvox.voxelize(TETRAHEDRON, grid=grid).report.lattice_bits == bits
    grid = Grid((0, 0, 0), 0.125, (8, 8, 8))
    assert clvox.voxelize(TETRAHEDRON, grid=grid, lattice_bits=7).report.lattice_bits == 7


# --- how it goes --------------------------------------------------------------------------------


def test_the_report_says_what_was_done(session: Session) -> None:
    """Triangles that were dropped, those without area on the lattice, and where it was done."""
    vertices, faces = TETRAHEDRON
    tiny = vertices * 1e-6 + 3
    mesh = (
        np.concatenate([vertices * 5, tiny]),
        np.concatenate([faces, faces[:1], [[0, 1, 4], [4, 1, 0], [0, 0, 1]], faces + 4]),
    )
    report = clvox.voxelize(mesh, grid=GRID).report
    assert report.device == str(session.device)
    assert {"snap", "upload", "mark", "rank", "clear", "flip", "carry"} == set(report.seconds)
    assert all(seconds >= 0 for seconds in report.seconds.values())
    assert (report.triangles, report.repeated, report.odd_rays) == (8, 1, 0)
    assert (report.duplicates, report.cancelled, report.collapsed) == (1, 2, 4)
    assert report.lattice_bits == 14
    assert report.peak_nbytes > 0
    assert any("a vertex number twice" in warning for warning in report.warnings)
    flat = clvox.voxelize(mesh, grid=GRID, levels=[SHAPE]).report
    assert {"snap", "upload", "clear", "flip", "carry"} == set(flat.seconds)


@pytest.mark.parametrize("levels", [None, [(40, 40, 40)]])
def test_progress_goes_up_to_the_end(levels: Any) -> None:
    told: list[tuple[int, int]] = []
    mesh = ball(5.0, 4)
    grid = Grid((-5, -5, -5), 0.25, (40, 40, 40))
    clvox.voxelize(mesh, grid=grid, levels=levels, progress=lambda *now: told.append(now))
    done, totals = zip(*told, strict=True)
    assert len(set(totals)) == 1
    assert list(done) == sorted(done)
    assert done[-1] == totals[0]


def test_progress_as_a_bar(capsys: pytest.CaptureFixture[str]) -> None:
    clvox.voxelize(TETRAHEDRON, grid=GRID, progress=True)
    assert "100%" in capsys.readouterr().err
    clvox.voxelize(TETRAHEDRON, grid=GRID, progress=False)
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("after", [1, 2])
def test_an_exception_from_progress_ends_the_work(session: Session, after: int) -> None:
    """It arrives as it is, and the device works on as if nothing had been."""
    mesh = ball(5.0, 4)
    expected = clvox.voxelize(mesh, resolution=40).to_array()
    gc.collect()
    before = session.nbytes
    left = [after]

    def stop(done: int, total: int) -> None:
        assert 0 <= done <= total
        left[0] -= 1
        if not left[0]:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        clvox.voxelize(mesh, resolution=40, progress=stop)
    gc.collect()
    assert session.nbytes == before
    assert np.array_equal(clvox.voxelize(mesh, resolution=40).to_array(), expected)


def test_a_second_time_builds_and_allocates_nothing(session: Session) -> None:
    """On the same grid, once the first model is gone; and beside it no more than its arrays."""
    mesh = ball(5.0, 4)
    grid = Grid.fit(mesh, resolution=100)
    first = clvox.voxelize(mesh, grid=grid)
    del first
    gc.collect()
    builds, blocks, nbytes = session.builds, session.blocks, session.nbytes
    second = clvox.voxelize(mesh, grid=grid)
    assert (session.builds, session.blocks) == (builds, blocks)
    held = session.nbytes - nbytes
    third = clvox.voxelize(mesh, grid=grid)
    assert session.builds == builds
    assert session.blocks <= blocks + 4
    assert session.nbytes - nbytes == 2 * held
    assert second == third


@pytest.mark.parametrize("resolution", [1024, 2048])
def test_memory_goes_with_the_surface(session: Session, resolution: int) -> None:
    """Far below a bit per voxel, and four times as much at twice the resolution, not eight."""
    mesh = ball(1.0, 4)
    coarse = clvox.voxelize(mesh, resolution=resolution // 2).report.peak_nbytes
    gc.collect()
    session.free()
    model = clvox.voxelize(mesh, resolution=resolution)
    dense = resolution**3 / 8
    peak = model.report.peak_nbytes
    assert model.nbytes <= peak < dense / 6
    assert peak < 5.5 * coarse
    assert model.volume == pytest.approx(float(mesh.volume), rel=1e-4)


def test_the_longest_grid_has_a_lattice() -> None:
    """And a grid that none would fit is refused at once."""
    grid = clvox.Grid((0, 0, 0), 1.0, (131_071, 1, 1))
    assert Lattice.fit(grid, np.array([[0.0, 0.0, 0.0], [131_071.0, 1.0, 1.0]])).bits == 7
    with pytest.raises(clvox.GridError, match="between 1 and 131071 voxels"):
        clvox.Grid((0, 0, 0), 1.0, (131_072, 1, 1))
