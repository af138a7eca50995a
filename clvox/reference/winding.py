"""The generalised winding number of a mesh about a point: twin of the winding kernels.

Solid angles are summed in float64, triangle by triangle.  So this is no definition bit by bit: a
voxel whose winding number is within rounding of a half may be in or out.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clvox.grid import Shape

_PAIRS = 1 << 20
"""Pairs of a point and a triangle at a time."""


def winding_numbers(
    vertices: ArrayLike, faces: ArrayLike, points: ArrayLike, step: ArrayLike = (1.0, 1.0, 1.0)
) -> NDArray[np.float64]:
    """Return how often a mesh, open or not, winds around each point, moved by (e, e^2, e^3).

    Parameters
    ----------
    vertices : (n, 3) int
        Lattice positions.
    faces : (m, 3) int
    points : (k, 3) int
        Lattice positions.
    step : (3,) float
        Widths of a lattice step along x, y and z.

    Returns
    -------
    (k,) float64
        The signed solid angles of the triangles, seen from the point, over a whole sphere's: 1
        within a closed mesh whose triangles face outwards.

    References
    ----------
    A. Jacobson, L. Kavan, O. Sorkine-Hornung, "Robust inside-outside segmentation using
    generalized winding numbers", ACM Transactions on Graphics 32(4), 2013.
    """
    corners = np.asarray(vertices, dtype=np.int64)[np.asarray(faces)]
    places = np.asarray(points, dtype=np.int64).reshape(-1, 3)
    scale = np.asarray(step, dtype=np.float64)
    block = max(1, _PAIRS // max(1, len(corners)))
    found = [
        _angles(corners, places[start : start + block], scale)
        for start in range(0, len(places), block)
    ]
    return np.concatenate(found) if found else np.empty(0)


def samples(shape: Shape, bits: int) -> NDArray[np.int64]:
    """Return the centres of all voxels of a grid, ordered by z, y, x; (n, 3) int64."""
    k, j, i = np.indices(shape[::-1]).reshape(3, -1)
    return np.stack([i, j, k], axis=1).astype(np.int64) << bits


def _angles(
    corners: NDArray[np.int64], points: NDArray[np.int64], scale: NDArray[np.float64]
) -> NDArray[np.float64]:
    from_point = corners[None] - points[:, None, None]
    a, b, c = (from_point[:, :, corner] for corner in range(3))
    # Below 2^63 for coordinates within 2^20; else the sign of a float will do.
    exact = np.abs(from_point).max(initial=0) < 1 << 20
    kind = np.int64 if exact else np.float64
    volume = (np.cross(a.astype(kind), b.astype(kind)) * c).sum(axis=-1)
    normal = np.cross((b - a).astype(kind), (c - a).astype(kind))
    side = np.sign(volume)
    for axis in range(3):
        side = np.where(side == 0, -np.sign(normal[..., axis]), side)
    lengths = np.linalg.norm(from_point * scale, axis=-1)
    p, q, r = (part * scale for part in (a, b, c))
    below = (
        lengths.prod(axis=-1)
        + (p * q).sum(axis=-1) * lengths[..., 2]
        + (q * r).sum(axis=-1) * lengths[..., 0]
        + (r * p).sum(axis=-1) * lengths[..., 1]
    )
    half_angles = side * np.arctan2(np.abs(volume) * scale.prod(), below)
    total: NDArray[np.float64] = half_angles.sum(axis=1) / (2 * np.pi)
    return total
