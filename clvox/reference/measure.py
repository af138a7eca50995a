"""Sums over the voxels of a solid: twin of the measure kernels."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from clvox.grid import Shape

Moments = tuple[int, ...]
"""Number of voxels; sums of i, j, k; of ii, jj, kk; of ij, jk, ik."""


def sum_moments(voxels: NDArray[np.bool_]) -> Moments:
    """Return the sums over the voxels that are true in *voxels*, [z, y, x]: see `Moments`."""
    sums = [0] * 10
    for k, j, i in np.argwhere(voxels).tolist():
        for at, term in enumerate((1, i, j, k, i * i, j * j, k * k, i * j, j * k, i * k)):
            sums[at] += term
    return tuple(sums)


def count_blocks(voxels: NDArray[np.bool_], side: Shape) -> NDArray[np.int64]:
    """Return how many voxels are true in each block of *side* (x, y, z) of them; [z, y, x]."""
    sides = side[::-1]
    blocks = [-(-count // width) for count, width in zip(voxels.shape, sides, strict=True)]
    counts = np.zeros(blocks, dtype=np.int64)
    for at in product(*(range(count) for count in blocks)):
        box = tuple(slice(p * width, (p + 1) * width) for p, width in zip(at, sides, strict=True))
        counts[at] = np.count_nonzero(voxels[box])
    return counts
