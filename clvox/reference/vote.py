"""Which voxels of an open mesh are inside by the majority of three axes: twin of the vote."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clvox.grid import Shape
from clvox.reference.crossings import AXES, count_crossings, fill_parity


def fill_vote(vertices: ArrayLike, faces: ArrayLike, bits: int, shape: Shape) -> NDArray[np.bool_]:
    """Return the voxels, (nz, ny, nx), that rays along two of x, y and z, or all, take as inside.

    A ray takes a voxel as inside if an odd number of crossings lie before its sample.
    """
    votes = [fill_parity(vertices, faces, bits, shape, axis).astype(np.int8) for axis in AXES]
    majority: NDArray[np.bool_] = np.sum(votes, axis=0) >= 2
    return majority


def odd_rays(
    vertices: ArrayLike, faces: ArrayLike, bits: int, shape: Shape
) -> list[list[tuple[int, int]]]:
    """Return the rays along x, y and z with an odd number of crossings, each as two voxel indices.

    They are those along the two other axes, the earlier first; rays are ordered by the later.
    """
    return [
        [
            (u, v)
            for v, row in enumerate(count_crossings(vertices, faces, bits, shape, axis).tolist())
            for u, count in enumerate(row)
            if count % 2
        ]
        for axis in AXES
    ]
