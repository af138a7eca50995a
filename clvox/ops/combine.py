"""Boolean combinations of models on one grid: `cl_kernels/combine`."""

from __future__ import annotations

import math
from dataclasses import replace
from enum import IntEnum

import numpy as np
import pyopencl as cl
import pyopencl.array as cla

from clvox.device import Session
from clvox.device.session import Argument
from clvox.grid import Shape
from clvox.ops.layout import VoxelArrays, cell_shape, int4, words_for
from clvox.ops.multilevel import BITS, list_bricks, list_bricks_below, rank_cells
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
    """Return the combination of two models of one shape: dense if one is, else on levels as of *a*.

    Its boundary may exceed the true one, never miss: `rebrick` to the same levels can prune it.
    """
    if a.levels != b.levels:
        if b.cells is None:
            a = rebrick(session, a, b.levels)
        else:
            b = rebrick(session, b, a.levels)
    defines = {"OP": int(op), "RULE": int(Rule.CENTRE), **a.defines}
    if a.cells is None or b.cells is None or a.inside is None or b.inside is None:
        voxels = session.empty(a.voxels.shape, np.uint32)
        kernel = session.kernel(_COMBINE, "combine_words", **defines)
        session.run(kernel, voxels.size, np.uint64(voxels.size), a.voxels, b.voxels, voxels)
        return VoxelArrays(a.shape, voxels)
    operands = *_pointers(a), *_pointers(b)

    def decide(name: str, marks: cla.Array, *arguments: Argument) -> tuple[cla.Array, cla.Array]:
        mixed, solid = (session.empty(marks.shape, np.uint32) for _ in range(2))
        if marks.size:
            kernel = session.kernel(_COMBINE, name, **defines)
            session.run(kernel, marks.size, np.uint64(marks.size), *arguments, mixed, solid)
        return mixed, solid

    mixed, inside = decide(
        "combine_cells",
        a.cells.boundary,
        *(a.cells.boundary, a.inside, b.cells.boundary, b.inside),
    )
    cells = rank_cells(session, mixed, a.cells.shape, a.cells.brick)
    owners = list_bricks(session, cells)
    middle_inside = None
    if a.cells.finer is not None:
        shape, brick = a.cells.finer.shape, a.cells.finer.brick
        frame = int4(shape), int4(cells.shape), owners
        marks = session.empty((cells.count, cells.brick_words), np.uint32)
        mixed, middle_inside = decide("combine_middle", marks, *frame, *operands)
        finer = rank_cells(session, mixed, shape, brick)
        owners = list_bricks_below(session, finer, owners, cells.brick)
        cells = replace(cells, finer=finer)
    bricks = session.empty((cells.last.count, cells.last.brick_words), np.uint32)
    if bricks.size:
        kernel = session.kernel(_COMBINE, "combine_bricks", **defines)
        frame = int4(a.shape), int4(cells.shape), owners
        session.run(kernel, bricks.size, np.uint64(bricks.size), *frame, *operands, bricks)
    return VoxelArrays(a.shape, bricks, cells, inside, middle_inside)


def complement(session: Session, arrays: VoxelArrays) -> VoxelArrays:
    """Return the grid's box without the model, on levels like the model's."""
    whole = full(session, arrays.shape, arrays.levels)
    return combine(session, whole, arrays, Operation.DIFFERENCE)


def full(session: Session, shape: Shape, levels: tuple[Shape, ...]) -> VoxelArrays:
    """Return the model whose every voxel is inside."""
    counts = levels[0]
    words = words_for(counts[0])
    row = np.full(words, 0xFFFFFFFF, np.uint32)
    row[-1] >>= np.uint32(32 * words - counts[0])
    solid = session.upload(np.broadcast_to(row, (counts[2], counts[1], words)))
    if len(levels) == 1:
        return VoxelArrays(shape, solid)
    cells = rank_cells(session, session.zeros(solid.shape, np.uint32), counts, levels[1])
    last, middle = cells, None
    if len(levels) == 3:
        middle = session.empty((0, cells.brick_words), np.uint32)
        last = rank_cells(session, middle, cell_shape(shape, levels[2]), levels[2])
        cells = replace(cells, finer=last)
    bricks = session.empty((0, last.brick_words), np.uint32)
    return VoxelArrays(shape, bricks, cells, solid, middle)


def rebrick(
    session: Session, arrays: VoxelArrays, levels: tuple[Shape, ...], *, prune: bool = False
) -> VoxelArrays:
    """Return the same voxels on other levels, or on the same ones.

    A cell has a brick where the source has one, so that no touched cell is missed; with *prune*,
    and from a dense grid, only where its voxels differ.
    """
    shape = arrays.shape
    source = arrays.arguments()
    voxels = int4(shape)

    def kernel(name: str, sides: Shape, above: Shape = (1, 1, 1)) -> cl.Kernel:
        new = dict(zip(("NEW_X", "NEW_Y", "NEW_Z"), sides, strict=True))
        old = dict(zip(("ABOVE_X", "ABOVE_Y", "ABOVE_Z"), above, strict=True))
        rule = {"RULE": int(Rule.CENTRE), "PRUNE": int(prune)}
        return session.kernel(_REBRICK, name, **rule, **arrays.defines, **new, **old)

    if len(levels) == 1:
        dense = session.empty((shape[2], shape[1], words_for(shape[0])), np.uint32)
        flatten = kernel("flatten", (0, 0, 0))
        session.run(flatten, dense.size, voxels, *source, dense, steps=BITS)
        return VoxelArrays(shape, dense)
    sides = levels[1] if len(levels) == 2 else _product(levels[1], levels[2])
    counts = levels[0]
    mixed = session.empty((counts[2], counts[1], words_for(counts[0])), np.uint32)
    inside = session.empty(mixed.shape, np.uint32)
    top = kernel("rebrick_cells", sides)
    looks = BITS * math.prod(sides)
    session.run(top, mixed.size, voxels, int4(counts), *source, mixed, inside, steps=looks)
    cells = rank_cells(session, mixed, counts, levels[1])
    owners = list_bricks(session, cells)
    middle_inside = None
    if len(levels) == 3:
        mixed = session.empty((cells.count, cells.brick_words), np.uint32)
        middle_inside = session.empty(mixed.shape, np.uint32)
        if mixed.size:
            middle = kernel("rebrick_middle", levels[2], levels[1])
            words = np.uint64(mixed.size)
            target = mixed, middle_inside
            looks = BITS * math.prod(levels[2])
            session.run(middle, mixed.size, words, voxels, owners, *source, *target, steps=looks)
        finer = rank_cells(session, mixed, cell_shape(shape, levels[2]), levels[2])
        owners = list_bricks_below(session, finer, owners, levels[1])
        cells = replace(cells, finer=finer)
    bricks = session.empty((cells.last.count, cells.last.brick_words), np.uint32)
    if bricks.size:
        words = np.uint64(bricks.size)
        leaf = kernel("rebrick_voxels", levels[-1])
        session.run(leaf, bricks.size, words, voxels, owners, *source, bricks, steps=BITS)
    return VoxelArrays(shape, bricks, cells, inside, middle_inside)


def _pointers(arrays: VoxelArrays) -> tuple[Argument, ...]:
    """Arguments of a model without its grid's shape and its edge: PARAMETERS_OF of the kernel."""
    return arrays.arguments()[1:-1]


def _product(a: Shape, b: Shape) -> Shape:
    return a[0] * b[0], a[1] * b[1], a[2] * b[2]
