"""Levels above the voxels: ranks, and from flipped bits to a solid: `cl_kernels/multilevel`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pyopencl.array as cla

from clvox.device import Session
from clvox.errors import OutOfMemoryError
from clvox.grid import Shape
from clvox.ops.layout import Bricks, Cells, brick_defines, int4, words_for
from clvox.ops.scan import prefix_sum

_LIST = "multilevel/list_bricks.cl"
_FILE, _COLUMNS = "multilevel/carry.cl", "multilevel/carry_columns.cl"

_CUBES = (4, 4, 4), (8, 8, 8)
"""Bricks of voxels that carry_columns knows."""

RANK_WORDS = 8
"""Words of boundary bits per entry of the rank."""

MOST_BRICKS = 2**32 - 2
"""Bricks must be fewer: where kernels look for one, the last two numbers say outside and inside
(`common/model.h`), the last also that there is none (`common/bricks.h`)."""

BITS = 32
"""Cells in a word."""


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

    Raises
    ------
    OutOfMemoryError
        Their bricks are more than uint32 can number.
    """
    blocks = -(-boundary.size // RANK_WORDS)
    counts = session.empty(blocks, np.uint32)
    if blocks:
        kernel = session.kernel("multilevel/count_cells.cl", "count_cells")
        words = np.uint64(boundary.size)
        session.run(kernel, blocks, words, boundary, counts, steps=RANK_WORDS)
    rank, count = prefix_sum(session, counts)
    if count >= MOST_BRICKS:
        raise OutOfMemoryError(
            f"{count:,} touched cells or voxels of a level are more than can be numbered; there "
            f"must be fewer than {MOST_BRICKS:,}. Use a coarser pitch or larger bricks."
        )
    return Cells(shape, brick, boundary, rank, count)


def carry(
    session: Session, cells: Cells, bricks: Bricks, shape: Shape, others: Solid | None = None
) -> Solid:
    """Resolve the flipped bits of *bricks*, in place, and find the cells inside.

    shape: voxels (x, y, z); bits of the padding are cleared.  `bricks.entry` is overwritten.
    others: what was found in other slabs, whose arrays are gone on with.
    """
    solid = others or empty_solid(session, cells)
    doubts = session.zeros(2, np.uint32)
    model, slab = (int4(shape), *cells.tree), bricks.slab
    span = np.int32(slab.first_layer), np.int32(slab.layers), np.uint32(slab.first_brick)
    flips = bricks.beyond, bricks.exits, bricks.entry, bricks.voxels
    if cells.finer is None or solid.middle_inside is None:
        kernel = session.kernel(_FILE, "carry", **cells.defines)
        items, steps = words_for(cells.shape[0]) * slab.layers, BITS * cells.shape[1]
        session.run(kernel, items, *model, *span, *flips, solid.inside, doubts, steps=steps)
    else:
        columns = cells.finer.shape
        walks = int4(columns), *span, *flips, solid.inside, solid.middle_inside, doubts
        if cells.brick == (8, 8, 8) and cells.finer.brick in _CUBES:
            kernel = session.kernel(_COLUMNS, "carry_columns", **cells.defines)
            rows, steps = cells.shape[0] * -(-slab.layers // 8), 64 * columns[1]
        else:
            kernel = session.kernel(_FILE, "carry", **cells.defines)
            rows = cells.shape[0] * words_for(cells.brick[0]) * slab.layers
            steps = cells.brick[0] * columns[1]
        session.run(kernel, rows, *model, *walks, steps=steps)
    disagreements, odd_rays = doubts.get().tolist()
    return solid._replace(
        disagreements=solid.disagreements + disagreements, odd_rays=solid.odd_rays + odd_rays
    )


def empty_solid(session: Session, cells: Cells) -> Solid:
    """Return the solid without a cell inside."""
    inside = session.zeros(cells.boundary.shape, np.uint32)
    finer = cells.finer
    middle = None if finer is None else session.zeros(finer.boundary.shape, np.uint32)
    return Solid(inside, middle, 0, 0)


def list_bricks(session: Session, cells: Cells) -> cla.Array:
    """Return the cell (x, y, z) of each brick below the coarse grid *cells*; (count, 3) int32."""
    owners = session.empty((cells.count, 3), np.int32)
    if cells.count:
        kernel = session.kernel(_LIST, "list_coarse", **brick_defines((1, 1, 1)))
        words = cells.boundary.size
        level = cells.boundary, cells.rank
        session.run(kernel, words, int4(cells.shape), *level, owners, steps=BITS)
    return owners


def list_bricks_below(session: Session, finer: Cells, above: cla.Array, brick: Shape) -> cla.Array:
    """Return the cell (x, y, z) of each brick below *finer*, a level in bricks of *brick* cells.

    above: the cell of each of those, from `list_bricks`.  The result is (count, 3) int32.
    """
    owners = session.empty((finer.count, 3), np.int32)
    if finer.count:
        kernel = session.kernel(_LIST, "list_below", **brick_defines(brick))
        words = finer.boundary.size
        level = finer.boundary, finer.rank
        session.run(kernel, words, np.uint64(words), above, *level, owners, steps=BITS)
    return owners
