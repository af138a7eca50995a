"""The two levels of a model: ranks, and from flipped bits to a solid: `cl_kernels/multilevel`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pyopencl.array as cla

from clvox.device import Session
from clvox.grid import Shape
from clvox.ops.layout import Bricks, Cells, int4, words_for
from clvox.ops.scan import prefix_sum

RANK_WORDS = 8
"""Words of boundary bits per entry of the rank."""


class Solid(NamedTuple):
    """What carrying finds.

    inside: (Nz, Ny, words) uint32 bits; disagreements: untouched cells whose rays disagree;
    odd_rays: rays that end inside.  Both are 0 for a closed mesh.
    """

    inside: cla.Array
    disagreements: int
    odd_rays: int


def rank_cells(session: Session, boundary: cla.Array, shape: Shape, brick: Shape) -> Cells:
    """Return the coarse grid with the rank of its boundary cells, which numbers their bricks.

    boundary: (Nz, Ny, words) uint32 bits; shape: cells (x, y, z); brick: voxels in a cell.
    """
    blocks = -(-boundary.size // RANK_WORDS)
    counts = session.empty(blocks, np.uint32)
    kernel = session.kernel("multilevel/count_cells.cl", "count_cells")
    session.run(kernel, blocks, np.uint64(boundary.size), boundary, counts)
    rank, count = prefix_sum(session, counts)
    return Cells(shape, brick, boundary, rank, count)


def carry(session: Session, cells: Cells, bricks: Bricks, shape: Shape) -> Solid:
    """Resolve the flipped bits of *bricks*, in place, and find the cells inside.

    shape: voxels (x, y, z); bits of the padding are cleared.  `bricks.entry` is overwritten.
    """
    cells_x, cells_y, cells_z = cells.shape
    inside = session.empty((cells_z, cells_y, words_for(cells_x)), np.uint32)
    doubts = session.zeros(2, np.uint32)
    session.run(
        session.kernel("multilevel/carry.cl", "carry", **cells.defines),
        words_for(cells_x) * cells_z,
        *(cells.shape4, int4(shape), cells.boundary, cells.rank),
        *(bricks.beyond, bricks.exits, bricks.entry, bricks.voxels, inside, doubts),
    )
    disagreements, odd_rays = doubts.get().tolist()
    return Solid(inside, disagreements, odd_rays)
