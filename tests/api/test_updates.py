"""A model of an edited mesh, from the model before the edit, is that of the mesh voxelized anew."""

from __future__ import annotations

import gc
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

import clvox
from clvox.device import Session
from clvox.mesh import check
from clvox.models import updates
from clvox.models.attributes import Attribute
from clvox.models.build import Fill
from tests.api.test_fill import GRID, LEVELS, PAIRS, ball, box, every_level
from tests.strategies import FAMILIES, closed_meshes

BITS = 10


def voxelize(mesh: Any, *, levels: int = 2, fill: Fill = "parity") -> clvox.VoxelModel:
    return clvox.voxelize(mesh, grid=GRID, levels=LEVELS[levels], fill=fill, lattice_bits=BITS)


def assert_same(found: clvox.VoxelModel, expected: clvox.VoxelModel) -> None:
    """The same voxels, in the same bricks, and the same words about the mesh."""
    assert found == expected
    mine, theirs = found.to_record(), expected.to_record()
    for name, array in theirs.items():
        np.testing.assert_array_equal(mine[name], array)
    for word in ("fill", "triangles", "repeated", "duplicates", "cancelled", "collapsed",
                 "odd_rays", "lattice_bits", "warnings"):  # fmt: skip
        assert getattr(found.report, word) == getattr(expected.report, word)
    assert found.volume_bounds == expected.volume_bounds


def pulled(
    mesh: trimesh.Trimesh, toward: tuple[float, float, float], factor: float
) -> tuple[trimesh.Trimesh, NDArray[np.intp]]:
    """The mesh with the vertices on one side moved, and the triangles that changed."""
    vertices = np.array(mesh.vertices)
    reach = vertices @ toward
    moved = reach >= np.quantile(reach, 0.95)
    vertices[moved] *= factor
    changed = np.flatnonzero(moved[mesh.faces].any(axis=1))
    return trimesh.Trimesh(vertices, mesh.faces, process=False), changed


@every_level
@pytest.mark.parametrize("pair", PAIRS)
def test_an_update_is_the_edited_mesh_voxelized_anew(pair: str, levels: int) -> None:
    one, other = PAIRS[pair]
    mesh = one + other
    model = voxelize(mesh, levels=levels)
    for toward, factor in (((1.0, 0.2, 0.1), 1.3), ((-0.3, 1.0, 0.0), 0.6)):
        edited, changed = pulled(mesh, toward, factor)
        assert len(changed)
        found = model.updated(edited, changed=changed)
        expected = voxelize(edited, levels=levels)
        assert_same(found, expected)
        assert found != model
        # And back, from the update.
        assert_same(found.updated(mesh, changed=changed), model)


def lattice_positions(vertices: NDArray[np.int64]) -> NDArray[np.float64]:
    return GRID.origin + (vertices / 2.0**BITS + 0.5) * GRID.spacing


@given(
    mesh=closed_meshes(BITS, (45, 29, 27), [name for name in FAMILIES if name != "wide"]),
    seed=st.integers(0, 999),
)
def test_any_vertices_may_move_onto_one_another(mesh: Any, seed: int) -> None:
    """The check then drops other triangles than before."""
    positions, faces = mesh
    rng = np.random.default_rng(seed)
    after = positions.copy()
    some = rng.choice(len(after), min(2, len(after)), replace=False)
    after[some[0]] = after[some[-1] - 1]
    after[some[-1]] += rng.integers(-3 << BITS, 3 << BITS, 3)
    before, edited = (lattice_positions(where) for where in (positions, after))
    changed = np.flatnonzero((positions != after).any(axis=1)[faces].any(axis=1))
    try:
        model, expected = voxelize((before, faces)), voxelize((edited, faces))
    except (clvox.MeshError, clvox.GridError):
        return
    assert_same(model.updated((edited, faces), changed=changed), expected)


def test_more_triangles_may_be_listed_than_have_changed() -> None:
    mesh = PAIRS["balls"][0]
    model = voxelize(mesh)
    edited, changed = pulled(mesh, (0.0, 0.0, 1.0), 1.1)
    every = np.arange(len(mesh.faces))
    assert_same(model.updated(edited, changed=every), voxelize(edited))
    doubled = [*changed.tolist(), *changed.tolist()]
    assert_same(model.updated(edited, changed=doubled), voxelize(edited))
    assert_same(model.updated(mesh, changed=[]), model)


def test_triangles_may_be_joined_in_another_way() -> None:
    """An edge may be flipped: the mesh stays closed although no vertex moves."""
    mesh = box((0.0, 0.0, 0.0), (1.0, 0.8, 1.1))
    mesh.vertices[0] -= 0.3
    model = voxelize(mesh)
    faces = np.array(mesh.faces)
    pair = mesh.face_adjacency[0]
    (a, b), (c, d) = mesh.face_adjacency_edges[0], mesh.face_adjacency_unshared[0]
    first = faces[pair[0]].tolist()
    if first[(first.index(a) + 1) % 3] != b:
        a, b = b, a
    faces[pair] = [[c, a, d], [c, d, b]]
    edited = trimesh.Trimesh(mesh.vertices, faces, process=False)
    assert edited.is_watertight
    assert edited.volume != mesh.volume
    assert_same(model.updated(edited, changed=pair), voxelize(edited))


def test_one_vertex_may_part_and_another_be_joined() -> None:
    """As many vertices are left, and yet they have other numbers."""
    corner = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    vertices = np.concatenate([-corner, corner, corner * [1, -1, -1] - [0, 0.5, 0]])
    bodies = np.concatenate([faces, faces + 4, faces + 8])
    moved = vertices.copy()
    moved[0] = -0.1
    moved[8] = 0.0
    before, after = ((each, bodies) for each in (vertices, moved))
    surfaces = check(before), check(after)
    assert len(surfaces[0].vertices) == len(surfaces[1].vertices) == 11
    changed = np.flatnonzero(np.isin(bodies, [0, 8]).any(axis=1))
    assert_same(voxelize(before).updated(after, changed=changed), voxelize(after))


@pytest.mark.parametrize("fill", ["nonzero", "positive", "surface", "vote", "winding"])
def test_other_fills_are_done_anew(fill: Fill) -> None:
    mesh = PAIRS["balls"][0] + PAIRS["balls"][1]
    model = voxelize(mesh, fill=fill)
    edited, changed = pulled(mesh, (0.0, 0.0, 1.0), 1.1)
    assert_same(model.updated(edited, changed=changed), voxelize(edited, fill=fill))


def test_the_peak_is_that_of_the_update_alone(session: Session) -> None:
    """Attributes included; models that are there do not count."""
    mesh = PAIRS["balls"][0]
    edited, changed = pulled(mesh, (1.0, 0.2, 0.1), 1.3)
    peaks = []
    attributes: list[tuple[Attribute, ...]] = [(), ("normals", "links")]
    for names in attributes:
        model = clvox.voxelize(mesh, grid=GRID, lattice_bits=BITS, attributes=names)
        alone = model.updated(edited, changed=changed)
        kept = session.zeros(1 << 20, np.uint32)
        report = model.updated(edited, changed=changed).report
        assert alone.nbytes <= report.peak_nbytes == alone.report.peak_nbytes < kept.nbytes
        peaks.append(report.peak_nbytes)
    assert peaks[0] < peaks[1]


def test_an_update_that_is_ended_gives_its_memory_back(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    mesh = PAIRS["balls"][0]
    edited, changed = pulled(mesh, (1.0, 0.2, 0.1), 1.3)
    model = voxelize(mesh)
    expected = model.updated(edited, changed=changed)

    def stop(*_: Any) -> None:
        raise KeyboardInterrupt

    gc.collect()
    before = session.nbytes
    monkeypatch.setattr(updates, "count_flat", stop)
    with pytest.raises(KeyboardInterrupt) as caught:
        model.updated(edited, changed=changed)
    assert session.nbytes == before, caught
    monkeypatch.undo()
    assert model.updated(edited, changed=changed) == expected


def test_a_pickled_model_can_be_updated() -> None:
    mesh = PAIRS["balls"][0]
    model = pickle.loads(pickle.dumps(voxelize(mesh)))  # noqa: S301
    edited, changed = pulled(mesh, (0.0, 0.0, 1.0), 1.1)
    assert_same(model.updated(edited, changed=changed), voxelize(edited))


def test_a_triangle_that_is_not_listed_must_not_move() -> None:
    mesh = PAIRS["balls"][0]
    edited, changed = pulled(mesh, (0.0, 0.0, 1.0), 1.1)
    words = f"triangle {changed[0]} is not where it was, and not in changed; nor are 1 more"
    with pytest.raises(clvox.MeshError, match=words):
        voxelize(mesh).updated(edited, changed=changed[1:-1])


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ([0, 1280], "changed names triangle 1280; the mesh has 1280"),
        ([-1], "changed names triangle -1"),
        ([0.5], "float64 of the shape"),
        ([[1, 2]], r"int64 of the shape \(1, 2\)"),
        ([True], "bool of the shape"),
    ],
)
def test_numbers_that_name_no_triangle_are_refused(changed: Any, words: str) -> None:
    mesh = PAIRS["balls"][0]
    assert len(mesh.faces) == 1280
    with pytest.raises(clvox.MeshError, match=words):
        voxelize(mesh).updated(mesh, changed=changed)


def test_another_number_of_triangles_is_refused() -> None:
    with pytest.raises(clvox.MeshError, match="the edited mesh has 12 triangles, the model's has"):
        voxelize(PAIRS["balls"][0]).updated(PAIRS["boxes"][0], changed=[0])


def test_an_edit_must_leave_the_mesh_closed() -> None:
    mesh = box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    faces = np.array(mesh.faces)
    torn = np.concatenate([mesh.vertices, [[0.5, 0.5, 2.0]]])
    faces[3, 0] = 8
    with pytest.raises(clvox.NotClosedError):
        voxelize(mesh).updated((torn, faces), changed=[3])


def test_an_edit_must_stay_on_the_lattice() -> None:
    mesh = ball(1.0, 0, 0, 0)
    model = clvox.voxelize(mesh, grid=GRID)
    edited, changed = pulled(mesh, (0.0, 0.0, 1.0), 400.0)
    with pytest.raises(clvox.GridError, match="leaves no room"):
        model.updated(edited, changed=changed)


def test_models_of_no_mesh_or_of_several_are_not_updated(tmp_path: Path) -> None:
    mesh = PAIRS["balls"][0]
    model = voxelize(mesh)
    model.save(tmp_path / "model.npz")
    for other in (
        clvox.open(tmp_path / "model.npz"),
        clvox.VoxelModel.from_array(model.to_array(), GRID),
        model | model,
        ~model,
        model.compact(),
    ):
        with pytest.raises(clvox.MeshError, match="not that of one mesh"):
            other.updated(mesh, changed=[])


def test_a_scan_is_updated(data_file: Callable[[str], Path]) -> None:
    surface = check(clvox.load(data_file("scans/stanford_bunny_closed_70k.ply")))
    mesh = trimesh.Trimesh(surface.vertices, surface.faces, process=False)
    model = clvox.voxelize(mesh, resolution=256)
    edited, changed = pulled(mesh, (1.0, 0.0, 0.0), 0.9)
    expected = clvox.voxelize(edited, grid=model.grid, lattice_bits=model.report.lattice_bits)
    assert_same(model.updated(edited, changed=changed), expected)
