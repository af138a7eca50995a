"""Pictures of a part and of a knot in every style; with --large, those of the guide.

With CLVOX_DATA naming a folder of models, also of parts and scans in it.
"""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

import clvox

LARGE = "--large" in sys.argv
SIZE = (960, 600) if LARGE else (240, 150)
RESOLUTION = 640 if LARGE else 64
WHITE = 255, 255, 255
BOTH = "normals", "links"

MODELS = {
    "machined": "parts/nist_machined_part_pmi4_119k.stl.gz",
    "housings": "parts/counter_housings_84k.stl.gz",
    "gear": "csg/gear_48_teeth.ref.stl",
    "head": "scans/mri_head_brain_t1_iso_262k.ply.gz",
    "brain": "scans/mri_white_matter_iso_633k.ply.gz",
}
"""Of the folder: NIST's parts are in the public domain, the housings are from trimesh (MIT)."""

folder = Path("gallery")
folder.mkdir(exist_ok=True)


def trefoil() -> trimesh.Trimesh:
    """A knotted tube."""
    t = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    path = np.stack(
        [np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -1.3 * np.sin(3 * t)], axis=1
    )
    ahead = np.roll(path, -1, axis=0) - np.roll(path, 1, axis=0)
    ahead /= np.linalg.norm(ahead, axis=1)[:, None]
    side = np.cross(ahead, (0, 0, 1))
    side /= np.linalg.norm(side, axis=1)[:, None]
    over = np.cross(side, ahead)
    turn = np.linspace(0, 2 * np.pi, 48, endpoint=False)[:, None]
    ring = np.cos(turn)[None] * side[:, None] + np.sin(turn)[None] * over[:, None]
    points = (path[:, None] + 0.55 * ring).reshape(-1, 3)
    i, j = (index.ravel() for index in np.mgrid[: len(t), : len(turn)])
    next_i, next_j = (i + 1) % len(t), (j + 1) % len(turn)
    a, b, c, d = (
        u * len(turn) + v for u, v in ((i, j), (next_i, j), (next_i, next_j), (i, next_j))
    )
    return trimesh.Trimesh(points, np.concatenate([np.c_[a, b, c], np.c_[a, c, d]]))


def chain() -> trimesh.Trimesh:
    """Five rings, each through the next."""
    rings = [
        trimesh.creation.torus(1.0, 0.22, major_sections=160, minor_sections=48) for _ in range(5)
    ]
    for number, ring in enumerate(rings):
        if number % 2:
            ring.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (1, 0, 0)))
        ring.apply_translation((1.35 * number, 0, 0))
    return trimesh.util.concatenate(rings)


def draw(name: str, model: clvox.VoxelModel, **options: object) -> None:
    """Write one picture."""
    image = clvox.render(model, size=SIZE, background=WHITE, **options)
    picture = Image.fromarray(image).convert("RGB").quantize(255)
    picture.save(folder / f"{name}.png", optimize=True)


def view(model: object, **options: object) -> clvox.Camera:
    """The default camera for pictures of this size."""
    return clvox.Camera.around(model, aspect=SIZE[0] / SIZE[1], **options)


part = clvox.voxelize("part.stl", resolution=RESOLUTION, attributes=("normals",))
draw("surface", part)
draw("volume", part, style="volume")

knot = clvox.voxelize(trefoil(), resolution=RESOLUTION, attributes=("normals",))
(x0, y0, z0), (x1, y1, z1) = knot.bounds
half = (x0, y0, z0), (x1, y1, (z0 + z1) / 2)
# The picture shows the lower half, as large as it can be.
lower = clvox.Grid(half[0], np.subtract(half[1], half[0]), (1, 1, 1))
opened = replace(view(lower), box=half)
draw("cut", knot, camera=opened)

slanted = replace(view(part), cut=(part.bounds.mean(axis=0), (0.35, -1, 0.3)))
draw("plane", part, camera=slanted)
draw("bodies", clvox.voxelize(chain(), resolution=RESOLUTION, attributes=BOTH), colours="bodies")

coarse = clvox.voxelize(trefoil(), resolution=96, attributes=("edge",))
draw("voxels", coarse, style="voxels", camera=opened)

data = os.environ.get("CLVOX_DATA")
for name, file in MODELS.items() if data and LARGE else ():
    mesh = clvox.load(Path(data) / file)
    draw(name, clvox.voxelize(mesh, resolution=RESOLUTION, attributes=("normals",)))
print(*sorted(path.name for path in folder.iterdir()))
