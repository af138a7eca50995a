"""What the mesh says about voxels that it touches: twin of the kernels in `attributes`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from clvox.grid import Shape

Pairs = Iterable[tuple[Shape, int]]
"""Cells (i, j, k) and triangles that touch them, as `reference.boundary.touching` yields."""

PARTS = 32767
"""A packed direction counts in so many parts of one."""

NO_NORMAL = 0x80008000
"""Stands for the normal of a voxel that has none; no direction is packed so."""


def voxel_normals(pairs: Pairs, normals: NDArray[np.int32]) -> Mapping[Shape, int]:
    """Return the packed normal of each touched voxel.

    It is the sum of the normals of the triangles that touch the voxel; if they sum to nothing,
    that of the lowest-numbered one that has any.

    Parameters
    ----------
    pairs : iterable
        Voxels and triangles.
    normals : (m, 3) int32
        Of the triangles, of any length; 0, three times, for one without area.
    """
    rows: dict[Shape, list[int]] = {}
    for voxel, triangle in pairs:
        rows.setdefault(voxel, []).append(triangle)
    packed = {}
    for voxel, triangles in rows.items():
        parts = [normals[triangle].tolist() for triangle in sorted(triangles)]
        total = [sum(column) for column in zip(*parts, strict=True)]
        if not any(total):
            total = next((part for part in parts if any(part)), total)
        packed[voxel] = pack_normal(*total)
    return packed


def cell_faces(pairs: Pairs) -> Mapping[Shape, list[int]]:
    """Return the triangles that touch each cell, in rising order."""
    rows: dict[Shape, list[int]] = {}
    for cell, triangle in pairs:
        rows.setdefault(cell, []).append(triangle)
    return {cell: sorted(triangles) for cell, triangles in rows.items()}


def pack_normal(x: int, y: int, z: int) -> int:
    """Return the direction of a vector as 32 bits, octahedral; (0, 0, 1) for a vector of no length.

    The vector is divided by |x| + |y| + |z|.  Where z is negative, x becomes 1 - |y| and y becomes
    1 - |x|, with their signs kept (+ for 0).  x and y are rounded to 32767ths, halves up, before
    they are folded, and kept as two's complements, x in the lower 16 bits.
    """
    whole = abs(x) + abs(y) + abs(z)
    if whole == 0:
        return 0
    u, v = ((2 * part * PARTS + whole) // (2 * whole) for part in (x, y))
    if z < 0:
        u, v = (PARTS - abs(v)) * (-1 if u < 0 else 1), (PARTS - abs(u)) * (-1 if v < 0 else 1)
    return (u & 0xFFFF) | (v & 0xFFFF) << 16


def unpack_normals(packed: NDArray[np.uint32]) -> NDArray[np.float64]:
    """Return unit vectors, (n, 3) float64, of packed directions; 0, three times, for NO_NORMAL."""
    halves = np.stack([packed & 0xFFFF, packed >> 16], axis=-1).astype(np.uint16).view(np.int16)
    folded = halves.astype(np.float64) / PARTS
    z = 1.0 - np.abs(folded).sum(axis=-1)
    signs = np.where(folded < 0, -1.0, 1.0)
    unfolded = (1.0 - np.abs(folded[:, ::-1])) * signs
    flat = np.where((z < 0)[:, None], unfolded, folded)
    vectors = np.concatenate([flat, z[:, None]], axis=1)
    unit: NDArray[np.float64] = vectors / np.linalg.norm(vectors, axis=1)[:, None]
    unit[packed == NO_NORMAL] = 0.0
    return unit
