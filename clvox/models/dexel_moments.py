"""From sums over pieces of rays to volume, centre of mass and moments of inertia."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from clvox.grid import Grid
from clvox.ops.dexels import Frame


class Integrals:
    """Integrals over bars of one voxel's section, exact until they are asked for.

    In voxels, 0 being the lower corner of the grid's box.

    Parameters
    ----------
    sums
        As `clvox.ops.dexel_measure.sum_moments` returns them.
    """

    def __init__(self, grid: Grid, frame: Frame, sums: Sequence[int]) -> None:
        self.grid = grid
        unit = Fraction(1, 1 << frame.fraction_bits)
        one, i, j, ii, jj, ij = (value * unit for value in sums[:6])
        w, wi, wj = (value * unit**2 / 2 for value in sums[6:9])
        ww = sums[9] * unit**3 / 3
        # A bar reaches from i to i + 1.
        half, third = Fraction(1, 2), Fraction(1, 3)
        u, v = (axis for axis in range(3) if axis != frame.axis)
        axes = u, v, frame.axis
        self.volume = one
        self.first = [Fraction(0)] * 3
        self.second = [[Fraction(0)] * 3 for _ in range(3)]
        for axis, value in zip(axes, (i + half * one, j + half * one, w), strict=True):
            self.first[axis] = value
        squares = ii + i + third * one, jj + j + third * one, ww
        for axis, value in zip(axes, squares, strict=True):
            self.second[axis][axis] = value
        products = ij + half * (i + j) + one / 4, wi + half * w, wj + half * w
        for (a, b), value in zip(((u, v), (u, axes[2]), (v, axes[2])), products, strict=True):
            self.second[a][b] = self.second[b][a] = value

    def center(self) -> NDArray[np.float64]:
        """Return the centre of mass, (3,) float64; NaN if there is nothing."""
        if not self.volume:
            return np.full(3, np.nan)
        mean = np.array([float(first / self.volume) for first in self.first])
        center: NDArray[np.float64] = np.array(self.grid.origin) + mean * self.grid.spacing
        return center

    def inertia(self) -> NDArray[np.float64]:
        """Return the moments of inertia about the centre of mass, (3, 3) float64."""
        if not self.volume:
            return np.zeros((3, 3))
        spread = np.empty((3, 3))
        for a in range(3):
            for b in range(3):
                about = self.second[a][b] - self.first[a] * self.first[b] / self.volume
                spread[a, b] = float(about)
        dx = np.array(self.grid.spacing)
        spread *= np.outer(dx, dx) * self.grid.voxel_volume
        result: NDArray[np.float64] = np.trace(spread) * np.eye(3) - spread
        return result
