"""A small renderer of meshes: which triangle is seen in each pixel, in float64.

It shares nothing with the package: triangles are projected, and filled one after the other.
"""

from __future__ import annotations

import numpy as np
import trimesh
from numpy.typing import NDArray

import clvox


def seen_triangles(
    mesh: trimesh.Trimesh, camera: clvox.Camera, size: tuple[int, int]
) -> NDArray[np.int64]:
    """Return the number of the nearest triangle in the middle of each pixel, or -1.

    All of the mesh is in front of the eye.  (rows, columns).
    """
    columns, rows = size
    places, nearness = project(mesh.vertices, camera, size)
    found, nearest = np.full((rows, columns), -1), np.full((rows, columns), -np.inf)
    for number, face in enumerate(mesh.faces):
        a, b, c = places[face]
        twice = cross(b - a, c - a)
        low = np.maximum(np.ceil(places[face].min(axis=0) - 0.5), 0).astype(int)
        high = np.floor(places[face].max(axis=0) - 0.5).astype(int)
        if twice == 0:
            continue
        box = slice(low[1], min(high[1] + 1, rows)), slice(low[0], min(high[0] + 1, columns))
        middles = np.moveaxis(np.mgrid[box], 0, -1)[..., ::-1] + 0.5
        shares = [cross(q - p, middles - p) / twice for p, q in ((b, c), (c, a), (a, b))]
        near = sum(share * near for share, near in zip(shares, nearness[face], strict=True))
        shown = (np.min(shares, axis=0) >= 0) & (near > nearest[box])
        found[box][shown] = number
        nearest[box] = np.where(shown, near, nearest[box])
    return found


def project(
    points: NDArray[np.float64], camera: clvox.Camera, size: tuple[int, int]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return columns and rows, (n, 2), and how near points are: it is linear in the picture."""
    columns, rows = size
    right, above, back = camera.frame()
    across, upright, towards = np.stack([right, above, back]) @ (points - camera.eye).T
    if camera.fov is None:
        assert camera.height is not None
        scale, near = np.full(len(points), rows / camera.height), towards
    else:
        scale = rows / 2 / np.tan(np.radians(camera.fov) / 2) / -towards
        near = -1 / towards
    places = np.stack([columns / 2 + scale * across, rows / 2 - scale * upright], axis=1)
    return places, near


def cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """The product of vectors in a plane, (..., 2)."""
    product: NDArray[np.float64] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return product
