"""How far a place is from what is not empty: `cl_kernels/raymarch/distances.cl`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pyopencl.array as cla

from clvox.device import Session
from clvox.grid import Shape
from clvox.ops.layout import VoxelArrays, cell_shape, int4
from clvox.ops.query import Rule

_FILE, _REFINE = "raymarch/distances.cl", "raymarch/refine.cl"

MOST = 64
"""Distances are at most this."""

BLOCKS = 1 << 22
"""About how many blocks there are at most."""

DENSE_SIDE = 8
"""Voxels along the sides of the blocks of a dense model, at least."""


@dataclass(frozen=True)
class Distances:
    """For each block of coarse cells its distance to one of another kind, in blocks.

    The largest of the distances along the axes: of an empty block, to one that is not; of one that
    is all inside, to one that is not, and 128 more; else 0.  A dense model's voxels count as coarse
    cells; those known to be touched are not empty.

    shape: blocks (x, y, z); side: voxels along the sides of one; values: uint8, x fastest.
    states: (cells,) uint32 of `raymarch/states.h`, if blocks are cells of voxels.
    crumbs: (bricks,) uint64 of `raymarch/refine.cl`, if there are bricks.
    """

    shape: Shape
    side: Shape
    values: cla.Array
    states: cla.Array | None = None
    crumbs: cla.Array | None = None

    @property
    def nbytes(self) -> int:
        """Bytes on the device."""
        parts = self.values, self.states, self.crumbs
        return int(sum(part.nbytes for part in parts if part is not None))


def measure_distances(
    session: Session,
    arrays: VoxelArrays,
    edge: cla.Array | None = None,
    *,
    most_blocks: int = BLOCKS,
) -> Distances:
    """Return the distances of a model.

    edge: which voxels are touched, laid out like the voxels; needed if rays are to meet them.
    """
    cells = arrays.cells
    whole, side = (arrays.shape, DENSE_SIDE) if cells is None else (cells.shape, 1)
    while np.prod(cell_shape(whole, (side, side, side)), dtype=np.int64) > most_blocks:
        side *= 2
    shape = cell_shape(whole, (side, side, side))
    count = int(np.prod(shape, dtype=np.int64))
    defines = {"SIDE": side, "MOST": MOST, "LEVELS": 2}
    if cells is None or arrays.inside is None:
        marks, inside = arrays.voxels if edge is None else edge, arrays.voxels
        taken = arrays.voxels
    else:
        taken, marks, inside = cells.boundary, arrays.inside, arrays.inside
    outer, inner = session.empty(count, np.uint8), session.empty(count, np.uint8)
    kernel = session.kernel(_FILE, "occupy", **defines)
    session.run(kernel, count, int4(shape), int4(whole), taken, marks, outer, steps=side * side)
    kernel = session.kernel(_FILE, "fill", **defines)
    session.run(kernel, count, int4(shape), int4(whole), inside, inner, steps=side * side)
    outer, inner = (_spread(session, shape, given, defines) for given in (outer, inner))
    values = session.empty(count, np.uint8)
    kernel = session.kernel(_FILE, "join", **defines)
    session.run(kernel, count, np.uint64(count), np.uint32(max(shape)), outer, inner, values)
    x, y, z = (side * np.prod([(1, 1, 1), *arrays.levels[1:]], axis=0)).tolist()
    crumbs = take_crumbs(session, arrays, edge)
    if cells is None or arrays.inside is None or cells.finer is not None or side > 1:
        return Distances(shape, (x, y, z), values, None, crumbs)
    states = session.empty(count, np.uint32)
    kernel = session.kernel(_FILE, "merge", **defines)
    session.run(kernel, count, int4(shape), cells.boundary, cells.rank, values, states)
    return Distances(shape, (x, y, z), values, states, crumbs)


def take_crumbs(
    session: Session, arrays: VoxelArrays, edge: cla.Array | None = None
) -> cla.Array | None:
    """Return where in each brick voxels are inside or touched, (bricks,) uint64; None without.

    A bit for each of 4 x 4 x 4 parts, x fastest.
    """
    if arrays.cells is None:
        return None
    count = arrays.cells.last.count
    crumbs = session.empty(count, np.uint64)
    rule = Rule.CENTRE if edge is None else Rule.TOUCH
    kernel = session.kernel(
        _REFINE, "crumble", TILE=1, WIDE_TILE=2, STATES=0, RULE=rule, **arrays.defines
    )
    marks = arrays.voxels if edge is None else edge
    session.run(kernel, count, np.uint32(count), arrays.voxels, marks, crumbs, steps=64)
    return crumbs


def _spread(session: Session, shape: Shape, given: cla.Array, defines: dict[str, int]) -> cla.Array:
    """Return distances from where *given* is 0; what was given is lost."""
    found = session.empty(given.size, np.uint8)
    kernel = session.kernel(_FILE, "spread", **defines)
    for axis in range(3):
        session.run(kernel, given.size, int4(shape), np.int32(axis), given, found)
        given, found = found, given
    return given
