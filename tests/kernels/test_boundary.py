"""Cells and voxels that triangles touch are those of the twin, which cuts triangles to cells."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from numpy.typing import NDArray

from clvox.device.source import read_source
from clvox.grid import Shape
from clvox.ops.boundary import count_flat, mark_and_count, mark_cells, mark_voxels
from clvox.ops.facets import RUN
from clvox.ops.layout import cell_shape
from clvox.ops.multilevel import rank_cells
from clvox.reference.boundary import touched
from clvox.reference.multilevel import pack_bits, pack_bricks
from tests.kernels.cases import (
    bricks_at,
    build,
    facets_of,
    flat_triangles,
    large_tetrahedra,
    meshes_for,
    slivers,
    some,
    soup,
)
from tests.strategies import Mesh, closed_meshes

if TYPE_CHECKING:
    from clvox.device import Session

SMALL: Shape = (9, 8, 7)

# Lattice bits, shape, cell, and how triangles are spread over work-items.
CASES = [
    (8, SMALL, (1, 1, 1), 64, 16),
    (14, (3, 4, 5), (1, 1, 1), 1, 1),
    (7, (35, 5, 4), (1, 1, 1), 0, 2),
    (7, (34, 3, 5), (1, 2, 1), 2, 16),
    (9, (10, 9, 8), (3, 5, 2), 1, 2),
    (10, (12, 11, 10), (4, 4, 4), 0, 1),
    (11, (17, 20, 19), (8, 8, 8), 64, 16),
    (12, (9, 8, 40), (4, 1, 7), 3, 3),
    (13, (45, 21, 13), (20, 20, 20), 1, 2),
    (14, (70, 66, 65), (64, 64, 64), 0, 1),
]
every_case = pytest.mark.parametrize(("bits", "shape", "cell", "direct", "tile"), CASES)


def marked(
    session: Session,
    mesh: Mesh,
    bits: int,
    shape: Shape,
    cell: Shape,
    direct: int = 64,
    tile: int = 16,
) -> NDArray[np.uint32]:
    found: NDArray[np.uint32] = mark_cells(
        session, facets_of(session, mesh), bits, shape, cell, direct=direct, tile=tile
    ).get()
    return found


@every_case
def test_cells_equal_the_twin(
    session: Session, bits: int, shape: Shape, cell: Shape, direct: int, tile: int
) -> None:
    """Mesh by mesh, since the marks of many meshes would hide one another's faults."""
    meshes = [*meshes_for(31, 45, bits, shape), flat_triangles(31, some(30), bits, shape)]
    for mesh in meshes:
        found = marked(session, mesh, bits, shape, cell, direct, tile)
        expected = pack_bits(touched(*mesh, bits, shape, cell))
        np.testing.assert_array_equal(found, expected, strict=True)


def test_devices_without_atomic_loads_mark_the_same(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What a device that has them does is what all other tests see."""
    meshes = meshes_for(34, some(20), 11, (17, 20, 19))
    first = [marked(session, mesh, 11, (17, 20, 19), (8, 8, 8)) for mesh in meshes]
    monkeypatch.setattr(session, "device", replace(session.device, atomic_loads=False))
    for mesh, expected in zip(meshes, first, strict=True):
        found = marked(session, mesh, 11, (17, 20, 19), (8, 8, 8))
        np.testing.assert_array_equal(found, expected, strict=True)


@pytest.mark.parametrize("make", [soup, flat_triangles])
def test_single_triangles(session: Session, make: Callable[[int, int, int, Shape], Mesh]) -> None:
    """One at a time, so that nothing covers what one of them misses; in blocks, and in columns."""
    vertices, faces = make(32, some(150), 8, SMALL)
    for face in faces:
        mesh = vertices, face[None]
        expected = pack_bits(touched(*mesh, 8, SMALL, (1, 1, 1)))
        for direct in (64, 63):
            found = marked(session, mesh, 8, SMALL, (1, 1, 1), direct)
            np.testing.assert_array_equal(found, expected, strict=True)


def in_blocks(seed: int, count: int, bits: int, shape: Shape, cell: Shape, most: int = 8) -> Mesh:
    """Return so many triangles of boxes up to *most* cells wide.

    Most have corners near those of cells; some lie in a plane through cells' sides or across an
    axis, and planes of others touch a cell just so.
    """
    rng = np.random.default_rng(seed)
    side = np.array(cell) << bits
    widths = rng.integers(1, most + 1, (count, 1, 3)) * rng.integers(0, 2, (count, 1, 3))
    widths[::2] = rng.integers(1, most + 1, (len(widths[::2]), 1, 3))
    spots = rng.uniform(-0.5, 1, (count, 1, 3)) * cell_shape(shape, cell)
    spots = spots + rng.uniform(0, 1, (count, 3, 3)) * widths
    near = rng.random((count, 3, 3)) < 0.6
    corners = np.rint(np.where(near, np.rint(spots), spots) * side).astype(np.int64)
    corners += rng.integers(-1, 2, corners.shape) * (rng.random(corners.shape) < 0.2)
    corners -= 1 << (bits - 1)
    return corners.reshape(-1, 3), np.arange(3 * count, dtype=np.int32).reshape(-1, 3)


@pytest.mark.parametrize(
    ("bits", "shape", "cell"),
    [
        (14, (90, 88, 100), (8, 8, 8)),
        (11, (500, 450, 460), (64, 64, 64)),
        (9, (40, 30, 50), (3, 2, 5)),
        (7, (70, 11, 9), (1, 1, 1)),
        (7, (9000, 8000, 9500), (1024, 1000, 1020)),
        (14, (512, 600, 560), (64, 64, 64)),
    ],
)
def test_triangles_in_blocks(session: Session, bits: int, shape: Shape, cell: Shape) -> None:
    """As wide as a block can be, in voxels and in steps, and wider; or partly outside."""
    vertices, faces = in_blocks(42, some(300), bits, shape, cell)
    for face in faces:
        single = vertices, face[None]
        expected = pack_bits(touched(*single, bits, shape, cell))
        found = marked(session, single, bits, shape, cell)
        np.testing.assert_array_equal(found, expected, strict=True)


@given(mesh=closed_meshes(8, SMALL))
def test_closed_meshes_touch_what_the_twin_says(session: Session, mesh: Mesh) -> None:
    expected = pack_bits(touched(*mesh, 8, SMALL, (3, 5, 2)))
    np.testing.assert_array_equal(marked(session, mesh, 8, SMALL, (3, 5, 2)), expected)


@pytest.mark.parametrize(("bits", "cell"), [(7, (1, 1, 1)), (14, (1, 1, 1)), (9, (2, 3, 1))])
def test_large_triangles_on_a_grid_cut_out_of_them(
    session: Session, bits: int, cell: Shape
) -> None:
    """Depths in float32 are then some steps wrong, and plane terms pass 63 bits."""
    shape = (9, 10, 8)
    for mesh in large_tetrahedra(33, some(200), bits, shape):
        for face in mesh[1]:
            single = mesh[0], face[None]
            expected = pack_bits(touched(*single, bits, shape, cell))
            found = marked(session, single, bits, shape, cell)
            np.testing.assert_array_equal(found, expected, strict=True)


@pytest.mark.parametrize(("bits", "shape"), [(7, (40, 45, 9)), (9, (9, 40, 70)), (14, (70, 9, 40))])
def test_slivers_across_many_rows_of_columns(session: Session, bits: int, shape: Shape) -> None:
    """More rows than a block has that is solved at once."""
    vertices, faces = slivers(41, some(40), bits, shape)
    for face in faces:
        single = vertices, face[None]
        expected = pack_bits(touched(*single, bits, shape, (1, 1, 1)))
        found = marked(session, single, bits, shape, (1, 1, 1), direct=0)
        np.testing.assert_array_equal(found, expected, strict=True)


@pytest.mark.parametrize("bits", [7, 10, 14])
def test_planes_of_large_triangles_through_the_grid(session: Session, bits: int) -> None:
    """Of all the lattice, and touching cells at a corner: depths in float32 are steps wrong."""
    shape = (6, 5, 7)
    rng = np.random.default_rng(40)
    for _ in range(some(400)):
        middle = rng.integers(0, np.array(shape) << bits)
        far = 2**23 - (8 << bits)
        a, b = rng.integers(-far, far, (2, 3))
        s, t = rng.uniform(0, 1, 2)
        c = np.clip(np.rint(-(s * a + t * b)).astype(np.int64), -far, far)
        mesh = middle + np.stack([a, b, c]), np.array([[0, 1, 2]], dtype=np.int32)
        expected = pack_bits(touched(*mesh, bits, shape, (1, 1, 1)))
        found = marked(session, mesh, bits, shape, (1, 1, 1))
        np.testing.assert_array_equal(found, expected, strict=True)


@pytest.mark.parametrize("triangles", [0, 1, RUN - 1, RUN, RUN + 1, 64 * RUN, 64 * RUN + 1])
def test_any_number_of_triangles(session: Session, triangles: int) -> None:
    """Work-items do RUN each and come in groups of 64."""
    vertices, faces = soup(34, triangles, 8, SMALL)
    mesh = vertices.reshape(-1, 3), faces
    for direct in (0, 64):
        found = marked(session, mesh, 8, SMALL, (3, 5, 2), direct, 2)
        expected = pack_bits(touched(*mesh, 8, SMALL, (3, 5, 2)))
        np.testing.assert_array_equal(found, expected, strict=True)


def test_marks_are_added_to(session: Session) -> None:
    facets = facets_of(session, soup(35, 1, 8, SMALL))
    full = session.upload(np.full((7, 8, 1), 1 << 20, np.uint32))
    found = mark_cells(session, facets, 8, SMALL, (1, 1, 1), full).get()
    alone = mark_cells(session, facets, 8, SMALL, (1, 1, 1)).get()
    np.testing.assert_array_equal(found, alone | 1 << 20)


@pytest.mark.parametrize(
    ("bits", "shape", "brick", "direct", "tile"),
    [
        (8, SMALL, (8, 8, 8), 64, 16),
        (8, (10, 9, 8), (3, 5, 2), 0, 2),
        (7, (5, 6, 4), (1, 1, 1), 1, 1),
        (14, (34, 4, 3), (33, 3, 2), 4, 16),
    ],
)
def test_voxels_equal_the_twin(
    session: Session, bits: int, shape: Shape, brick: Shape, direct: int, tile: int
) -> None:
    """Laid out like bricks; voxels beyond the grid are not marked."""
    for mesh in meshes_for(36, 20, bits, shape):
        boundary = touched(*mesh, bits, shape, brick)
        marks = session.upload(pack_bits(boundary))
        cells = rank_cells(session, marks, cell_shape(shape, brick), brick)
        facets = facets_of(session, mesh)
        found = mark_voxels(session, facets, bits, shape, cells, direct=direct, tile=tile)
        edge = touched(*mesh, bits, shape, (1, 1, 1))
        expected = pack_bricks(bricks_at(edge, boundary, brick))
        np.testing.assert_array_equal(found.get(), expected, strict=True)


@pytest.mark.parametrize(
    ("bits", "shape", "cell"),
    [
        (7, (70, 60, 65), (1, 1, 1)),
        (10, (600, 500, 450), (8, 8, 8)),
        (11, (480, 550, 510), (8, 8, 8)),
        (12, (500, 550, 480), (8, 8, 8)),
        (11, (200, 90, 150), (3, 2, 4)),
    ],
)
def test_many_blocks_hold_what_columns_do(
    session: Session, bits: int, shape: Shape, cell: Shape
) -> None:
    """Columns equal the twin, which is slow with so many cells; some are too wide for blocks."""
    vertices, faces = in_blocks(44, some(300), bits, shape, cell, 72)
    for face in faces:
        single = vertices, face[None]
        blocks, columns = (marked(session, single, bits, shape, cell, n) for n in (64, 63))
        np.testing.assert_array_equal(blocks, columns, strict=True)


@pytest.mark.parametrize("brick", [(8, 8, 8), (8, 4, 8)])
def test_blocks_in_bricks(session: Session, brick: Shape) -> None:
    """A block lies in up to eight bricks; each triangle alone, in the bricks of all."""
    bits, shape = 10, (21, 18, 23)
    vertices, faces = in_blocks(43, some(80), bits, shape, (1, 1, 1), 12)
    boundary = touched(vertices, faces[::3], bits, shape, brick)
    cells = rank_cells(
        session, session.upload(pack_bits(boundary)), cell_shape(shape, brick), brick
    )
    for face in faces:
        single = vertices, face[None]
        found = mark_voxels(session, facets_of(session, single), bits, shape, cells)
        edge = touched(*single, bits, shape, (1, 1, 1))
        expected = pack_bricks(bricks_at(edge, boundary, brick))
        np.testing.assert_array_equal(found.get(), expected, strict=True)


@pytest.mark.parametrize("triangles", [0, 1, 255, 256, 257, 600])
def test_flat_triangles_are_counted(session: Session, triangles: int) -> None:
    """Work-items count 256 each."""
    flat, flat_faces = flat_triangles(37, max(triangles, 1), 8, SMALL)
    spots, faces = soup(37, max(triangles, 1), 8, SMALL)
    rng = np.random.default_rng(37)
    kept = np.concatenate([flat_faces, faces + len(flat)])
    kept = kept[rng.permutation(len(kept))[:triangles]]
    vertices = np.concatenate([flat, spots])
    expected = 0
    for a, b, c in vertices[kept].tolist():
        (px, py, pz), (qx, qy, qz) = (
            [s - t for s, t in zip(corner, a, strict=True)] for corner in (b, c)
        )
        expected += (py * qz, pz * qx, px * qy) == (pz * qy, px * qz, py * qx)
    facets = facets_of(session, (vertices, kept))
    assert count_flat(session, facets) == expected
    assert mark_and_count(session, facets, 8, SMALL, (8, 8, 8))[1] == expected
    assert triangles < 2 or 0 < expected < triangles


def test_triangles_that_are_nearly_flat_are_not_counted(session: Session) -> None:
    """Over all of the lattice, with an area of one square step: products differ in the last bit."""
    far = 2**24 - 1
    vertices = np.array([[0, 0, 0], [far, far - 1, 0], [far - 1, far - 2, 0], [2, 2, 2]])
    faces = np.array([[0, 1, 2], [1, 2, 0], [0, 3, 3]], dtype=np.int32)
    facets = facets_of(session, (vertices, faces))
    assert count_flat(session, facets) == 1
    assert mark_and_count(session, facets, 8, SMALL, (1, 1, 1))[1] == 1


SIGNS = """
__kernel void signs(
    const ulong n, const __global float *estimates, const __global ulong *words,
    __global long *found)
{
    const size_t id = get_global_id(0);
    if (id < n) found[id] = exact_sign(estimates[id], words[id]);
}

__kernel void terms(
    const ulong n, const __global long *normals, const __global int *steps,
    __global float *estimates, __global long *found)
{
    const size_t id = get_global_id(0);
    if (id >= n) return;
    const long nu = normals[3 * id], nv = normals[3 * id + 1], nw = normals[3 * id + 2];
    const int u = steps[3 * id], v = steps[3 * id + 1], w = steps[3 * id + 2];
    estimates[id] = (float)nu * (float)u + (float)nv * (float)v + (float)nw * (float)w;
    found[id] = exact_sign(
        estimates[id],
        (ulong)nu * (ulong)(long)u + (ulong)nv * (ulong)(long)v + (ulong)nw * (ulong)(long)w);
}
"""


def sign(number: int) -> int:
    return (number > 0) - (number < 0)


def test_sign_is_exact_for_every_estimate_within_its_bound(session: Session) -> None:
    """The argument itself: the estimate may be wrong by as much as 2**60, either way."""
    rng = np.random.default_rng(38)
    powers = [0, 1, 2**59, 2**60, 2**61 - 2**60, 2**61, 2**61 + 2**60, 2**62, 2**63, 2**64, 2**65]
    powers += [2**63 - 2**60, 2**63 + 2**60, 2**64 + 2**63, 2**70, 2**74]
    near = [0, 1, 2, *(int(x) for x in rng.integers(0, 2**60, 6))]
    values = {s * p + t * e for p in powers for e in near for s in (-1, 1) for t in (-1, 1)}
    numbers, estimates = [], []
    for value in sorted(values):
        for error in (0, 2**60 - 2**38, -(2**60) + 2**38, 2**59, -(2**59)):
            estimate = np.float32(value + error)
            if abs(int(estimate) - value) < 2**60:
                numbers.append(value)
                estimates.append(estimate)
    words = np.array([number % 2**64 for number in numbers], dtype=np.uint64)
    found = session.empty(len(numbers), np.int64)
    session.run(
        *(
            build(session, read_source("common/exact_sign.h") + SIGNS, "signs"),
            len(numbers),
            np.uint64(len(numbers)),
        ),
        *(session.upload(np.array(estimates)), session.upload(words), found),
    )
    assert np.sign(found.get()).tolist() == [sign(number) for number in numbers]
    # It is the wrapped word alone, and the estimate alone, that would not do.
    assert (np.sign(words.view(np.int64)) != [sign(n) for n in numbers]).any()
    assert (np.sign(estimates) != [sign(n) for n in numbers]).any()


def test_plane_terms_keep_the_bound_and_the_sign(session: Session) -> None:
    """Normals to 2**48, distances to 2**24 + 2**20, and sums from 0 to beyond 2**63."""
    rng = np.random.default_rng(39)
    count = 3000
    most, far = 2**48, 2**24 + 2**20
    normals = np.rint(rng.uniform(-1, 1, (count, 3)) * most).astype(np.int64)
    steps = np.rint(rng.uniform(-1, 1, (count, 3)) * far).astype(np.int64)
    # Steps along w that bring the sum near a target, which is 0, or about the limits.
    goals = [0, *(s * 2**p + t for p in (60, 61, 62, 63, 64) for s in (-1, 1) for t in (-1, 0, 1))]
    for i in range(0, count, 2):
        rest = sum(int(n) * int(s) for n, s in zip(normals[i, :2], steps[i, :2], strict=True))
        nw = int(normals[i, 2]) or 1
        steps[i, 2] = min(max((goals[i % len(goals)] - rest) // nw, -far), far)
    normals[:6], steps[:6] = most, far
    normals[1], steps[3], normals[5] = -most, -far, (most, -most, 1)
    estimates, found = session.empty(count, np.float32), session.empty(count, np.int64)
    session.run(
        *(
            build(session, read_source("common/exact_sign.h") + SIGNS, "terms"),
            count,
            np.uint64(count),
            session.upload(normals),
        ),
        *(session.upload(steps.astype(np.int32)), estimates, found),
    )
    true = [
        sum(n * s for n, s in zip(row, step, strict=True))
        for row, step in zip(normals.tolist(), steps.tolist(), strict=True)
    ]
    assert max(map(abs, true)) > 2**73
    assert sum(abs(value) < 2**63 for value in true) > 100
    errors = [abs(int(e) - t) for e, t in zip(estimates.get().tolist(), true, strict=True)]
    assert max(errors) < 2**60
    assert np.sign(found.get()).tolist() == [sign(value) for value in true]
