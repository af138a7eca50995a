"""Boolean combinations of models on one grid: `cl_kernels/combine`."""

from __future__ import annotations

from enum import IntEnum

import numpy as np
import pyopencl.array as cla

from clvox.device import Session
from clvox.grid import Shape
from clvox.ops.layout import VoxelArrays, brick_defines, cell_shape, int4, words_for
from clvox.ops.multilevel import rank_cells
from clvox.ops.query import Rule

_COMBINE = "combine/combine.cl"
_REBRICK = "combine/rebrick.cl"


class Operation(IntEnum):
    """What becomes of two models: OP of `combine/combine.cl`."""

    UNION = 0
    INTERSECTION = 1
    DIFFERENCE = 2
    XOR = 3


def combine(session: Session, a: VoxelArrays, b: VoxelArrays, op: Operation) -> VoxelArrays:
    """Return the combination of two models of one shape, in bricks like those of *a*.

    Its boundary may exceed the true one, never miss: `rebrick` to the same bricks prunes it.
    """
    if a.levels[1:] != b.levels[1:]:
        b = rebrick(session, b, a.levels[1] if a.cells else None)
    if a.cells is None or b.cells is None or a.inside is None or b.inside is None:
        kernel = session.kernel(_COMBINE, "combine_words", OP=op, **brick_defines((1, 1, 1)))
        voxels = session.empty(a.voxels.shape, np.uint32)
        session.run(kernel, voxels.size, np.uint64(voxels.size), a.voxels, b.voxels, voxels)
        return VoxelArrays(a.shape, voxels)
    marks_a, marks_b = a.cells.boundary, b.cells.boundary
    mixed = session.empty(marks_a.shape, np.uint32)
    inside = session.empty(marks_a.shape, np.uint32)
    words = np.uint64(mixed.size)
    kernel = session.kernel(_COMBINE, "combine_cells", OP=op, **a.cells.defines)
    session.run(kernel, mixed.size, words, marks_a, a.inside, marks_b, b.inside, mixed, inside)
    cells = rank_cells(session, mixed, a.cells.shape, a.cells.brick)
    bricks = session.empty((cells.count, cells.brick_words), np.uint32)
    kernel = session.kernel(_COMBINE, "combine_bricks", OP=op, **a.cells.defines)
    session.run(
        kernel,
        mixed.size,
        *(words, cells.shape4, int4(a.shape)),
        *(marks_a, a.inside, a.cells.rank, a.voxels),
        *(marks_b, b.inside, b.cells.rank, b.voxels),
        *(mixed, cells.rank, bricks),
    )
    return VoxelArrays(a.shape, bricks, cells, inside)


def complement(session: Session, arrays: VoxelArrays) -> VoxelArrays:
    """Return the grid's box without the model, in bricks like the model's."""
    brick = arrays.levels[1] if arrays.cells else None
    return combine(session, full(session, arrays.shape, brick), arrays, Operation.DIFFERENCE)


def full(session: Session, shape: Shape, brick: Shape | None) -> VoxelArrays:
    """Return the model whose every voxel is inside; dense if *brick* is None."""
    counts = shape if brick is None else cell_shape(shape, brick)
    words = words_for(counts[0])
    row = np.full(words, 0xFFFFFFFF, np.uint32)
    row[-1] >>= np.uint32(32 * words - counts[0])
    solid = session.upload(np.broadcast_to(row, (counts[2], counts[1], words)))
    if brick is None:
        return VoxelArrays(shape, solid)
    mixed = session.zeros(solid.shape, np.uint32)
    cells = rank_cells(session, mixed, counts, brick)
    bricks = session.empty((0, cells.brick_words), np.uint32)
    return VoxelArrays(shape, bricks, cells, solid)


def rebrick(session: Session, arrays: VoxelArrays, brick: Shape | None) -> VoxelArrays:
    """Return the same voxels in bricks of another size, or the same one; dense for None.

    Only cells whose voxels differ have a brick.
    """
    new = dict(zip(("NEW_X", "NEW_Y", "NEW_Z"), brick or (0, 0, 0), strict=True))
    defines = {"RULE": int(Rule.CENTRE), **arrays.defines, **new}
    nx, ny, nz = arrays.shape
    if brick is None:
        dense = session.empty((nz, ny, words_for(nx)), np.uint32)
        kernel = session.kernel(_REBRICK, "flatten", **defines)
        session.run(kernel, dense.size, int4(arrays.shape), *arrays.arguments(), dense)
        return VoxelArrays(arrays.shape, dense)
    counts = cell_shape(arrays.shape, brick)
    mixed = session.empty((counts[2], counts[1], words_for(counts[0])), np.uint32)
    inside = session.empty(mixed.shape, np.uint32)
    source: tuple[cla.Array | np.generic, ...] = (
        int4(arrays.shape),
        int4(counts),
        *arrays.arguments(),
    )
    kernel = session.kernel(_REBRICK, "rebrick_cells", **defines)
    session.run(kernel, mixed.size, *source, mixed, inside)
    cells = rank_cells(session, mixed, counts, brick)
    bricks = session.empty((cells.count, cells.brick_words), np.uint32)
    kernel = session.kernel(_REBRICK, "rebrick_bricks", **defines)
    session.run(kernel, mixed.size, *source, mixed, cells.rank, bricks)
    return VoxelArrays(arrays.shape, bricks, cells, inside)
