"""Arrays after an edit are those of the edited mesh built anew; near triangles are the twin's."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from clvox.grid import Shape
from clvox.ops.facets import upload_facets
from clvox.ops.layout import VoxelArrays, cell_shape
from clvox.ops.parity import fill_parity
from clvox.ops.update import MOST, Edit, list_near, update
from clvox.reference import update as twin
from clvox.reference.multilevel import pack_bits
from tests.kernels.cases import INTERPRETED, meshes_for
from tests.kernels.models import assert_same_arrays
from tests.kernels.test_vote import BITS, LEVELS, SHAPE, every_level
from tests.strategies import FAMILIES, Mesh, Seeded, adversarial_meshes, closed_meshes, points

if TYPE_CHECKING:
    from clvox.device import Session


def moved(mesh: Mesh, seed: int, count: int) -> Mesh:
    """The mesh with *count* vertices elsewhere: what is closed stays closed."""
    source = Seeded(np.random.default_rng(seed), BITS, SHAPE)
    vertices = mesh[0].copy()
    chosen = source.rng.choice(len(vertices), min(count, len(vertices)), replace=False)
    vertices[chosen] = points(source, len(chosen)).reshape(-1, 3)
    return vertices, mesh[1]


def edit_between(before: Mesh, after: Mesh) -> Edit:
    """The triangles with a vertex that moved."""
    changed = (before[0] != after[0]).any(axis=1)[before[1]].any(axis=1)
    one, other = (mesh[0].astype(np.int32)[mesh[1][changed]] for mesh in (before, after))
    return Edit(one, other)


def built(session: Session, mesh: Mesh, levels: str) -> VoxelArrays:
    facets = upload_facets(session, mesh[0].astype(np.int32), mesh[1])
    return fill_parity(session, facets, BITS, SHAPE, LEVELS[levels])


def assert_updated(session: Session, before: Mesh, after: Mesh, levels: str) -> None:
    arrays = built(session, before, levels)
    facets = upload_facets(session, after[0].astype(np.int32), after[1])
    found = update(session, arrays, facets, edit_between(before, after), BITS)
    assert_same_arrays(found, built(session, after, levels))


@every_level
@given(mesh=closed_meshes(BITS, SHAPE), seed=st.integers(0, 99), count=st.integers(0, 4))
def test_an_update_is_the_edited_mesh_built_anew(
    session: Session, levels: str, mesh: Mesh, seed: int, count: int
) -> None:
    assert_updated(session, mesh, moved(mesh, seed, count), levels)


@pytest.mark.parametrize("family", FAMILIES)
def test_updates_are_right_in_every_family(session: Session, family: str) -> None:
    for mesh in adversarial_meshes(51, 1 if INTERPRETED else 3, BITS, SHAPE, families=[family]):
        for levels in ("bricks of 8", "small bricks"):
            assert_updated(session, mesh, moved(mesh, 52, 1), levels)


@pytest.mark.parametrize("side", [(1, 1, 1), (3, 4, 2), (8, 8, 8)])
def test_near_triangles_are_those_of_the_twin(session: Session, side: Shape) -> None:
    counts = cell_shape(SHAPE, side)
    rng = np.random.default_rng(53)
    whole = np.array([[-(2**24)] * 3, [2**24] * 3])
    for mesh in meshes_for(54, 60, BITS, SHAPE):
        # Mostly few, so that large triangles are near no marked cell.
        marks: NDArray[np.bool_] = rng.random(counts[::-1]) < rng.choice([0.0, 0.003, 0.1])
        vertices, faces = mesh[0].astype(np.int32), mesh[1]
        words = session.upload(pack_bits(marks))
        facets = upload_facets(session, vertices, faces)
        found = list_near(session, facets, BITS, counts, side, words, whole).faces.get()
        expected = twin.list_near(vertices, faces, BITS, side, marks, MOST)
        assert sorted(map(tuple, found.tolist())) == sorted(expected)


def test_no_triangle_is_near_beyond_the_box(session: Session) -> None:
    vertices, faces = adversarial_meshes(55, 1, BITS, SHAPE, families=["ball"])[0]
    counts = cell_shape(SHAPE, (1, 1, 1))
    words = session.upload(pack_bits(np.ones(counts[::-1], np.bool_)))
    facets = upload_facets(session, vertices.astype(np.int32), faces)
    low = vertices[faces].min(axis=1)
    for first in np.unique(low[:, 0]).tolist():
        box = np.array([[first - 1, -(2**24), -(2**24)], [first, 2**24, 2**24]])
        found = list_near(session, facets, BITS, counts, (1, 1, 1), words, box).faces.get()
        far = {tuple(row) for row in faces[low[:, 0] > first].tolist()}
        assert not far & set(map(tuple, found.tolist()))
