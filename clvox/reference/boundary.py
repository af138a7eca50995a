"""Which cells a mesh touches: twin of the marking kernels.

A cell is closed and so is a triangle, so that touching at a face, an edge or a corner counts.  A
triangle is cut down to the cell, one half-space after the other; if anything is left, be it a
single point, it touches.  This holds for triangles without area too.
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clvox.grid import Shape

Polygon: TypeAlias = list[tuple[Fraction | int, ...]]


def cells_of(shape: Shape, size: Shape) -> Shape:
    """Return how many cells of *size* voxels it takes to cover *shape* voxels; (x, y, z)."""
    nx, ny, nz = (-(-n // s) for n, s in zip(shape, size, strict=True))
    return nx, ny, nz


def touched(
    vertices: ArrayLike, faces: ArrayLike, bits: int, shape: Shape, size: Shape
) -> NDArray[np.bool_]:
    """Return which cells some triangle touches.

    Parameters
    ----------
    vertices : (n, 3) int
        Lattice positions.
    faces : (m, 3) int
    bits : int
        A voxel is ``2**bits`` steps wide; at least 1.
    shape, size : (3,) int
        Voxels of the grid, and of one cell, along x, y and z.  The lowest corner of cell (0, 0, 0)
        is that of voxel 0, at ``-2**(bits - 1)`` along each axis.

    Returns
    -------
    (Nz, Ny, Nx) bool
        With ``ceil(shape / size)`` cells; the last may reach beyond the grid, and count whole.
    """
    nx, ny, nz = cells_of(shape, size)
    marked = np.zeros((nz, ny, nx), dtype=np.bool_)
    for (i, j, k), _ in touching(vertices, faces, bits, shape, size):
        marked[k, j, i] = True
    return marked


def touching(
    vertices: ArrayLike, faces: ArrayLike, bits: int, shape: Shape, size: Shape
) -> Iterator[tuple[Shape, int]]:
    """Yield every pair of a cell (i, j, k) and a triangle that touches it, triangle by triangle.

    Parameters as in `touched`.
    """
    points = np.asarray(vertices).tolist()
    counts = cells_of(shape, size)
    for triangle, corners in enumerate(np.asarray(faces).tolist()):
        polygon = [tuple(points[c]) for c in corners]
        for i, in_x in _slabs(polygon, 0, bits, counts, size):
            for j, in_y in _slabs(in_x, 1, bits, counts, size):
                for k, _ in _slabs(in_y, 2, bits, counts, size):
                    yield (i, j, k), triangle


def clip(polygon: Polygon, axis: int, limit: Fraction | int, side: int) -> Polygon:
    """Return what is left of a convex *polygon* in a closed half-space.

    That is where ``position[axis] >= limit`` for *side* +1, and ``<= limit`` for -1.  A polygon
    may be a segment or a point, given by any number of corners.
    """
    kept: Polygon = []
    for a, b in zip(polygon, polygon[1:] + polygon[:1], strict=True):
        over_a, over_b = side * (a[axis] - limit), side * (b[axis] - limit)
        if over_a >= 0:
            kept.append(a)
        if over_a * over_b < 0:
            part = Fraction(over_a) / (over_a - over_b)
            cut = [p + part * (q - p) for p, q in zip(a, b, strict=True)]
            kept.append(tuple(cut))
    return kept


def _slabs(
    polygon: Polygon, axis: int, bits: int, counts: Shape, size: Shape
) -> Iterator[tuple[int, Polygon]]:
    """Each layer of cells across *axis* that the polygon touches, and what of it lies there."""
    low = -(2 ** (bits - 1))
    width = size[axis] * 2**bits
    positions = [p[axis] for p in polygon]
    # Every other layer, closed as they are, ends before the least position or begins after the
    # greatest.
    first = max(-((low - min(positions)) // width) - 1, 0)
    last = min((max(positions) - low) // width, counts[axis] - 1)
    for layer in range(first, last + 1):
        part = clip(polygon, axis, low + layer * width, +1)
        part = clip(part, axis, low + (layer + 1) * width, -1)
        if part:
            yield layer, part
