"""The voxel that each ray of a picture meets first, by looking at all of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from clvox.camera import Rays


def first_voxels(voxels: NDArray[np.bool_], rays: Rays, size: tuple[int, int]) -> NDArray[np.int32]:
    """Return the first voxel that is inside along each ray.

    Planes between voxels are met at moments (see `Rays`), equal ones in the order of their axes,
    x first.  A ray visits the voxels all of whose three entering planes it meets before any of
    the three leaving ones.  Along an axis on which it stands still a voxel owns its lower face.

    Parameters
    ----------
    voxels : (nz, ny, nx) bool
    rays : Rays
    size : (int, int)
        Columns and rows.

    Returns
    -------
    (rows, columns, 3) int32
        (i, j, k), or -1, three times.
    """
    columns, rows = size
    hits = np.full((rows, columns, 3), -1, np.int32)
    solid = np.argwhere(voxels)[:, ::-1].astype(object)
    for row in range(rows):
        for column in range(columns):
            place = [
                (at + column * right + row * down) >> rays.fraction
                for at, right, down in zip(rays.start, rays.right, rays.down, strict=True)
            ]
            first = _first(solid, place, rays)
            if first is not None:
                hits[row, column] = solid[first]
    return hits


def _first(solid: NDArray[np.object_], place: list[int], rays: Rays) -> int | None:
    """Which row of *solid* the ray meets first; Python integers, so that nothing overflows."""
    one = 1 << rays.bits
    visited = np.ones(len(solid), bool)
    entering, leaving = [], []
    for axis in range(3):
        low, high = solid[:, axis] * one - place[axis], (solid[:, axis] + 1) * one - place[axis]
        part = rays.direction[axis]
        if part == 0:
            visited &= (low <= 0) & (high > 0)
            continue
        pace = 1
        for other in range(3):
            if other != axis and rays.direction[other] != 0:
                pace *= abs(rays.direction[other])
        # A moment and its axis as one integer, in the order of both.
        near, far = (low * pace, high * pace) if part > 0 else (-high * pace, -low * pace)
        entering.append(near * 3 + axis)
        leaving.append(far * 3 + axis)
    since, until = np.max(entering, axis=0), np.min(leaving, axis=0)
    (found,) = np.nonzero(visited & (since < until))
    return int(found[np.argmin(since[found])]) if len(found) else None
