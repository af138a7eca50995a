"""From a mesh to voxels, to a file, and back to a mesh."""

from __future__ import annotations

import trimesh

import clvox

model = clvox.voxelize("part.stl", resolution=200, progress=True)
model.save("part.npz")
surface = clvox.open("part.npz").to_mesh()
surface.export("voxels.ply")

again = trimesh.load_mesh("voxels.ply")
assert again.is_watertight
assert again.is_winding_consistent
# The surface runs half-way between samples: at its own centres it agrees with the voxels.
same = clvox.voxelize("voxels.ply", grid=model.grid)
assert same == model
print(model, "->", len(surface.faces), "triangles ->", same)
