"""Pictures of voxels beside pictures of their mesh, by a renderer of its own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

import clvox
from benchmarks import against_mesh, peers
from benchmarks.against_mesh import distance_to, measure, row
from clvox.bench import meshes
from clvox.ops.raymarch import Pixels, march
from clvox.render.image import _scene
from tests.rasteriser import project, seen_triangles

SIZE = 240, 180
DATA = Path(__file__).parents[1] / "data"


class Tensor:
    """What Open3D's are asked for."""

    def __init__(self, array: NDArray[Any]) -> None:
        self.array = array

    def numpy(self) -> NDArray[Any]:
        return self.array


class Caster(peers.RayCaster):
    """Open3D's stand-in: triangles by our own renderer, and where rays meet their planes."""

    def __init__(self, size: tuple[int, int]) -> None:
        self.size = size
        self.mesh = trimesh.Trimesh()

    def tensor(self, array: NDArray[Any]) -> Tensor:
        return Tensor(array)

    def scene(self, points: NDArray[Any], faces: NDArray[Any]) -> Caster:
        self.mesh = trimesh.Trimesh(points, faces, process=False)
        return self

    def cast_rays(self, rays: Tensor) -> dict[str, Tensor]:
        camera = clvox.Camera.around(self.mesh, aspect=self.size[0] / self.size[1])
        seen = seen_triangles(self.mesh, camera, self.size)
        normals = np.where(seen[..., None] >= 0, self.mesh.face_normals[seen], 0)
        starts, ahead = rays.array[..., :3].astype(float), rays.array[..., 3:].astype(float)
        along = (ahead * normals).sum(axis=-1)
        away = ((self.mesh.triangles[seen, 0] - starts) * normals).sum(axis=-1)
        far = np.where(seen >= 0, away / np.where(seen >= 0, along, 1), np.inf)
        return {"t_hit": Tensor(far), "primitive_normals": Tensor(normals)}


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


@pytest.mark.parametrize("name", ["ball", "plate"])
def test_differences_that_are_measured(name: str) -> None:
    """No pixel of the mesh is missing; others are within a diagonal of a voxel and of a pixel."""
    mesh = mesh_of(name)
    found = measure(mesh, 48, Caster(SIZE), SIZE)
    camera = clvox.Camera.around(mesh, aspect=SIZE[0] / SIZE[1])
    assert found.shown == np.count_nonzero(seen_triangles(mesh, camera, SIZE) >= 0)
    assert found.missing == 0
    assert 0 < found.beyond < 0.2 * found.shown
    voxel = float(max(mesh.extents)) / 48
    deepest = np.linalg.norm(mesh.vertices - camera.eye, axis=1).max()
    pixel = 2 * np.tan(np.radians(camera.fov or 0) / 2) / SIZE[1] * deepest / voxel
    assert 0.5 < found.farthest < 1.74 + 1.5 * pixel
    assert found.angles.shape == (found.shown,)
    assert np.median(found.angles) < 5


def test_pixels_are_as_wide_as_they_are_deep() -> None:
    """Two pixels beyond a near rim are less than one beyond a far one; likewise within."""
    shown = np.array([[0, 0, 1, 1, 1, 1, 1, 1, 0, 0]], bool)
    wide = np.array([[0, 0, 1, 1, 1, 5, 5, 5, 0, 0]], float)
    near, far = (np.zeros_like(shown) for _ in range(2))
    near[0, :2], far[0, 8] = True, True
    assert distance_to(shown, shown | near, wide) == 2
    assert distance_to(shown, shown | near | far, wide) == 5
    assert distance_to(shown, shown | near | far) == 2
    hole = ~shown
    hole[0, 2:4] = True
    assert distance_to(~shown, hole, wide) == 2
    hole[0, 7] = True
    assert distance_to(~shown, hole, wide) == 5
    assert distance_to(shown, shown, wide) == 0


def test_the_table_of_differences(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A line for each mesh and resolution, with as many columns as its head."""
    size = 60, 40
    monkeypatch.setattr(against_mesh, "SIZE", size)
    monkeypatch.setattr(peers, "ray_caster", lambda: Caster(size))
    ball = meshes.bumpy_sphere(3)
    monkeypatch.setattr(meshes, "bumpy_sphere", lambda: ball)
    plate = str(DATA / "plate_with_holes.stl")
    monkeypatch.setattr("sys.argv", ["against_mesh", plate, "--resolutions", "8", "16"])
    against_mesh.main()
    lines = capsys.readouterr().out.splitlines()
    assert {line.count("|") for line in lines} == {8}
    starts = [line.split("|")[1:3] for line in lines[2:]]
    names = "bumpy sphere", "plate_with_holes"
    assert starts == [[f" {name} ", f" {side} "] for name in names for side in (8, 16)]
    mesh = trimesh.Trimesh(ball.vertices, ball.faces, process=False)
    assert lines[2] == row("bumpy sphere", 8, measure(mesh, 8, Caster(size), size))
    monkeypatch.setattr(peers, "ray_caster", lambda: None)
    monkeypatch.setitem(peers.MISSING, "Open3D", "not here")
    with pytest.raises(SystemExit, match="not here"):
        against_mesh.main()
