"""Points around a model: corners of its cells that are not empty."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from clvox.grid import Grid, Shape


def corners_of(grid: Grid, occupied: NDArray[np.bool_], side: Shape) -> NDArray[np.float64]:
    """Return points whose convex hull holds all occupied cells, (n, 3) float64.

    They are corners of the first and the last occupied cell of each column along z; of all
    columns if none is occupied.

    Parameters
    ----------
    occupied : (nz, ny, nx) bool
    side : (3,) int
        Voxels along x, y and z of a cell.
    """
    if not occupied.any():
        occupied = np.ones_like(occupied)
    j, i = np.nonzero(occupied.any(axis=0))
    columns = occupied[:, j, i]
    first, last = columns.argmax(axis=0), len(columns) - columns[::-1].argmax(axis=0)
    corners = np.concatenate(
        [np.stack([i + x, j + y, k], axis=1) for x in (0, 1) for y in (0, 1) for k in (first, last)]
    )
    places = np.minimum(corners * np.array(side), grid.shape) * grid.spacing
    points: NDArray[np.float64] = places + grid.origin
    return points
