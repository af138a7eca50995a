"""The two levels built on the device are the twin's, bit for bit, and so the dense voxels."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from numpy.typing import NDArray

from clvox.errors import OutOfMemoryError
from clvox.grid import Grid, Lattice, Shape
from clvox.mesh import check
from clvox.models.memory import cut_slabs
from clvox.ops import multilevel
from clvox.ops.boundary import mark_cells, mark_voxels
from clvox.ops.crossings import flip_bricks, flip_dense
from clvox.ops.dense import fill
from clvox.ops.layout import Bricks, Cells, VoxelArrays, cell_shape, words_for
from clvox.ops.measure import count_voxels
from clvox.ops.multilevel import (
    Solid,
    carry,
    empty_solid,
    list_bricks,
    list_bricks_below,
    rank_cells,
)
from clvox.ops.query import expand, expand_cells
from clvox.reference import multilevel as twin
from clvox.reference.crossings import fill_parity
from tests.kernels.cases import facets_of, large_tetrahedra, some, soup
from tests.repository import ROOT
from tests.strategies import BOX, Mesh, adversarial_meshes, closed_meshes, join

if TYPE_CHECKING:
    from clvox.device import Session

# Lattice bits, shape, and bricks; shapes that are no multiples of the bricks but in one case.
CASES: list[tuple[int, Shape, Shape]] = [
    (8, (9, 8, 7), (8, 8, 8)),
    (7, (16, 24, 8), (8, 8, 8)),
    (9, (35, 9, 17), (8, 8, 8)),
    (8, (5, 4, 3), (1, 1, 1)),
    (10, (36, 3, 4), (1, 1, 1)),
    (11, (10, 11, 9), (3, 5, 2)),
    (8, (13, 10, 9), (4, 4, 4)),
    (12, (23, 21, 12), (10, 10, 10)),
    (13, (22, 41, 19), (20, 20, 20)),
    (9, (40, 16, 5), (33, 7, 2)),
    (14, (7, 70, 3), (64, 64, 64)),
    (8, (70, 5, 66), (64, 64, 64)),
]
every_case = pytest.mark.parametrize(("bits", "shape", "brick"), CASES)


def build(
    session: Session, mesh: Mesh, bits: int, shape: Shape, brick: Shape
) -> tuple[Cells, Bricks, Solid]:
    """All stages of a build on the device."""
    facets = facets_of(session, mesh)
    marks = mark_cells(session, facets, bits, shape, brick)
    cells = rank_cells(session, marks, cell_shape(shape, brick), brick)
    bricks = Bricks.cleared(session, cells)
    flip_bricks(session, facets, bits, cells, bricks)
    return cells, bricks, carry(session, cells, bricks, shape)


def voxels_of(
    session: Session, mesh: Mesh, bits: int, shape: Shape, brick: Shape
) -> NDArray[np.bool_]:
    """The voxels of a build, (nz, ny, nx)."""
    cells, bricks, solid = build(session, mesh, bits, shape, brick)
    assert (solid.disagreements, solid.odd_rays) == (0, 0)
    arrays = VoxelArrays(shape, bricks.voxels, cells, solid.inside)
    return expand(session, arrays, (0, 0, 0), shape).view(np.bool_)


def dense_voxels_of(session: Session, mesh: Mesh, bits: int, shape: Shape) -> NDArray[np.bool_]:
    """The voxels of a dense build, (nz, ny, nx)."""
    nx, ny, nz = shape
    voxels = session.zeros((nz, ny, words_for(nx)), np.uint32)
    beyond = session.zeros((nz, words_for(nx)), np.uint32)
    flip_dense(session, facets_of(session, mesh), bits, shape, voxels, beyond)
    assert fill(session, voxels, beyond) == 0
    return expand(session, VoxelArrays(shape, voxels), (0, 0, 0), shape).view(np.bool_)


def check_build(session: Session, mesh: Mesh, bits: int, shape: Shape, brick: Shape) -> twin.Model:
    """Compare a build with the twin's; return the latter."""
    cells, bricks, solid = build(session, mesh, bits, shape, brick)
    expected = twin.build(*mesh, bits, shape, (cell_shape(shape, brick), brick))
    boundary = twin.pack_bits(expected.boundary)
    np.testing.assert_array_equal(cells.boundary.get(), boundary, strict=True)
    np.testing.assert_array_equal(cells.rank.get(), twin.rank(boundary), strict=True)
    assert cells.count == len(expected.bricks)
    inside = twin.pack_bits(expected.inside)
    np.testing.assert_array_equal(solid.inside.get(), inside, strict=True)
    words = twin.pack_bricks(expected.bricks)
    np.testing.assert_array_equal(bricks.voxels.get(), words, strict=True)
    assert (solid.disagreements, solid.odd_rays) == (0, 0)
    return expected


def meshes(seed: int, count: int, bits: int, shape: Shape) -> list[Mesh]:
    """Closed meshes of all families and sizes."""
    count = some(count)
    return [
        *adversarial_meshes(seed, count, bits, shape),
        *large_tetrahedra(seed, max(count // 2, 1), bits, shape),
    ]


def box_mesh(low: tuple[float, ...], high: tuple[float, ...], bits: int) -> Mesh:
    """A box, its corners in voxels from the centre of voxel 0."""
    ends = np.rint(np.array([low, high]) * 2**bits).astype(np.int64)
    corners = [[ends[i >> axis & 1, axis] for axis in range(3)] for i in range(8)]
    return np.array(corners), BOX


def build_three(
    session: Session,
    mesh: Mesh,
    bits: int,
    shape: Shape,
    middle: Shape,
    brick: Shape,
    room: int = 1 << 30,
) -> tuple[VoxelArrays, Solid]:
    """All stages of a build of three levels on the device, in slabs of *room* bytes."""
    facets = facets_of(session, mesh)
    sides = middle[0] * brick[0], middle[1] * brick[1], middle[2] * brick[2]
    marks = mark_cells(session, facets, bits, shape, sides)
    cells = rank_cells(session, marks, cell_shape(shape, sides), middle)
    counts = cell_shape(shape, brick)
    marks = mark_voxels(session, facets, bits, counts, cells, side=brick)
    cells = replace(cells, finer=rank_cells(session, marks, counts, brick))
    solid = empty_solid(session, cells)
    voxels = session.zeros((cells.last.count, cells.last.brick_words), np.uint32)
    for slab in cut_slabs(cells, room):
        bricks = Bricks.cleared(session, cells, voxels, slab)
        flip_bricks(session, facets, bits, cells, bricks)
        solid = carry(session, cells, bricks, shape, solid)
    return VoxelArrays(shape, voxels, cells, solid.inside, solid.middle_inside), solid


# Ranks


@pytest.mark.parametrize(
    "shape",
    [(1, 1, 1), (32, 1, 1), (33, 1, 1), (32, 7, 1), (32, 8, 1), (32, 9, 1), (5, 8, 63), (5, 8, 64),
     (70, 9, 65)],
)  # fmt: skip
def test_ranks_equal_the_twin(session: Session, shape: Shape) -> None:
    """An entry is for eight words; work-items come in groups of 64."""
    nx, ny, nz = shape
    bits = np.random.default_rng(41).random((nz, ny, nx)) < 0.4
    words = twin.pack_bits(bits)
    cells = rank_cells(session, session.upload(words), shape, (1, 1, 1))
    np.testing.assert_array_equal(cells.rank.get(), twin.rank(words), strict=True)
    assert cells.count == bits.sum()


def test_more_bricks_than_can_be_numbered_are_refused(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The two numbers that kernels take for outside and inside are none of a brick."""
    assert multilevel.MOST_BRICKS == 2**32 - 2
    words = session.upload(np.full((3, 2, 1), 0b111, np.uint32))
    monkeypatch.setattr(multilevel, "MOST_BRICKS", 19)
    assert rank_cells(session, words, (3, 2, 3), (8, 8, 8)).count == 18
    monkeypatch.setattr(multilevel, "MOST_BRICKS", 18)
    with pytest.raises(OutOfMemoryError, match=r"18 touched cells .* fewer than 18\. "):
        rank_cells(session, words, (3, 2, 3), (8, 8, 8))


@pytest.mark.parametrize("shape", [(1, 1, 1), (33, 7, 1), (5, 8, 64), (70, 9, 33)])
def test_bricks_know_their_cells(session: Session, shape: Shape) -> None:
    """In the order of the cells, on the coarse grid and in bricks of cells."""
    nx, ny, nz = shape
    rng = np.random.default_rng(46)
    bits = rng.random((nz, ny, nx)) < 0.3
    cells = rank_cells(session, session.upload(twin.pack_bits(bits)), shape, (3, 5, 2))
    owners = list_bricks(session, cells)
    expected = np.argwhere(bits)[:, ::-1].astype(np.int32)
    np.testing.assert_array_equal(owners.get(), expected, strict=True)
    below = rng.random((len(expected), 2, 5, 3)) < 0.3
    words = session.upload(twin.pack_bricks(below))
    finer = rank_cells(session, words, (3 * nx, 5 * ny, 2 * nz), (1, 1, 1))
    found = list_bricks_below(session, finer, owners, (3, 5, 2)).get()
    brick, z, y, x = np.nonzero(below)
    corners = expected[brick] * np.array([3, 5, 2], np.int32)
    places = corners + np.stack([x, y, z], axis=1).astype(np.int32)
    np.testing.assert_array_equal(found, places, strict=True)


# Builds


@every_case
def test_builds_equal_the_twin(session: Session, bits: int, shape: Shape, brick: Shape) -> None:
    # The twin works on whole cells, so large ones take long.
    for mesh in meshes(42, 45 if max(brick) < 64 else 6, bits, shape):
        check_build(session, mesh, bits, shape, brick)


@given(mesh=closed_meshes(8, (9, 8, 7)))
def test_drawn_builds_equal_the_twin(session: Session, mesh: Mesh) -> None:
    check_build(session, mesh, 8, (9, 8, 7), (3, 5, 2))


@every_case
def test_many_bodies_at_once(session: Session, bits: int, shape: Shape, brick: Shape) -> None:
    """Bricks side by side, and rays that cross many triangles."""
    together = join(adversarial_meshes(43, some(60, 8), bits, shape))
    check_build(session, together, bits, shape, brick)


@every_case
def test_levels_equal_the_dense_grid(
    session: Session, bits: int, shape: Shape, brick: Shape
) -> None:
    """And rays along x and z, in the twin, equal rays along y on the device."""
    for mesh in meshes(44, 30, bits, shape):
        dense = dense_voxels_of(session, mesh, bits, shape)
        found = voxels_of(session, mesh, bits, shape, brick)
        np.testing.assert_array_equal(found, dense, strict=True)
        for axis in ("x", "z"):
            along = fill_parity(*mesh, bits, shape, axis)
            np.testing.assert_array_equal(dense, along, strict=True)


@every_case
def test_grid_inside_the_solid(session: Session, bits: int, shape: Shape, brick: Shape) -> None:
    """No triangle is near: entry planes alone fill it."""
    nx, ny, nz = shape
    outer = box_mesh((-90, -99, -95), (nx + 90, ny + 90, nz + 90), bits)
    model = check_build(session, outer, bits, shape, brick)
    assert model.inside.all()
    assert voxels_of(session, outer, bits, shape, brick).all()


@every_case
def test_grid_beside_the_solid(session: Session, bits: int, shape: Shape, brick: Shape) -> None:
    """Crossings all lie before the grid, behind it, or on no ray of it."""
    for axis in range(3):
        low, high = [-0.75] * 3, [side - 0.25 for side in shape]
        for ends in ((-9.0, -0.5), (shape[axis] + 70.0, shape[axis] + 79.0)):
            low[axis], high[axis] = ends
            beside = box_mesh(tuple(low), tuple(high), bits)
            assert not check_build(session, beside, bits, shape, brick).to_array().any()


@pytest.mark.parametrize(
    ("bits", "shape", "middle", "brick"),
    [
        (8, (9, 8, 7), (1, 1, 1), (8, 8, 8)),
        (9, (21, 18, 17), (2, 2, 2), (8, 8, 8)),
        (7, (13, 12, 9), (2, 3, 2), (3, 1, 2)),
        (10, (40, 7, 6), (1, 2, 3), (1, 2, 1)),
        (14, (37, 9, 5), (33, 2, 1), (1, 2, 2)),
        (9, (35, 37, 6), (8, 8, 8), (4, 4, 4)),
        (10, (7, 34, 35), (8, 8, 8), (4, 4, 4)),
        (8, (9, 67, 11), (8, 8, 8), (8, 8, 8)),
    ],
)
def test_three_levels_equal_the_twin(
    session: Session, bits: int, shape: Shape, middle: Shape, brick: Shape
) -> None:
    """The coarse cells are those of two levels with large bricks, the rest that with small ones."""
    sides = middle[0] * brick[0], middle[1] * brick[1], middle[2] * brick[2]
    counts = cell_shape(shape, brick)
    nx, ny, nz = shape
    solid = box_mesh((-90, -90, -90), (nx + 90, ny + 90, nz + 90), bits)
    for mesh in [solid, *meshes(47, some(20), bits, shape)]:
        arrays, found = build_three(session, mesh, bits, shape, middle, brick)
        coarse = twin.build(*mesh, bits, shape, (cell_shape(shape, sides), sides))
        fine = twin.build(*mesh, bits, shape, (counts, brick))
        assert (found.disagreements, found.odd_rays) == (0, 0)
        assert arrays.cells is not None
        assert arrays.cells.finer is not None
        assert arrays.cells.finer.count == len(fine.bricks)
        states = expand_cells(session, arrays, (0, 0, 0), arrays.cells.shape)
        np.testing.assert_array_equal(states, coarse.states, strict=True)
        states = expand_cells(session, arrays, (0, 0, 0), counts, 1)
        np.testing.assert_array_equal(states, fine.states, strict=True)
        voxels = expand(session, arrays, (0, 0, 0), shape).view(np.bool_)
        np.testing.assert_array_equal(voxels, fine.to_array(), strict=True)
        assert count_voxels(session, arrays) == np.count_nonzero(voxels)
        # No bit beyond the grid or the cells: what is stored is what can be read.
        marked = np.repeat(fine.boundary, brick[2], 0).repeat(brick[1], 1).repeat(brick[0], 2)
        stored = np.unpackbits(arrays.voxels.get().view(np.uint8)).sum()
        assert stored == np.count_nonzero(voxels & marked[:nz, :ny, :nx])


@pytest.mark.parametrize("brick", [(8, 8, 8), (3, 5, 2)])
@pytest.mark.parametrize("start", [(0, 0, 0), (3, 2, 1), (8, 8, 8), (1, 9, 4)])
def test_grid_cut_out_of_a_larger_one(session: Session, start: Shape, brick: Shape) -> None:
    """The same voxels, wherever the cells begin."""
    bits, whole, shape = 8, (20, 19, 18), (9, 8, 10)
    x, y, z = start
    for mesh in meshes(45, 45, bits, whole):
        moved = mesh[0] - (np.array(start) << bits), mesh[1]
        large = voxels_of(session, mesh, bits, whole, brick)
        found = voxels_of(session, moved, bits, shape, brick)
        part = large[z : z + shape[2], y : y + shape[1], x : x + shape[0]]
        np.testing.assert_array_equal(found, part, strict=True)
        assert (dense_voxels_of(session, moved, bits, shape) == part).all()


def box_without(axes: tuple[int, ...]) -> Mesh:
    """A box from y = 2.25 on and up to x = 19.5, without its upper sides on *axes*."""
    vertices, faces = box_mesh((-1, 2.25, -1), (19.5, 60, 60), 8)
    tops = vertices.max(axis=0)
    lids = np.array([(vertices[face] == tops).all(axis=0)[list(axes)].any() for face in faces])
    assert lids.sum() == 2 * len(axes)
    return vertices, faces[~lids]


every_brick = pytest.mark.parametrize("brick", [(8, 8, 8), (33, 7, 2), (1, 1, 1)])


@every_brick
def test_rays_that_end_inside_are_counted(session: Session, brick: Shape) -> None:
    """The side that they would leave by is missing; those of the padding count too."""
    shape = (40, 9, 17)
    _, _, solid = build(session, box_without((1,)), 8, shape, brick)
    assert solid.odd_rays == 20 * cell_shape(shape, brick)[2] * brick[2]
    assert solid.disagreements == 0


@every_brick
def test_cells_in_and_out_at_once_are_counted(session: Session, brick: Shape) -> None:
    """The side at x = 19.5 is missing, and untouched cells reach across its place."""
    shape = (40, 9, 17)
    layers = cell_shape(shape, brick)[2]
    _, _, solid = build(session, box_without((0, 1)), 8, shape, brick)
    assert solid.odd_rays > 0
    # The first cell that is not touched takes one state for all its rays, so it alone counts.
    assert solid.disagreements == (layers if 20 % brick[0] else 0)


@pytest.mark.parametrize("brick", [(8, 8, 8), (3, 5, 2)])
def test_soups_do_no_harm(session: Session, brick: Shape) -> None:
    """Triangles that are not closed: nonsense in, but every brick and every count is there."""
    shape = (9, 8, 7)
    for seed in range(some(20)):
        cells, bricks, solid = build(session, soup(seed, 40, 8, shape), 8, shape, brick)
        assert solid.odd_rays > 0
        assert solid.inside.shape == cells.boundary.shape
        assert not (solid.inside.get() & cells.boundary.get()).any()
        assert bricks.voxels.shape[0] == cells.count


@pytest.mark.parametrize("brick", [(4, 4, 4), (8, 8, 8)])
def test_columns_are_carried_as_rows_are(
    session: Session, brick: Shape, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both kernels that carry three levels, slab by slab: all arrays and counts, closed or not."""
    bits, side = 9, 8 * brick[0]
    shape = brick[0] + 3, side + brick[0] + 2, side + 2
    soups = (soup(seed, 30, bits, shape) for seed in range(some(6)))
    for mesh in [*meshes(53, some(6), bits, shape), *soups]:
        found = []
        for cubes in (multilevel._CUBES, ()):
            monkeypatch.setattr(multilevel, "_CUBES", cubes)
            arrays, solid = build_three(session, mesh, bits, shape, (8, 8, 8), brick, room=1)
            counts = np.array([solid.disagreements, solid.odd_rays])
            found.append([*(array.get() for array in arrays.arrays), counts])
            monkeypatch.undo()
        for columns, rows in zip(*found, strict=True):
            np.testing.assert_array_equal(columns, rows, strict=True)


@pytest.mark.parametrize("brick", [(8, 8, 8), (10, 10, 10)])
def test_a_machined_part_equals_the_twin(session: Session, brick: Shape) -> None:
    """NIST's angle block, 64 voxels long; one of 16 where kernels are interpreted."""
    surface = check(ROOT / "tests/data/angle_block.stl")
    grid = Grid.fit(surface, resolution=some(64, 16))
    lattice = Lattice.fit(grid, surface.bounds)
    mesh = lattice.snap(surface.vertices).astype(np.int64), surface.faces
    model = check_build(session, mesh, lattice.bits, grid.shape, brick)
    assert model.to_array().any()
