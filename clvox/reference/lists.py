"""Crossings as lists, one per ray, in order: twin of the lists kernels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clvox.grid import Axis, Shape
from clvox.reference.crossings import AXES, crossings, fixed_depth


class Lists(NamedTuple):
    """The crossings of each ray, ordered by (depth, triangle, sign).

    Attributes
    ----------
    offsets : (rays + 1,) uint64
        Where the crossings of each ray begin.  Rays are numbered through the grid's array shape
        without the axis along them.
    depth : (n,) int32
        Fixed point in voxels, rounded up.
    triangle : (n,) int32
    sign : (n,) int32
        +1 going in, -1 going out.
    """

    offsets: NDArray[np.uint64]
    depth: NDArray[np.int32]
    triangle: NDArray[np.int32]
    sign: NDArray[np.int32]


def list_crossings(
    vertices: ArrayLike,
    faces: ArrayLike,
    bits: int,
    shape: Shape,
    axis: Axis,
    fraction_bits: int,
) -> Lists:
    """Return the crossings of each ray of the grid along *axis*, in order.

    Parameters as in `clvox.reference.crossings.crossings`; depths have *fraction_bits* binary
    places.
    """
    nu, nv = (count for a, count in enumerate(shape) if a != AXES[axis])
    rows: list[list[tuple[int, int, int]]] = [[] for _ in range(nu * nv)]
    for crossing in crossings(vertices, faces, bits, shape, axis):
        key = fixed_depth(crossing, fraction_bits), crossing.triangle, crossing.sign
        rows[crossing.v * nu + crossing.u].append(key)
    offsets = np.zeros(nu * nv + 1, dtype=np.uint64)
    offsets[1:] = np.cumsum([len(row) for row in rows])
    listed = np.array([key for row in rows for key in sorted(row)], dtype=np.int32)
    depth, triangle, sign = listed.reshape(-1, 3).T
    return Lists(offsets, depth, triangle, sign)
