"""How often `contains` is wrong, by the distance of a point from the surface.

    python -m benchmarks.contains_error [MESH ...] [--resolution 64] [--points 20000]

`contains` answers for the voxel that holds a point.  The truth is the winding number of the mesh
about the point, a sum of solid angles over all triangles in float64, and the distance is the least
to any triangle: no voxels, no tree.  Half of the points lie within a voxel's diagonal of the
surface, half anywhere.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

import clvox

WIDTH = 0.1
"""Of the classes of distance, in voxels."""

BEYOND = np.sqrt(3) / 2
"""No wrong answer is farther from the surface, in voxels: the surface separates the point from the
centre of its voxel, and these are half a diagonal apart at most."""

_PAIRS = 1 << 20
"""Points times triangles worked on at once."""

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Errors:
    """Points in voxels that the mesh touches, by distance from it in voxels; and all others.

    points, wrong: per class of distance, `WIDTH` wide.
    elsewhere, wrong_elsewhere: points in voxels that the mesh does not touch.
    """

    points: NDArray[np.int64]
    wrong: NDArray[np.int64]
    elsewhere: int
    wrong_elsewhere: int


def measure(mesh: trimesh.Trimesh, resolution: int, count: int, seed: int = 0) -> Errors:
    """Ask a model of *mesh* about *count* points, and compare."""
    model = clvox.voxelize(mesh, resolution=resolution)
    width = model.grid.spacing[0]
    points = sample(mesh, model.grid, count, seed)
    triangles = np.asarray(mesh.triangles, np.float64)
    wrong = model.contains(points) != is_inside(triangles, points)
    touched = model.classify(points) == 2
    distances = distance(triangles, points[touched]) / width
    # A voxel's diagonal is the farthest that a point of a touched voxel can be.
    classes = (distances / WIDTH).astype(np.int64)
    size = int(np.ceil(np.sqrt(3) / WIDTH)) + 1
    return Errors(
        points=np.bincount(classes, minlength=size),
        wrong=np.bincount(classes[wrong[touched]], minlength=size),
        elsewhere=int((~touched).sum()),
        wrong_elsewhere=int(wrong[~touched].sum()),
    )


def sample(mesh: trimesh.Trimesh, grid: clvox.Grid, count: int, seed: int) -> Floats:
    """Half of the points near the surface, evenly over it and over distances, half anywhere."""
    rng = np.random.default_rng(seed)
    triangles = np.asarray(mesh.triangles, np.float64)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    chosen = rng.choice(len(areas), count // 2, p=areas / areas.sum())
    weights = rng.dirichlet((1, 1, 1), len(chosen))
    on = np.einsum("nc,ncd->nd", weights, triangles[chosen])
    reach = np.sqrt(3) * grid.spacing[0]
    moved = rng.uniform(-reach, reach, (len(chosen), 1)) * (normals / areas[:, None])[chosen]
    low, high = grid.bounds
    anywhere = rng.uniform(low, high, (count - len(chosen), 3))
    near = on + moved
    held = ((near >= low) & (near < high)).all(axis=1)
    return np.concatenate([near[held], anywhere])


def is_inside(triangles: Floats, points: Floats) -> NDArray[np.bool_]:
    """Whether the mesh winds around each point, by Van Oosterom and Strackee's solid angles."""
    return np.concatenate([_winding(triangles, part) > 0.5 for part in _parts(triangles, points)])


def distance(triangles: Floats, points: Floats) -> Floats:
    """Distance of each point from the nearest triangle."""
    return np.concatenate([_nearest(triangles, part) for part in _parts(triangles, points)])


def _parts(triangles: Floats, points: Floats) -> list[Floats]:
    size = max(1, _PAIRS // len(triangles))
    return [points[at : at + size] for at in range(0, max(len(points), 1), size)]


def _winding(triangles: Floats, points: Floats) -> Floats:
    a, b, c = (triangles[None, :, corner] - points[:, None] for corner in range(3))
    x, y, z = (np.linalg.norm(side, axis=2) for side in (a, b, c))
    volume = np.einsum("ptd,ptd->pt", a, np.cross(b, c))
    below = x * y * z
    for one, other, length in ((a, b, z), (b, c, x), (c, a, y)):
        below += np.einsum("ptd,ptd->pt", one, other) * length
    total: Floats = np.arctan2(volume, below).sum(axis=1) / (2 * np.pi)
    return total


def _nearest(triangles: Floats, points: Floats) -> Floats:
    corners = [triangles[:, corner] for corner in range(3)]
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    above = np.ones((len(points), len(triangles)), np.bool_)
    best = np.full(above.shape, np.inf)
    for start, end in zip(corners, corners[1:] + corners[:1], strict=True):
        along = end - start
        apart = points[:, None] - start
        square = np.maximum((along**2).sum(axis=1), np.finfo(np.float64).tiny)
        where = np.clip(np.einsum("ptd,td->pt", apart, along) / square, 0, 1)
        best = np.minimum(best, np.linalg.norm(apart - where[..., None] * along, axis=2))
        above &= np.einsum("ptd,td->pt", apart, np.cross(normal, along)) >= 0
    length = np.maximum(np.linalg.norm(normal, axis=1), np.finfo(np.float64).tiny)
    height = np.abs(np.einsum("ptd,td->pt", points[:, None] - corners[0], normal)) / length
    # Over a triangle its plane is nearest.
    nearest: Floats = np.where(above, np.minimum(best, height), best).min(axis=1)
    return nearest


def table(found: dict[str, Errors]) -> str:
    """Shares in per cent, as Markdown; classes without a wrong answer at the end are left out."""
    most = max(int(np.flatnonzero(errors.wrong).max(initial=-1)) for errors in found.values()) + 2
    lines = [
        "| distance in voxels | " + " | ".join(found) + " |",
        "| --- |" + " --: |" * len(found),
    ]
    for row in range(most):
        cells = [
            f"{100 * errors.wrong[row] / errors.points[row]:.1f} %" if errors.points[row] else "–"
            for errors in found.values()
        ]
        name = f"{row * WIDTH:.1f} to {(row + 1) * WIDTH:.1f}"
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    cells = [f"{e.wrong_elsewhere} of {e.elsewhere:,}" for e in found.values()]
    lines.append("| voxel not touched | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main() -> None:
    """Print the table for a ball and the meshes asked for."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("meshes", nargs="*", help="closed, oriented meshes, not too large")
    parser.add_argument("--resolution", type=int, default=64)
    parser.add_argument("--points", type=int, default=20000)
    options = parser.parse_args()
    found = {"ball": measure(trimesh.creation.icosphere(), options.resolution, options.points)}
    for name in options.meshes:
        path = Path(name)
        found[path.name] = measure(clvox.load(path), options.resolution, options.points)
    print(table(found))


if __name__ == "__main__":
    main()
