"""The majority of three axes is that of the twin, on open meshes; on closed ones it is parity."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from clvox.grid import Shape
from clvox.ops.combine import rebrick
from clvox.ops.facets import upload_facets
from clvox.ops.layout import VoxelArrays, cell_shape
from clvox.ops.parity import fill_parity
from clvox.ops.vote import add_curtain, fill_vote, odd_rays
from clvox.reference import vote as twin
from clvox.reference.boundary import touched
from clvox.reference.crossings import AXES
from clvox.reference.crossings import fill_parity as twin_parity
from tests.kernels.cases import INTERPRETED, soup
from tests.kernels.models import assert_same_arrays
from tests.strategies import FAMILIES, Mesh, adversarial_meshes, closed_meshes

if TYPE_CHECKING:
    from clvox.device import Session

BITS = 8
SHAPE: Shape = (9, 8, 7)
LEVELS: dict[str, tuple[Shape, ...]] = {
    "dense": (SHAPE,),
    "bricks of 8": ((2, 1, 1), (8, 8, 8)),
    "small bricks": ((3, 2, 4), (3, 4, 2)),
    "three levels": ((2, 2, 1), (2, 3, 2), (3, 2, 4)),
}

every_level = pytest.mark.parametrize("levels", LEVELS)


def odd_edges(faces: NDArray[np.int32]) -> NDArray[np.int32]:
    """The edges that belong to an odd number of triangles, as `clvox.mesh.check` finds them."""
    uses = Counter(
        (min(a, b), max(a, b))
        for corners in faces.tolist()
        for a, b in zip(corners, corners[1:] + corners[:1], strict=True)
        if a != b
    )
    edges = [edge for edge, count in uses.items() if count % 2]
    return np.array(edges, dtype=np.int32).reshape(-1, 2)


def opened(mesh: Mesh, kept: int) -> Mesh:
    """The mesh without its last triangles: *kept* of sixteen parts are left."""
    vertices, faces = mesh
    return vertices, faces[: max(1, len(faces) * kept // 16)]


def voxels_of(session: Session, arrays: VoxelArrays) -> NDArray[np.bool_]:
    """All voxels, (nz, ny, nx)."""
    words = rebrick(session, arrays, (arrays.shape,)).voxels.get().view(np.uint8)
    count = arrays.shape[0]
    return np.unpackbits(words, axis=-1, count=count, bitorder="little").astype(np.bool_)


def vote(session: Session, mesh: Mesh, levels: str) -> VoxelArrays:
    vertices, faces = mesh[0].astype(np.int32), mesh[1]
    return fill_vote(session, vertices, faces, odd_edges(faces), BITS, SHAPE, LEVELS[levels])


@every_level
@given(mesh=closed_meshes(BITS, SHAPE), kept=st.integers(1, 16))
def test_the_majority_is_that_of_the_twin(
    session: Session, levels: str, mesh: Mesh, kept: int
) -> None:
    part = opened(mesh, kept)
    expected = twin.fill_vote(*part, BITS, SHAPE)
    np.testing.assert_array_equal(voxels_of(session, vote(session, part, levels)), expected)


@pytest.mark.parametrize("family", FAMILIES)
def test_the_majority_is_that_of_the_twin_in_every_family(session: Session, family: str) -> None:
    for mesh in adversarial_meshes(31, 1 if INTERPRETED else 3, BITS, SHAPE, families=[family]):
        part = opened(mesh, 11)
        found = voxels_of(session, vote(session, part, "bricks of 8"))
        np.testing.assert_array_equal(found, twin.fill_vote(*part, BITS, SHAPE))


def test_triangles_that_share_nothing_are_voted_on(session: Session) -> None:
    mesh = soup(32, 4 if INTERPRETED else 40, BITS, SHAPE)
    for levels in ("dense", "small bricks"):
        found = voxels_of(session, vote(session, mesh, levels))
        np.testing.assert_array_equal(found, twin.fill_vote(*mesh, BITS, SHAPE))


@pytest.mark.parametrize("levels", ["small bricks", "three levels"])
@given(mesh=closed_meshes(BITS, SHAPE))
def test_on_a_closed_mesh_it_is_parity_with_the_same_arrays(
    session: Session, levels: str, mesh: Mesh
) -> None:
    vertices, faces = mesh[0].astype(np.int32), mesh[1]
    facets = upload_facets(session, vertices, faces)
    parity = fill_parity(session, facets, BITS, SHAPE, LEVELS[levels])
    nothing = np.empty((0, 2), np.int32)
    found = fill_vote(session, vertices, faces, nothing, BITS, SHAPE, LEVELS[levels])
    assert_same_arrays(found, parity)


@given(mesh=closed_meshes(BITS, SHAPE), kept=st.integers(1, 16))
def test_touched_cells_keep_their_bricks(session: Session, mesh: Mesh, kept: int) -> None:
    vertices, faces = opened(mesh, kept)
    arrays = vote(session, (vertices, faces), "small bricks")
    cells, size = LEVELS["small bricks"]
    assert arrays.cells is not None
    boundary = arrays.cells.boundary.get().view(np.uint8)
    found = np.unpackbits(boundary, axis=-1, count=cells[0], bitorder="little").astype(np.bool_)
    expected = touched(vertices, faces, BITS, SHAPE, size)
    voxels = twin.fill_vote(vertices, faces, BITS, SHAPE)
    counts = cell_shape(SHAPE, size)
    for k, j, i in np.ndindex(counts[::-1]):
        block = voxels[
            k * size[2] : (k + 1) * size[2],
            j * size[1] : (j + 1) * size[1],
            i * size[0] : (i + 1) * size[0],
        ]
        differ = block.any() and not block.all()
        assert found[k, j, i] == (expected[k, j, i] or differ)


@pytest.mark.parametrize("axis", AXES)
@given(mesh=closed_meshes(BITS, SHAPE), kept=st.integers(1, 15))
def test_a_curtain_closes_the_mesh_and_is_not_seen_along_its_axis(
    axis: str, mesh: Mesh, kept: int
) -> None:
    vertices, faces = opened(mesh, kept)
    edges, number = odd_edges(faces), "xyz".index(axis)
    closed = add_curtain(vertices.astype(np.int32), faces, edges, BITS, SHAPE, number)
    assert not len(odd_edges(closed[1]))
    expected = twin_parity(vertices, faces, BITS, SHAPE, axis)  # type: ignore[arg-type]
    np.testing.assert_array_equal(twin_parity(*closed, BITS, SHAPE, "y"), expected)


@given(mesh=closed_meshes(BITS, SHAPE), kept=st.integers(1, 16))
def test_odd_rays_are_those_of_the_twin(session: Session, mesh: Mesh, kept: int) -> None:
    vertices, faces = opened(mesh, kept)
    facets = upload_facets(session, vertices.astype(np.int32), faces)
    found = [list(map(tuple, rays.tolist())) for rays in odd_rays(session, facets, BITS, SHAPE)]
    assert found == twin.odd_rays(vertices, faces, BITS, SHAPE)
