"""Pictures of a part and of a knot in every style; with --large, those of the guide.

With CLVOX_DATA naming a folder of models also those of the gallery, of parts and scans in it.
"""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from PIL import Image

import clvox

LARGE = "--large" in sys.argv
SIZE = (960, 600) if LARGE else (240, 150)
RESOLUTION = 640 if LARGE else 64
WHITE = 255, 255, 255
BOTH = "normals", "links"

BRAIN = "scans/mri_white_matter_iso_633k.ply.gz"
FROM_THE_SIDE = -0.8, -0.75, -0.35
CORTEX = clvox.Material(color=(224, 182, 164), cut_color=(176, 72, 66), specular=0.15)
STEEL = clvox.Material(color=(168, 174, 182), specular=0.5, shininess=50)
BRASS = clvox.Material(color=(196, 160, 82), specular=0.6, shininess=60)

MODELS: dict[str, tuple[str, dict[str, Any]]] = {
    "gear": ("csg/gear_48_teeth.ref.stl", {"material": BRASS}),
    "housing": ("parts/nist_machined_part_pmi2_28k.stl.gz", {"material": STEEL}),
    "drive": ("awkward/cycloidal_drive_100_bodies.ply", {"colours": "bodies"}),
    "sponge": ("awkward/menger_sponge_level3.glb", {"cut": (1, -1, 1)}),
    "brain": (BRAIN, {"material": CORTEX, "direction": FROM_THE_SIDE}),
    "halves": (BRAIN, {"material": CORTEX, "direction": FROM_THE_SIDE, "cut": (1, 0, 0)}),
}
"""Files of the folder, and how they are shown; docs/guide/gallery.md says whose they are."""

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


def draw(name: str, model: clvox.VoxelModel, size: tuple[int, int] = SIZE, **options: Any) -> None:
    """Write one picture."""
    image = clvox.render(model, size=size, background=WHITE, **options)
    picture = Image.fromarray(image).convert("RGB").quantize(255)
    picture.save(folder / f"{name}.png", optimize=True)


def view(model: object, **options: Any) -> clvox.Camera:
    """The default camera for pictures of this size."""
    return clvox.Camera.around(model, aspect=SIZE[0] / SIZE[1], **options)


@dataclass
class Kept:
    """What of a model is on one side of a plane through its middle, for a camera around it."""

    model: clvox.VoxelModel
    normal: tuple[float, float, float]

    @property
    def middle(self) -> NDArray[np.float64]:
        """A point of the plane."""
        middle: NDArray[np.float64] = self.model.bounds.mean(axis=0)
        return middle

    @property
    def outline(self) -> NDArray[np.float64]:
        """Points around it; the plane's own, too."""
        points, normal = self.model.outline, np.array(self.normal)
        away = (points - self.middle) @ normal
        beyond = points[away > 0] - np.outer(away[away > 0] / (normal @ normal), normal)
        low, high = self.model.bounds
        return np.concatenate([points[away <= 0], beyond.clip(low, high)])

    @property
    def bounds(self) -> NDArray[np.float64]:
        """Lowest and highest corner."""
        return np.stack([self.outline.min(axis=0), self.outline.max(axis=0)])

    def seen(self, **options: Any) -> clvox.Camera:
        """A camera that shows it as large as can be."""
        return replace(view(self, **options), cut=(self.middle, self.normal))


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

draw("plane", part, camera=Kept(part, (0.35, -1, 0.3)).seen())
draw("bodies", clvox.voxelize(chain(), resolution=RESOLUTION, attributes=BOTH), colours="bodies")

coarse = clvox.voxelize(trefoil(), resolution=96, attributes=("edge",))
draw("voxels", coarse, style="voxels", camera=opened)

data = os.environ.get("CLVOX_DATA")
for name, (file, how) in MODELS.items() if data and LARGE else ():
    model = clvox.voxelize(Path(data) / file, resolution=RESOLUTION, attributes=BOTH)
    looking = {"direction": how.pop("direction")} if "direction" in how else {}
    cut = how.pop("cut", None)
    camera = view(model, **looking) if cut is None else Kept(model, cut).seen(**looking)
    draw(name, model, (480, 300), camera=camera, **how)
print(*sorted(path.name for path in folder.iterdir()))
