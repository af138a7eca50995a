"""Several meshes on one grid, as an array of labels."""

from __future__ import annotations

import numpy as np
import trimesh

import clvox

# Boxes side by side, a ball above: in the order of their labels, 1 to 3.
bodies = [
    trimesh.creation.box(bounds=[[0, 0, 0], [4, 4, 4]]),
    trimesh.creation.box(bounds=[[4, 0, 0], [8, 4, 4]]),
    trimesh.creation.icosphere(subdivisions=4, radius=2.0).apply_translation([4, 2, 7]),
]
grid = clvox.Grid(origin=(-1.0, -1.0, -1.0), spacing=0.25, shape=(40, 24, 44))

labels = np.zeros(grid.array_shape, np.uint8)
for label, body in enumerate(bodies, start=1):
    # One lattice for all of them.
    voxels = clvox.voxelize(body, grid=grid, lattice_bits=14).to_array()
    assert not labels[voxels].any(), "bodies that only touch share no voxel"
    labels[voxels] = label

print(np.bincount(labels.ravel()) * grid.voxel_volume)
np.savez_compressed("labels.npz", labels=labels, origin=grid.origin, spacing=grid.spacing)
