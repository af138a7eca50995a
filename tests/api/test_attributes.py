"""What a model keeps of its mesh: normals and triangles, seen from outside."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest
import trimesh

import clvox

LEVELS: tuple[Any, ...] = (None, [(24, 24, 24)], [(3, 3, 3), (2, 2, 2), (4, 4, 4)])


@pytest.fixture(scope="module")
def ball() -> trimesh.Trimesh:
    made: trimesh.Trimesh = trimesh.creation.icosphere(radius=10.0, subdivisions=4)
    return made


@pytest.mark.parametrize("levels", LEVELS)
@pytest.mark.parametrize("name", ["normals", "area_normals"])
def test_normals_of_a_ball_point_away_from_its_middle(
    ball: trimesh.Trimesh, levels: Any, name: Any
) -> None:
    model = clvox.voxelize(ball, resolution=24, levels=levels, attributes=(name,))
    points = ball.triangles_center
    normals = model.normals_at(points)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    cosines = (normals * points).sum(axis=1) / np.linalg.norm(points, axis=1)
    assert np.degrees(np.arccos(cosines.clip(-1, 1))).max() < 5


def test_weights_matter_where_triangles_differ_in_size() -> None:
    """A box whose top is cut into many triangles: at its rim they outvote the two of a side."""
    box = trimesh.creation.box((2, 2, 2))
    top = box.triangles_center[:, 2] > 0.9
    fine = box.subdivide(np.nonzero(top)[0])
    grid = clvox.Grid((-2, -2, -2), 1.0, (4, 4, 4))
    mean = clvox.voxelize(fine, grid=grid, attributes=("normals",), fill="surface")
    weighted = clvox.voxelize(fine, grid=grid, attributes=("area_normals",), fill="surface")
    rim = [[0.5, 0.5, 0.5]]
    assert mean.normals_at(rim)[0, 2] > weighted.normals_at(rim)[0, 2] + 0.05


def test_normals_are_there_exactly_where_the_mesh_touches(ball: trimesh.Trimesh) -> None:
    model = clvox.voxelize(ball, resolution=12, attributes=("normals",))
    points = model.grid.centers(np.argwhere(np.ones(model.grid.shape, bool)))
    touched = model.classify(points) == 2
    np.testing.assert_array_equal(model.normals_at(points).any(axis=1), touched)
    nowhere = [[99.0, 0, 0], [np.nan, 0, 0]]
    assert not model.normals_at(nowhere).any()


@pytest.mark.parametrize("levels", LEVELS)
def test_a_triangle_is_among_those_of_its_cell(ball: trimesh.Trimesh, levels: Any) -> None:
    model = clvox.voxelize(ball, resolution=24, levels=levels, attributes=("links",))
    offsets, faces = model.faces_at(ball.triangles_center)
    assert offsets.dtype == faces.dtype == np.int64
    for number in range(0, len(ball.faces), 7):
        row = faces[offsets[number] : offsets[number + 1]]
        assert number in row
        assert (np.diff(row) > 0).all()
    assert model.faces_at([[99.0, 0, 0], [np.nan, 0, 0]])[0].tolist() == [0, 0, 0]


def test_triangles_have_the_callers_numbers() -> None:
    """Also behind one that was dropped."""
    box = trimesh.creation.box((1, 1, 1))
    faces = np.concatenate([[[0, 0, 1]], box.faces])
    model = clvox.voxelize(
        (box.vertices, faces), resolution=4, levels=[(4, 4, 4)], attributes=("links",)
    )
    _, found = model.faces_at(box.vertices * 0.99)
    assert set(found.tolist()) == set(range(1, 13))


def test_attributes_count_as_memory_and_change_nothing_else(ball: trimesh.Trimesh) -> None:
    plain = clvox.voxelize(ball, resolution=24)
    sizes = [plain.nbytes]
    for names in (("edge",), ("edge", "normals"), ("normals", "links")):
        model = clvox.voxelize(ball, resolution=24, attributes=names)
        assert model == plain
        assert model.volume_bounds == plain.volume_bounds
        assert model.attributes == names
        assert "attributes" in model.report.seconds
        sizes.append(model.nbytes)
    assert sizes == sorted(set(sizes))


def test_attributes_survive_a_process(ball: trimesh.Trimesh) -> None:
    model = clvox.voxelize(ball, resolution=12, attributes=("normals",))
    again = pickle.loads(pickle.dumps(model))  # noqa: S301 - our own
    points = ball.vertices[:50]
    np.testing.assert_array_equal(again.normals_at(points), model.normals_at(points))


def test_what_a_model_does_not_keep_cannot_be_asked(ball: trimesh.Trimesh) -> None:
    plain = clvox.voxelize(ball, resolution=8)
    with_normals = clvox.voxelize(ball, resolution=8, attributes=("normals",))
    with_links = clvox.voxelize(ball, resolution=8, attributes=("links",))
    for model in (plain, with_normals | with_links):
        with pytest.raises(clvox.MeshError, match="keeps nothing of its mesh"):
            model.normals_at([[0, 0, 0]])
    with pytest.raises(clvox.MeshError, match="has no links"):
        with_normals.faces_at([[0, 0, 0]])
    with pytest.raises(clvox.MeshError, match="has no normals"):
        with_links.normals_at([[0, 0, 0]])


@pytest.mark.parametrize("names", ["normals", ("colour",), ("normals", "area_normals")])
def test_attributes_that_make_no_sense_are_refused(ball: trimesh.Trimesh, names: Any) -> None:
    with pytest.raises(clvox.GridError, match=r"attributes must be|ask for 'normals'"):
        clvox.voxelize(ball, resolution=8, attributes=names)


def test_an_updated_model_keeps_attributes_of_the_mesh_that_is(ball: trimesh.Trimesh) -> None:
    grid = clvox.Grid((-12, -12, -12), 1.0, (24, 24, 24))
    moved = ball.copy()
    moved.apply_translation((1.0, 0.5, 0.0))
    before = clvox.voxelize(ball, grid=grid, attributes=("normals", "links"))
    updated = before.updated(moved, changed=np.arange(len(ball.faces)))
    bits = before.report.lattice_bits
    fresh = clvox.voxelize(moved, grid=grid, lattice_bits=bits, attributes=("normals", "links"))
    points = moved.triangles_center
    np.testing.assert_array_equal(updated.normals_at(points), fresh.normals_at(points))
    np.testing.assert_array_equal(updated.faces_at(points)[1], fresh.faces_at(points)[1])
