"""Which triangles may touch some cells: twin of the update kernels."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clvox.grid import Shape


def list_near(
    vertices: ArrayLike,
    faces: ArrayLike,
    bits: int,
    side: Shape,
    marks: NDArray[np.bool_],
    most: int,
) -> list[tuple[int, ...]]:
    """Return the triangles whose box touches a cell that is marked, or more than *most* cells.

    Parameters
    ----------
    vertices : (n, 3) int
        Lattice positions.
    faces : (m, 3) int
    bits : int
        A voxel is ``2**bits`` steps wide.
    side : (3,) int
        Voxels along the sides of a cell.
    marks : (Nz, Ny, Nx) bool

    Returns
    -------
    list of (int, int, int)
        Vertex numbers, in the order of *faces*.
    """
    half = 2**bits // 2
    points = np.asarray(vertices, dtype=object)
    found = []
    for corners in np.asarray(faces).tolist():
        spots = points[corners]
        spans = []
        for axis, (low, high) in enumerate(zip(spots.min(axis=0), spots.max(axis=0), strict=True)):
            width = side[axis] * 2**bits
            # Closed cells: a corner between two of them touches both.
            first = max(-(-(low + half) // width) - 1, 0)
            last = min((high + half) // width, marks.shape[2 - axis] - 1)
            spans.append(range(first, last + 1))
        x, y, z = spans
        if not (len(x) and len(y) and len(z)):
            continue
        held = marks[z.start : z.stop, y.start : y.stop, x.start : x.stop]
        if held.size > most or held.any():
            found.append(tuple(corners))
    return found
