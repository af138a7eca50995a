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
    spots = np.asarray(vertices, dtype=np.float64)
    places = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    scale = np.asarray(step, dtype=np.float64)
    triangles = np.asarray(faces)
    block = max(1, _PAIRS // max(1, len(triangles)))
    found = [
        _turns(spots, triangles, places[start : start + block], scale)
        for start in range(0, len(places), block)
    ]
    return np.concatenate(found) if found else np.empty(0)


def samples(shape: Shape, bits: int) -> NDArray[np.int64]:
    """Return the centres of all voxels of a grid, ordered by z, y, x; (n, 3) int64."""
    k, j, i = np.indices(shape[::-1]).reshape(3, -1)
    return np.stack([i, j, k], axis=1).astype(np.int64) << bits


def _turns(
    spots: NDArray[np.float64],
    faces: NDArray[np.integer],
    points: NDArray[np.float64],
    scale: NDArray[np.float64],
) -> NDArray[np.float64]:
    """The winding numbers of a few points.

    What depends on a point and a triangle is linear or quadratic in the point, so it comes from
    products of matrices.  Lattice positions within 2**16 or so make it exact.
    """
    a, b, c = (spots[corner] for corner in faces.T)
    normal = np.cross(b - a, c - a)
    volume = np.einsum("ij,ij->i", np.cross(a, b), c) - points @ normal.T
    # On the plane, the infinitesimal move decides on which side.
    tie = np.zeros(len(faces))
    for axis in range(3):
        tie = np.where(tie == 0, -np.sign(normal[:, axis]), tie)
    side = np.where(volume == 0, tie, np.sign(volume))

    metric = scale**2
    lengths = np.sqrt(np.square((spots - points[:, None]) * scale).sum(axis=-1))
    p, q, r = (lengths[:, corner] for corner in faces.T)
    below = p * q * r
    weighted = points * metric
    own = np.einsum("ij,ij->i", points, weighted)[:, None]
    for one, other, length in ((a, b, r), (b, c, p), (c, a, q)):
        inner = np.einsum("ij,ij->i", one * metric, other) - weighted @ (one + other).T + own
        below += inner * length
    angles = side * np.arctan2(np.abs(volume) * scale.prod(), below)
    total: NDArray[np.float64] = angles.sum(axis=1) / (2 * np.pi)
    return total
