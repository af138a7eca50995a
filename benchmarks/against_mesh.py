"""Pictures of voxels beside what Open3D's rays meet of the mesh itself, from the same place.

    python -m benchmarks.against_mesh [MESH ...] [--resolutions 256 512 1024]

Of each pixel the middle is looked at.  Silhouettes: how many pixels show the mesh and not the
voxels, or the other way round, and how far the farthest of these is from the mesh's silhouette, in
voxels as wide as they are at the mesh's depth there.  Normals: the angle between that of the
triangle and that of the voxel.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

import clvox
from benchmarks import peers
from benchmarks.frames import SIZE, camera_rays
from clvox.bench import meshes
from clvox.ops.raymarch import Pixels, Scene, march


@dataclass(frozen=True)
class Differences:
    """Between a picture of voxels and one of their mesh.

    shown: pixels that show the mesh; missing, beyond: that show only it, or only voxels.
    farthest: of those from the mesh's silhouette, in voxels.  angles: in degrees, of each pixel
    that shows both.
    """

    shown: int
    missing: int
    beyond: int
    farthest: float
    angles: NDArray[np.float64]


def measure(
    mesh: trimesh.Trimesh, resolution: int, caster: peers.RayCaster, size: tuple[int, int]
) -> Differences:
    """Draw both, and compare."""
    model = clvox.voxelize(mesh, resolution=resolution, attributes=("normals",))
    camera = clvox.Camera.around(mesh, aspect=size[0] / size[1])
    rays = caster.tensor(camera_rays(camera, size))
    found = caster.scene(np.array(mesh.vertices), np.array(mesh.faces)).cast_rays(rays)
    far, normals = found["t_hit"].numpy(), found["primitive_normals"].numpy()
    shown = np.isfinite(far)
    arrays, kept, session = model._arrays, model._attributes, model._session
    assert kept is not None
    scene = Scene(arrays, model.grid.spacing, kept.touched, kept.normals)
    hits = march(session, scene, camera.view(model.grid, size), Pixels.whole(size))
    voxels = hits.voxels.get()[:, :3].reshape(*shown.shape, 3)
    covered = voxels[..., 0] >= 0
    both = shown & covered
    own = model.normals_at(model.grid.centers(voxels[both]))
    cosines = (own * normals[both]).sum(axis=1)
    # How wide pixels are, in voxels, where they show the mesh.
    slope = 2 * np.tan(np.radians(camera.fov or 0) / 2) / size[1]
    wide = np.where(shown, far, 0) * slope / model.grid.spacing[0]
    farthest = max(distance_to(shown, covered, wide), distance_to(~shown, ~covered, wide))
    missing, beyond = (int(some.sum()) for some in (shown & ~covered, covered & ~shown))
    angles = np.degrees(np.arccos(cosines.clip(-1, 1)))
    return Differences(int(shown.sum()), missing, beyond, farthest, angles)


def distance_to(
    shown: NDArray[np.bool_], others: NDArray[np.bool_], wide: NDArray[Any] | None = None
) -> float:
    """Return how far the farthest pixel of *others* is from the nearest that is *shown*.

    In pixels; or, with how *wide* each is, 0 for background, in the width of that of both which
    is none.
    """
    beside = np.pad(shown, 1)
    inner = beside[:-2, 1:-1] & beside[2:, 1:-1] & beside[1:-1, :-2] & beside[1:-1, 2:]
    rim, beyond = np.argwhere(shown & ~inner), np.argwhere(others & ~shown)
    widths = np.ones(shown.shape) if wide is None else wide
    most = 0.0
    for place in beyond:
        away = np.linalg.norm(rim - place, axis=1)
        nearest = away.argmin()
        width = max(widths[tuple(place)], widths[tuple(rim[nearest])])
        most = max(most, float(away[nearest] * width))
    return most


def row(name: str, resolution: int, found: Differences) -> str:
    """One line of a table."""
    median, most = np.percentile(found.angles, (50, 90))
    share = 100 * found.beyond / found.shown
    return (
        f"| {name} | {resolution} | {found.missing} | {share:.2f} % | {found.farthest:.1f} | "
        f"{median:.2f} | {most:.1f} |"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="*", type=Path)
    parser.add_argument("--resolutions", nargs="+", type=int, default=[256, 512, 1024])
    options = parser.parse_args()
    caster = peers.ray_caster()
    if caster is None:
        raise SystemExit(peers.MISSING["Open3D"])
    ball = meshes.bumpy_sphere()
    named = {"bumpy sphere": trimesh.Trimesh(ball.vertices, ball.faces, process=False)}
    named |= {path.name.split(".")[0]: clvox.load(path) for path in options.files}
    print("| mesh | voxels | missing | beyond | farthest (voxels) | median (degrees) | 90 % |")
    print("| --- | ---: | ---: | ---: | ---: | ---: | ---: |")
    for name, mesh in named.items():
        for resolution in options.resolutions:
            print(row(name, resolution, measure(mesh, resolution, caster, SIZE)), flush=True)


if __name__ == "__main__":
    main()
