"""From sums over voxel indices to centre of mass and moments of inertia."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from clvox.grid import Grid

_PRODUCTS = (0, 1), (1, 2), (0, 2)
"""Axes of the last three sums, in the order of `clvox.ops.measure.sum_moments`."""


def center_of_mass(grid: Grid, sums: Sequence[int]) -> NDArray[np.float64]:
    """Return the mean of the voxels' centres, (3,) float64; NaN if there are none."""
    count = sums[0]
    if not count:
        return np.full(3, np.nan)
    # The quotient of two Python integers is rounded once, whatever their size.
    mean = np.array([(2 * first + count) / (2 * count) for first in sums[1:4]])
    center: NDArray[np.float64] = np.array(grid.origin) + mean * grid.spacing
    return center


def inertia(grid: Grid, sums: Sequence[int]) -> NDArray[np.float64]:
    """Return the moments of inertia of the voxels, as boxes of density 1, about their centre.

    (3, 3) float64; zeros if there are no voxels.
    """
    if not sums[0]:
        return np.zeros((3, 3))
    count, first, squares = sums[0], sums[1:4], sums[4:7]
    dx = np.array(grid.spacing)
    # Sums of products of the distances from the mean, in voxels: integers over 12 n.  A voxel adds
    # what a box has about its own centre, a twelfth.
    spread = np.empty((3, 3))
    for a in range(3):
        about = 12 * (count * squares[a] - first[a] ** 2) + count**2
        spread[a, a] = about / (12 * count)
    for (a, b), product in zip(_PRODUCTS, sums[7:10], strict=True):
        spread[a, b] = spread[b, a] = (count * product - first[a] * first[b]) / count
    spread *= np.outer(dx, dx) * grid.voxel_volume
    result: NDArray[np.float64] = np.trace(spread) * np.eye(3) - spread
    return result
