"""Every crossing of rays with triangles equals the twin's, for each sink."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pytest
from hypothesis import given
from numpy.typing import NDArray

from clvox.device.source import read_source
from clvox.grid import Axis, Grid, Lattice, Shape
from clvox.ops.crossings import WIDE_RUN, Window, count_crossings, flip_bricks, flip_dense
from clvox.ops.facets import RUN
from clvox.ops.layout import Bricks, Cells, cell_shape, words_for
from clvox.ops.multilevel import rank_cells
from clvox.reference import crossings as twin
from clvox.reference.boundary import touched
from clvox.reference.multilevel import pack_bits, pack_bricks
from tests.kernels.cases import build, facets_of, large_tetrahedra, meshes_for, slivers, some, soup
from tests.strategies import FAMILIES, Mesh, adversarial_meshes, closed_meshes, join

if TYPE_CHECKING:
    from clvox.device import Session

SMALL: Shape = (9, 8, 7)


class Case(NamedTuple):
    """A lattice, a grid, and how triangles are spread over work-items."""

    bits: int
    shape: Shape
    direct: int
    tile: int


# Small grids: so that tiles are met, hardly a triangle may be done directly.
CASES = [
    Case(7, SMALL, 256, 32),
    Case(7, (2, 3, 40), 1, 2),
    Case(8, SMALL, 1, 1),
    Case(9, (33, 5, 4), 0, 2),
    Case(10, (5, 34, 6), 1, 32),
    Case(11, (4, 6, 35), 10, 3),
    Case(12, (1, 1, 1), 256, 32),
    Case(13, (7, 1, 9), 4, 2),
    Case(14, (10, 9, 11), 256, 32),
    Case(14, (40, 37, 41), 16, 8),
]
every_case = pytest.mark.parametrize("case", CASES, ids=str)
every_axis = pytest.mark.parametrize("axis", twin.AXES)


def count(session: Session, mesh: Mesh, case: Case, axis: Axis) -> NDArray[np.uint32]:
    found: NDArray[np.uint32] = count_crossings(
        *(session, facets_of(session, mesh), case.bits, case.shape, twin.AXES[axis]),
        direct=case.direct,
        tile=case.tile,
    ).get()
    return found


def flips_of(mesh: Mesh, bits: int, shape: Shape) -> NDArray[np.bool_]:
    """Parity of the crossings of each ray along y in each slot; (nz, ny + 1, nx).

    Slots at or before the grid's first sample are 0, those past its last are ny.
    """
    inside = twin.fill_parity(*mesh, bits, shape, "y")
    ends = twin.count_crossings(*mesh, bits, shape, "y") % 2 == 1
    states = np.concatenate([inside, ends[:, None]], axis=1)
    flips: NDArray[np.bool_] = np.diff(states, axis=1, prepend=False)
    return flips


@every_axis
@every_case
def test_counts_equal_the_twin(session: Session, case: Case, axis: Axis) -> None:
    for mesh in meshes_for(11, 60, case.bits, case.shape):
        found = count(session, mesh, case, axis)
        expected = twin.count_crossings(*mesh, case.bits, case.shape, axis)
        np.testing.assert_array_equal(found, expected, strict=True)


@every_axis
@given(mesh=closed_meshes(8, SMALL))
def test_rays_cross_a_closed_mesh_an_even_number_of_times(
    session: Session, axis: Axis, mesh: Mesh
) -> None:
    """Whatever the twin says."""
    assert not (count(session, mesh, CASES[0]._replace(bits=8), axis) % 2).any()


@every_axis
@pytest.mark.parametrize(("bits", "direct"), [(7, 256), (10, 0), (14, 1 << 14)])
def test_slivers_across_many_rows_equal_the_twin(
    session: Session, bits: int, direct: int, axis: Axis
) -> None:
    """More rows than a block has that is solved at once, and most without a ray that is covered."""
    for shape in ((5, 140, 90), (140, 90, 5), (90, 5, 140)):
        mesh = slivers(15, some(40), bits, shape)
        found = count(session, mesh, Case(bits, shape, direct, 32), axis)
        expected = twin.count_crossings(*mesh, bits, shape, axis)
        np.testing.assert_array_equal(found, expected, strict=True)


@every_case
def test_dense_flips_equal_the_twin(session: Session, case: Case) -> None:
    nx, ny, nz = case.shape
    for mesh in meshes_for(12, 60, case.bits, case.shape):
        voxels = session.zeros((nz, ny, words_for(nx)), np.uint32)
        beyond = session.zeros((nz, words_for(nx)), np.uint32)
        flip_dense(
            *(session, facets_of(session, mesh), case.bits, case.shape, voxels, beyond),
            direct=case.direct,
            tile=case.tile,
        )
        expected = pack_bits(flips_of(mesh, case.bits, case.shape))
        np.testing.assert_array_equal(voxels.get(), expected[:, :-1], strict=True)
        np.testing.assert_array_equal(beyond.get(), expected[:, -1], strict=True)


def test_flips_add_to_those_that_are_there(session: Session) -> None:
    """Twice the same mesh leaves nothing."""
    nx, ny, nz = SMALL
    facets = facets_of(session, join(adversarial_meshes(13, 15)))
    voxels = session.zeros((nz, ny, words_for(nx)), np.uint32)
    beyond = session.zeros((nz, words_for(nx)), np.uint32)
    flip_dense(session, facets, 8, SMALL, voxels, beyond)
    assert voxels.get().any()
    flip_dense(session, facets, 8, SMALL, voxels, beyond)
    assert not voxels.get().any()
    assert not beyond.get().any()


def bricks_of(mesh: Mesh, bits: int, shape: Shape, cells: Cells) -> tuple[NDArray[np.uint32], ...]:
    """Twin of `flip_bricks`: voxels, exits, entry and beyond, as words.

    A crossing is flipped in the brick of its slot's cell.  If that has none, the crossing lies
    behind the last sample of the cell before, which then has one.
    """
    n1x, n1y, n1z = cells.brick
    nx, ny, nz = cells.shape
    whole = (nx * n1x, ny * n1y, nz * n1z)
    boundary = touched(*mesh, bits, shape, cells.brick)
    numbers = np.cumsum(boundary).reshape(boundary.shape) - 1
    voxels = np.zeros((boundary.sum(), n1z, n1y, n1x), dtype=np.bool_)
    exits = np.zeros((boundary.sum(), n1z, n1x), dtype=np.bool_)
    entry = np.zeros((nz, nx, n1z, n1x), dtype=np.bool_)
    beyond = np.zeros_like(entry)
    for z, slot, x in np.argwhere(flips_of(mesh, bits, whole)).tolist():
        k, j, i = z // n1z, slot // n1y, x // n1x
        ray = z % n1z, x % n1x
        if slot == 0:
            entry[k, i][ray] ^= True
        elif slot == whole[1]:
            beyond[k, i][ray] ^= True
        elif boundary[k, j, i]:
            voxels[numbers[k, j, i], z % n1z, slot % n1y, x % n1x] ^= True
        else:
            assert slot % n1y == 0
            assert boundary[k, j - 1, i]
            exits[numbers[k, j - 1, i]][ray] ^= True
    faces = (face.reshape(*face.shape[:-2], n1z * n1x) for face in (exits, entry, beyond))
    return pack_bricks(voxels), *map(pack_bits, faces)


BRICK_CASES = [
    (Case(8, SMALL, 256, 32), (8, 8, 8)),
    (Case(8, (9, 10, 7), 1, 2), (3, 5, 2)),
    (Case(7, (17, 18, 5), 4, 32), (4, 4, 4)),
    (Case(10, (5, 6, 4), 1, 1), (1, 1, 1)),
    (Case(9, (40, 9, 5), 0, 3), (33, 7, 2)),
    (Case(14, (20, 21, 22), 16, 8), (10, 10, 10)),
]


def assert_bricks_equal_the_twin(session: Session, case: Case, brick: Shape, count: int) -> None:
    bits, shape = case.bits, case.shape
    for mesh in meshes_for(14, count, bits, shape):
        marks = session.upload(pack_bits(touched(*mesh, bits, shape, brick)))
        cells = rank_cells(session, marks, cell_shape(shape, brick), brick)
        bricks = Bricks.cleared(session, cells)
        flip_bricks(
            *(session, facets_of(session, mesh), bits, cells, bricks),
            direct=case.direct,
            tile=case.tile,
        )
        found = (bricks.voxels, bricks.exits, bricks.entry, bricks.beyond)
        for words, expected in zip(found, bricks_of(mesh, bits, shape, cells), strict=True):
            np.testing.assert_array_equal(words.get(), expected, strict=True)


@pytest.mark.parametrize(("case", "brick"), BRICK_CASES, ids=str)
def test_brick_flips_equal_the_twin(session: Session, case: Case, brick: Shape) -> None:
    assert_bricks_equal_the_twin(session, case, brick, 40)


@pytest.mark.parametrize(
    ("case", "brick"),
    [
        (Case(7, (21, 16, 9), 256, 32), (4, 4, 4)),
        (Case(8, (17, 8, 9), 256, 8), (8, 8, 8)),
        (Case(14, (9, 70, 22), 1 << 10, 32), (8, 8, 8)),
        (Case(14, (11, 13, 6), 1 << 10, 32), (4, 4, 4)),
        # Boxes of more rays are too large for patches.
        (Case(9, (11, 13, 6), 1 << 11, 32), (4, 4, 4)),
    ],
    ids=str,
)
def test_patches_of_rays_flip_what_single_rays_do(
    session: Session, case: Case, brick: Shape, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However many triangles there are to a ray: so that all are of few crossings, too."""
    monkeypatch.setattr("clvox.ops.crossings.WIDE", 0)
    assert_bricks_equal_the_twin(session, case, brick, 20)


# A sink of the tests' own, for rays along any axis: how many crossings have each slot.
SLOTS = """
#define SINK_PARAMETERS const int depth, __global uint *slots
#define MAKE_SINK(window) { (window).w + 1, depth, slots }
typedef struct {
    int rays_v, depth;
    __global uint *slots;
} Sink;

static inline void cross(Sink *sink, const int u, const int v, const int slot)
{
    const int at = clamp(slot, 0, sink->depth);
    atomic_inc(sink->slots + (u * sink->rays_v + v) * (sink->depth + 1) + at);
}
"""


@every_axis
@pytest.mark.parametrize(
    ("bits", "shape", "edge", "wide"),
    [
        (8, SMALL, 32, 0),
        (8, (9, 12, 10), 32, 1),
        (7, (5, 6, 4), 64, 1),
        (9, (10, 9, 11), 32, 0),
        (14, (10, 9, 11), 64, 1),
    ],
)
def test_slots_along_every_axis_equal_the_twin(
    session: Session, bits: int, shape: Shape, edge: int, wide: int, axis: Axis
) -> None:
    """And so rays along x, y and z give the same voxels."""
    at = twin.AXES[axis]
    rays_u, rays_v, depth = shape[(at + 1) % 3], shape[(at + 2) % 3], shape[at]
    defines = {"AXIS": at, "STEP_BITS": bits, "SINK": -1, "TILE": 1, "RUN": 1, "FEW": 1 << 40}
    defines |= {"EDGE_BITS": edge, "DIRECT": 1 << (14 if edge == 32 else 40), "WIDE": wide}
    source = SLOTS + read_source("crossings/cast_rays.cl")
    kernel = build(session, source, "cast_direct", **defines)
    for mesh in meshes_for(18, 60, bits, shape):
        facets = facets_of(session, mesh)
        triangles = np.uint64(len(mesh[1]))
        slots = session.zeros((rays_u, rays_v, depth + 1), np.uint32)
        listed, entries = session.zeros(1, np.uint32), session.empty(len(mesh[1]), np.uint32)
        session.run(
            *(kernel, int(triangles), np.uint64(0), triangles, Window.whole(shape, at).box),
            *(facets.faces, facets.vertices, listed, entries, np.int32(depth), slots),
        )
        if listed.get()[0]:
            assert edge == 32  # and some triangle is too large for that
            continue
        found = slots.get().transpose((1, 0, 2) if axis == "y" else (0, 1, 2))
        expected = np.zeros_like(found)
        for crossing in twin.crossings(*mesh, bits, shape, axis):
            expected[crossing.u, crossing.v, min(max(crossing.slot, 0), depth)] += 1
        np.testing.assert_array_equal(found, expected, strict=True)
        if not (found.sum(axis=2) % 2).any():
            inside = np.logical_xor.accumulate(found % 2 == 1, axis=2)[..., :-1]
            along_y = twin.fill_parity(*mesh, bits, shape, "y")
            np.testing.assert_array_equal(np.moveaxis(inside, 2, at).T, along_y, strict=True)


@every_axis
@pytest.mark.parametrize(
    "triangles", [0, 1, WIDE_RUN, WIDE_RUN + 1, RUN - 1, RUN, RUN + 1, 64 * RUN, 64 * RUN + 1]
)
def test_any_number_of_triangles(session: Session, triangles: int, axis: Axis) -> None:
    """Work-items do RUN each, of a few triangles WIDE_RUN, and come in groups of 64."""
    for direct in (0, 256):
        case = Case(8, SMALL, direct, 4)
        vertices, faces = soup(15, triangles, case.bits, case.shape)
        mesh = vertices.reshape(-1, 3), faces
        found = count(session, mesh, case, axis)
        expected = twin.count_crossings(*mesh, case.bits, case.shape, axis)
        np.testing.assert_array_equal(found, expected, strict=True)


@every_axis
def test_triangles_just_about_the_width_of_an_int(session: Session, axis: Axis) -> None:
    """Boxes of 355 to 365 voxels of 2**14 steps: edge functions pass 31 bits at 362."""
    case = Case(14, (12, 11, 13), 256, 32)
    rng = np.random.default_rng(16)
    crossings = 0
    for side in range(355, 366):
        low = -(rng.integers(0, side, (some(20), 3)) << 14)
        high = low + (side << 14) - rng.integers(0, 2, low.shape)
        ends = np.stack([low, high], axis=1)
        corners = rng.integers(0, 2, (len(ends), 3, 3))
        # The first two corners span the whole box, whatever the third.
        corners[:, 1] = 1 - corners[:, 0]
        vertices = np.take_along_axis(ends, corners, axis=1).reshape(-1, 3)
        mesh = vertices, np.arange(len(vertices), dtype=np.int32).reshape(-1, 3)
        found = count(session, mesh, case, axis)
        crossings += int(found.sum())
        expected = twin.count_crossings(*mesh, case.bits, case.shape, axis)
        np.testing.assert_array_equal(found, expected, strict=True)
    assert crossings


@pytest.mark.parametrize("seed", range(3))
def test_large_triangles_flip_as_small_ones_do(session: Session, seed: int) -> None:
    """Of 2**24 steps and less on a small grid cut out of them."""
    case = Case(14, (12, 11, 13), 256, 32)
    nx, ny, nz = case.shape
    for mesh in large_tetrahedra(20 + seed, some(150), case.bits, case.shape):
        voxels = session.zeros((nz, ny, words_for(nx)), np.uint32)
        beyond = session.zeros((nz, words_for(nx)), np.uint32)
        flip_dense(session, facets_of(session, mesh), case.bits, case.shape, voxels, beyond)
        expected = pack_bits(flips_of(mesh, case.bits, case.shape))
        np.testing.assert_array_equal(voxels.get(), expected[:, :-1], strict=True)
        np.testing.assert_array_equal(beyond.get(), expected[:, -1], strict=True)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("offset", [0.0, 1e6, -3.3e5])
def test_far_away_and_very_small(session: Session, scale: float, offset: float) -> None:
    """Through the lattice, as users' meshes come: far off, measured in their own size."""
    place = offset * scale
    spacing = (0.5 * scale, 0.25 * scale, 0.75 * scale)
    grid = Grid((place, -place, place / 3), spacing, SMALL)
    near = [family for family in FAMILIES if family != "wide"]
    crossed = 0
    for vertices, faces in adversarial_meshes(17, some(30), 4, SMALL, near):
        points = np.array(grid.origin) + (vertices / 16 + 0.5) * spacing
        lattice = Lattice.fit(grid, np.stack([points.min(axis=0), points.max(axis=0)]))
        mesh = lattice.snap(points).astype(np.int64), faces
        case = Case(lattice.bits, SMALL, 4, 4)
        for axis in twin.AXES:
            found = count(session, mesh, case, axis)
            expected = twin.count_crossings(*mesh, lattice.bits, SMALL, axis)
            np.testing.assert_array_equal(found, expected, strict=True)
            assert not (found % 2).any()
            crossed += int(found.sum())
    assert crossed
