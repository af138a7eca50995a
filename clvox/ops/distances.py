"""How far a place is from what is not empty: `cl_kernels/raymarch/distances.cl`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pyopencl.array as cla

from clvox.device import Session
from clvox.grid import Shape
from clvox.ops.layout import VoxelArrays, cell_shape, int4

_FILE = "raymarch/distances.cl"

MOST = 64
"""Distances are at most this."""

BLOCKS = 1 << 22
"""About how many blocks there are at most."""


@dataclass(frozen=True)
class Distances:
    """For each block of coarse cells its distance to one that is not empty, in blocks.

    The largest of the distances along the axes; 0 for a block that is not empty itself.

    shape: blocks (x, y, z); side: voxels along the sides of one; values: uint8, x fastest.
    """

    shape: Shape
    side: Shape
    values: cla.Array


def measure_distances(
    session: Session, arrays: VoxelArrays, *, most_blocks: int = BLOCKS
) -> Distances | None:
    """Return the distances of a model; None for one without coarse cells."""
    cells, inside = arrays.cells, arrays.inside
    if cells is None or inside is None:
        return None
    side = 1
    while np.prod(cell_shape(cells.shape, (side, side, side)), dtype=np.int64) > most_blocks:
        side *= 2
    shape = cell_shape(cells.shape, (side, side, side))
    count = int(np.prod(shape, dtype=np.int64))
    given, found = session.empty(count, np.uint8), session.empty(count, np.uint8)
    defines = {"SIDE": side, "MOST": MOST, "LEVELS": 2}
    kernel = session.kernel(_FILE, "occupy", **defines)
    session.run(kernel, count, int4(shape), int4(cells.shape), cells.boundary, inside, given)
    kernel = session.kernel(_FILE, "spread", **defines)
    for axis in range(3):
        session.run(kernel, count, int4(shape), np.int32(axis), given, found)
        given, found = found, given
    whole = np.prod([*arrays.levels[1:]], axis=0) * side
    x, y, z = whole.tolist()
    return Distances(shape, (x, y, z), given)
