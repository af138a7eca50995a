"""Normals and triangles of touched voxels are those of the twin, which adds up all pairs."""

from __future__ import annotations

import numpy as np
import pytest

from clvox.device import Session
from clvox.device.source import read_source
from clvox.grid import Shape
from clvox.ops.attributes import (
    Touched,
    faces_of,
    link_faces,
    normals_of,
    number_touched,
    sum_normals,
)
from clvox.ops.boundary import mark_cells, mark_voxels
from clvox.ops.facets import Facets
from clvox.ops.layout import VoxelArrays, cell_shape
from clvox.ops.multilevel import rank_cells
from clvox.reference.attributes import (
    NO_NORMAL,
    cell_faces,
    pack_normal,
    unpack_normals,
    voxel_normals,
)
from clvox.reference.boundary import touching
from tests.kernels.cases import build, facets_of, flat_triangles, meshes_for, some, soup
from tests.strategies import Mesh

# Lattice bits, shape, brick, how triangles are spread over work-items, voxels in a pass.
CASES: list[tuple[int, Shape, Shape | None, int, int, int]] = [
    (8, (9, 8, 7), None, 64, 16, 1 << 20),
    (9, (10, 9, 8), (3, 5, 2), 1, 2, 1 << 20),
    (11, (17, 20, 19), (8, 8, 8), 64, 16, 100),
    (7, (35, 5, 4), None, 0, 2, 7),
    (10, (12, 11, 10), (4, 4, 4), 0, 1, 1 << 20),
]
every_case = pytest.mark.parametrize(("bits", "shape", "brick", "direct", "tile", "most"), CASES)


def touched_by(
    session: Session, facets: Facets, bits: int, shape: Shape, brick: Shape | None
) -> Touched:
    """The voxels that a mesh touches, of a model that has no others."""
    if brick is None:
        edge = mark_cells(session, facets, bits, shape, (1, 1, 1))
        return number_touched(session, VoxelArrays(shape, edge), edge)
    marks = mark_cells(session, facets, bits, shape, brick)
    cells = rank_cells(session, marks, cell_shape(shape, brick), brick)
    edge = mark_voxels(session, facets, bits, shape, cells)
    inside = session.zeros(marks.shape, np.uint32)
    return number_touched(session, VoxelArrays(shape, edge, cells, inside), edge)


def cases(bits: int, shape: Shape) -> list[Mesh]:
    meshes = [*meshes_for(3, some(3, 1), bits, shape), flat_triangles(4, some(20), bits, shape)]
    return [(vertices, faces.astype(np.int32)) for vertices, faces in meshes if len(faces)]


def given_normals(seed: int, count: int, largest: int) -> np.ndarray:
    """Few different ones, so that sums often vanish, and some that are 0."""
    rng = np.random.default_rng(seed)
    few = rng.integers(-largest, largest + 1, (3, 3))
    table = np.concatenate([few, -few, [[0, 0, 0]]])
    return table[rng.integers(len(table), size=count)].astype(np.int32)


def places(shape: Shape) -> np.ndarray:
    """All voxels (i, j, k), and none."""
    k, j, i = np.indices(shape[::-1]).reshape(3, -1)
    return np.concatenate([np.stack([i, j, k], axis=1), [[-1, 0, 0]]]).astype(np.int32)


@every_case
@pytest.mark.parametrize("largest", [32767, 2**30])
def test_normals(
    session: Session,
    bits: int,
    shape: Shape,
    brick: Shape | None,
    direct: int,
    tile: int,
    most: int,
    largest: int,
) -> None:
    for number, mesh in enumerate(cases(bits, shape)):
        facets = facets_of(session, mesh)
        normals = given_normals(number, len(mesh[1]), largest)
        touched = touched_by(session, facets, bits, shape, brick)
        packed = sum_normals(
            session, facets, bits, touched, normals, direct=direct, tile=tile, most=most
        )
        expected = voxel_normals(touching(*mesh, bits, shape, (1, 1, 1)), normals)
        asked = places(shape)
        got = normals_of(session, touched, packed, asked)
        wanted = [expected.get((i, j, k), NO_NORMAL) for i, j, k in asked.tolist()]
        np.testing.assert_array_equal(got, np.array(wanted, np.uint32))


@pytest.mark.parametrize(("bits", "shape", "brick", "direct", "tile"), [case[:5] for case in CASES])
def test_links(
    session: Session, bits: int, shape: Shape, brick: Shape | None, direct: int, tile: int
) -> None:
    side = brick or (1, 1, 1)
    for mesh in cases(bits, shape):
        facets = facets_of(session, mesh)
        touched = touched_by(session, facets, bits, shape, brick)
        offsets, faces = link_faces(session, facets, bits, touched, direct=direct, tile=tile)
        rows = cell_faces(touching(*mesh, bits, shape, side))
        assert touched.cell_count == len(rows)
        asked = places(shape)
        ends, found = faces_of(session, touched, offsets, faces, asked)
        for number, voxel in enumerate(asked.tolist()):
            cell = tuple(at // width for at, width in zip(voxel, side, strict=True))
            row = found[ends[number] : ends[number + 1]].tolist()
            assert row == rows.get((cell[0], cell[1], cell[2]), [])


@pytest.mark.parametrize("count", [15, 16, 17, 1300])
def test_many_triangles_in_one_voxel(session: Session, count: int) -> None:
    """Sums that need more than 32 bits, and a row that is too long to be sorted at once."""
    bits, shape = 9, (2, 2, 2)
    corners = np.random.default_rng(1).integers(-200, 200, (3 * count, 3))
    mesh = corners, np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    facets = facets_of(session, mesh)
    touched = touched_by(session, facets, bits, shape, (2, 2, 2))
    normals = np.full((count, 3), (2**30, -(2**30), 5), np.int32)
    packed = sum_normals(session, facets, bits, touched, normals)
    answer = normals_of(session, touched, packed, np.zeros((1, 3), np.int32))
    assert answer.tolist() == [pack_normal(2**30, -(2**30), 5)]
    _, found = faces_of(
        session, touched, *link_faces(session, facets, bits, touched), np.zeros((1, 3), np.int32)
    )
    assert found.tolist() == list(range(count))


@pytest.mark.parametrize("brick", [None, (4, 4, 4)])
def test_nothing_touched(session: Session, brick: Shape | None) -> None:
    mesh = np.full((3, 3), 1 << 20), np.array([[0, 1, 2]], np.int32)
    facets = facets_of(session, mesh)
    touched = touched_by(session, facets, 8, (8, 8, 8), brick)
    packed = sum_normals(session, facets, 8, touched, np.ones((1, 3), np.int32))
    offsets, faces = link_faces(session, facets, 8, touched)
    asked = places((8, 8, 8))
    assert (normals_of(session, touched, packed, asked) == NO_NORMAL).all()
    assert faces_of(session, touched, offsets, faces, asked)[0].max() == 0
    assert len(normals_of(session, touched, packed, asked[:0])) == 0
    assert faces_of(session, touched, offsets, faces, asked[:0])[0].tolist() == [0]


def directions() -> np.ndarray:
    """Vectors of all lengths, many of them on axes and in the planes between them."""
    rng = np.random.default_rng(2)
    small = np.stack(np.meshgrid(*[np.arange(-3, 4)] * 3), axis=-1).reshape(-1, 3)
    lengths = np.exp2(rng.uniform(0, 44, (500, 1)))
    return np.concatenate([small, rng.normal(size=(500, 3)) * lengths]).astype(np.int64)


PACK = """
__kernel void pack(const __global long *vectors, __global uint *packed, __global float *unpacked)
{
    const size_t id = get_global_id(0);
    packed[id] = pack_normal(vectors[3 * id], vectors[3 * id + 1], vectors[3 * id + 2]);
    const float4 vector = unpack_normal(packed[id]);
    unpacked[3 * id] = vector.x;
    unpacked[3 * id + 1] = vector.y;
    unpacked[3 * id + 2] = vector.z;
}
"""


def test_packed_directions(session: Session) -> None:
    """Equal to the twin's, and within a ten-thousandth of what they were."""
    vectors = directions()
    kernel = build(session, read_source("attributes/octahedral.h") + PACK, "pack")
    packed = session.empty(len(vectors), np.uint32)
    unpacked = session.empty((len(vectors), 3), np.float32)
    session.run(kernel, len(vectors), session.upload(vectors), packed, unpacked, group=1)
    expected = np.array([pack_normal(*vector) for vector in vectors.tolist()], np.uint32)
    np.testing.assert_array_equal(packed.get(), expected)
    there = vectors.any(axis=1)
    units = vectors[there] / np.linalg.norm(vectors[there], axis=1)[:, None]
    np.testing.assert_allclose(unpack_normals(expected[there]), units, atol=1e-4)
    got = unpacked.get()[there].astype(np.float64)
    np.testing.assert_allclose(got / np.linalg.norm(got, axis=1)[:, None], units, atol=1e-4)


def test_soups_touch_something() -> None:
    """Two programs that never find anything would agree, too."""
    mesh = soup(3, 8, 9, (10, 9, 8))
    assert len(voxel_normals(touching(*mesh, 9, (10, 9, 8), (1, 1, 1)), given_normals(1, 8, 9))) > 9
