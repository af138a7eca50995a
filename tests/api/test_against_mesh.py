"""Pictures of voxels beside pictures of their mesh, by a renderer of its own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

import clvox
from benchmarks.against_mesh import distance_to
from clvox.bench import meshes
from clvox.ops.raymarch import Pixels, march
from clvox.render.image import _scene
from tests.rasteriser import project, seen_triangles

SIZE = 240, 180
DATA = Path(__file__).parents[1] / "data"


def mesh_of(name: str) -> trimesh.Trimesh:
    if name == "plate":
        return clvox.load(DATA / "plate_with_holes.stl")
    surface = meshes.bumpy_sphere(4)
    return trimesh.Trimesh(surface.vertices, surface.faces, process=False)


def voxel_in_pixels(mesh: trimesh.Trimesh, model: clvox.VoxelModel, camera: clvox.Camera) -> float:
    """How long a voxel's diagonal is at most in a picture."""
    diagonal = float(np.linalg.norm(model.grid.spacing))
    aside = mesh.vertices + diagonal * camera.frame()[0]
    ends = [project(points, camera, SIZE)[0][:, 0] for points in (mesh.vertices, aside)]
    return float((ends[1] - ends[0]).max())


@pytest.mark.parametrize("name", ["ball", "plate"])
@pytest.mark.parametrize("parallel", [False, True])
@pytest.mark.parametrize("direction", [(-0.62, 1, -0.72), (0.1, 0.2, -1), (1, 0.3, 0.2)])
def test_silhouettes_are_those_of_the_mesh(
    name: str, parallel: bool, direction: tuple[float, float, float]
) -> None:
    """Up to what a voxel covers; and voxels that the mesh touches cover all of it."""
    mesh = mesh_of(name)
    model = clvox.voxelize(mesh, resolution=64, attributes=("normals",))
    camera = clvox.Camera.around(
        mesh, direction=direction, up=(0.1, 1, 0.3), parallel=parallel, aspect=SIZE[0] / SIZE[1]
    )
    shown = seen_triangles(mesh, camera, SIZE) >= 0
    assert 0.05 < shown.mean() < 0.8
    # The middle of a pixel that is covered may be half a diagonal of it farther off.
    farthest = voxel_in_pixels(mesh, model, camera) + 0.71
    assert farthest < 8
    options: dict[str, Any] = {"camera": camera, "size": SIZE, "samples": 1}
    touched = clvox.render(model, **options)[..., 3] > 0
    assert touched[shown].all()
    assert distance_to(shown, touched) <= farthest
    own = clvox.VoxelModel.from_array(model.to_array(), model.grid)
    inside = clvox.render(own, **options)[..., 3] > 0
    assert distance_to(shown, inside) <= farthest
    assert distance_to(~shown, ~inside) <= farthest


@pytest.mark.parametrize(("name", "most"), [("ball", 3.0), ("plate", 0.1)])
def test_normals_are_those_of_the_mesh(name: str, most: float) -> None:
    """Degrees between the normal of the voxel that is met and that of the triangle, in the middle.

    The ball's triangles are at angles of some degrees.
    """
    mesh = mesh_of(name)
    model = clvox.voxelize(mesh, resolution=64, attributes=("normals",))
    camera = clvox.Camera.around(mesh, aspect=SIZE[0] / SIZE[1])
    seen = seen_triangles(mesh, camera, SIZE).ravel()
    scene, view = _scene(model, "surface", None), camera.view(model.grid, SIZE)
    met = march(model._session, scene, view, Pixels.whole(SIZE)).voxels.get()[:, :3]
    found = model.normals_at(model.grid.centers(met[seen >= 0]))
    assert (np.linalg.norm(found, axis=1) > 0.99).all()
    cosines = (found * mesh.face_normals[seen[seen >= 0]]).sum(axis=1).clip(-1, 1)
    assert np.median(np.degrees(np.arccos(cosines))) < most
