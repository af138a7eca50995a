"""How the volume of the voxels closes in on that of the mesh."""

from __future__ import annotations

import clvox

mesh = clvox.load("part.stl")
print(f"{'voxels':>8} {'volume':>14} {'at least':>14} {'at most':>14} {'bytes':>10}")
for resolution in (32, 64, 128, 256):
    model = clvox.voxelize(mesh, resolution=resolution)
    low, high = model.volume_bounds
    assert low <= mesh.volume <= high
    print(f"{resolution:8} {model.volume:14.0f} {low:14.0f} {high:14.0f} {model.nbytes:10}")
print(f"{'the mesh':>8} {mesh.volume:14.0f}")
