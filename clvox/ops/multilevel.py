"""The two levels of a model: ranks, and from flipped bits to a solid: `cl_kernels/multilevel`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pyopencl.array as cla

from clvox.device import Session
from clvox.grid import Shape
from clvox.ops.layout import Bricks, Cells, brick_defines, int4, words_for
from clvox.ops.scan import prefix_sum

_LIST = "multilevel/list_bricks.cl"

RANK_WORDS = 8
"""Words of boundary bits per entry of the rank."""


class Solid(NamedTuple):
    """What carrying finds.

    inside: (Nz, Ny, words) uint32 bits; middle_inside: the same for a level between, (bricks,
    words); disagreements: untouched cells whose rays disagree; odd_rays: rays that end inside.
    The last two are 0 for a closed mesh.
    """

    inside: cla.Array
    middle_inside: cla.Array | None
    disagreements: int
    odd_rays: int


def rank_cells(session: Session, boundary: cla.Array, shape: Shape, brick: Shape) -> Cells:
    """Return a level with the rank of its boundary cells, which numbers their bricks.

    boundary: (Nz, Ny, words) or (bricks, words) uint32 bits; shape: cells (x, y, z); brick: cells
    or voxels in a cell.
    """
    blocks = -(-boundary.size // RANK_WORDS)
    counts = session.empty(blocks, np.uint32)
    if blocks:
        kernel = session.kernel("multilevel/count_cells.cl", "count_cells")
        session.run(kernel, blocks, np.uint64(boundary.size), boundary, counts)
    rank, count = prefix_sum(session, counts)
    return Cells(shape, brick, boundary, rank, count)


def carry(session: Session, cells: Cells, bricks: Bricks, shape: Shape) -> Solid:
    """Resolve the flipped bits of *bricks*, in place, and find the cells inside.

    shape: voxels (x, y, z); bits of the padding are cleared.  `bricks.entry` is overwritten.
    """
    kernel = session.kernel("multilevel/carry.cl", "carry", **cells.defines)
    doubts = session.zeros(2, np.uint32)
    model = int4(shape), *cells.tree
    flips = bricks.beyond, bricks.exits, bricks.entry, bricks.voxels
    if cells.finer is None:
        inside, middle_inside = session.empty(cells.boundary.shape, np.uint32), None
        items = words_for(cells.shape[0]) * cells.shape[2]
        session.run(kernel, items, *model, *flips, inside, doubts)
    else:
        inside = session.zeros(cells.boundary.shape, np.uint32)
        middle_inside = session.zeros(cells.finer.boundary.shape, np.uint32)
        columns = cells.finer.shape
        items = columns[0] * columns[2]
        session.run(kernel, items, *model, int4(columns), *flips, inside, middle_inside, doubts)
    disagreements, odd_rays = doubts.get().tolist()
    return Solid(inside, middle_inside, disagreements, odd_rays)


def list_bricks(session: Session, cells: Cells) -> cla.Array:
    """Return the cell (x, y, z) of each brick below the coarse grid *cells*; (count, 3) int32."""
    owners = session.empty((cells.count, 3), np.int32)
    if cells.count:
        kernel = session.kernel(_LIST, "list_coarse", **brick_defines((1, 1, 1)))
        words = cells.boundary.size
        session.run(kernel, words, int4(cells.shape), cells.boundary, cells.rank, owners)
    return owners


def list_bricks_below(session: Session, finer: Cells, above: cla.Array, brick: Shape) -> cla.Array:
    """Return the cell (x, y, z) of each brick below *finer*, a level in bricks of *brick* cells.

    above: the cell of each of those, from `list_bricks`.  The result is (count, 3) int32.
    """
    owners = session.empty((finer.count, 3), np.int32)
    if finer.count:
        kernel = session.kernel(_LIST, "list_below", **brick_defines(brick))
        words = finer.boundary.size
        session.run(kernel, words, np.uint64(words), above, finer.boundary, finer.rank, owners)
    return owners
