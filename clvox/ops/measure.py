"""How many voxels a model has, where, and how they are spread: `cl_kernels/measure`."""

from __future__ import annotations

import math

import numpy as np
import pyopencl.array as cla
from numpy.typing import NDArray

from clvox.device import Session
from clvox.grid import Shape
from clvox.ops.layout import Cells, VoxelArrays, cell_shape, int2, int4, words_for
from clvox.ops.multilevel import list_bricks
from clvox.ops.query import Rule

_COUNT = "measure/count_voxels.cl"
_MOMENTS = "measure/sum_moments.cl"
_BLOCKS = "measure/count_blocks.cl"

RUN = 256
"""Words that one work-item counts."""

SUMS = 10
"""Sums of `sum_moments`."""

ROWS = 1 << 16
"""Rows of cells that one launch sums; so many halves of 64-bit sums do not overflow 64 bits."""

PART = 64
"""Most rows of voxels, along y and along z, that one work-item counts."""

COUNTS = 1 << 24
"""About how many counts of blocks are on the device at once."""


def count_voxels(
    session: Session,
    arrays: VoxelArrays,
    rule: Rule = Rule.CENTRE,
    edge: cla.Array | None = None,
) -> int:
    """Return the number of voxels that *rule* takes: CENTRE, TOUCH or WITHIN.

    edge: which voxels are touched, laid out like `arrays.voxels`; for all rules but CENTRE.
    """
    total = 0
    words = arrays.voxels.size
    if words:
        parts = -(-words // RUN)
        counts = session.empty(parts, np.uint32)
        kernel = session.kernel(_COUNT, "count_bits", RULE=rule, RUN=RUN)
        marks = arrays.voxels if edge is None else edge
        session.run(kernel, parts, np.uint64(words), arrays.voxels, marks, counts, steps=RUN)
        total = int(counts.get().sum(dtype=np.uint64))
    return total + _count_inside(session, arrays)


def _count_inside(session: Session, arrays: VoxelArrays) -> int:
    """Voxels of the cells that are wholly inside, as far as the grid reaches."""
    cells, inside = arrays.cells, arrays.inside
    if cells is None or inside is None:
        return 0
    sides = tuple(np.prod(cells.levels[1:], axis=0).tolist())
    nx, ny, nz = cells.shape
    counts = session.empty((nz, ny, 2), np.uint32)
    kernel = session.kernel(_COUNT, "count_cells", RULE=Rule.CENTRE, RUN=RUN)
    session.run(kernel, ny * nz, int4(cells.shape), inside, counts, steps=words_for(nx))
    last_x, width_y, width_z = (
        np.minimum(side, count - side * np.arange(number))
        for side, count, number in zip(sides, arrays.shape, cells.shape, strict=True)
    )
    found = counts.get().astype(np.int64)
    rows = found[..., 0] * sides[0] + found[..., 1] * last_x[nx - 1]
    # A row's voxels number below 2^17 and a plane of rows below 2^34, so int64 holds the sum.
    assert math.prod(arrays.shape) < 2**62
    total = int((rows * width_y[None, :] * width_z[:, None]).sum())
    finer, middle_inside = cells.finer, arrays.middle_inside
    if finer is None or middle_inside is None or not middle_inside.size:
        return total
    counts = session.empty(middle_inside.size, np.uint32)
    kernel = session.kernel(
        _COUNT, "count_middle", RULE=Rule.CENTRE, RUN=RUN, **_sides(cells, finer)
    )
    owners = list_bricks(session, cells)
    words = np.uint64(middle_inside.size)
    session.run(
        kernel, middle_inside.size, words, int4(arrays.shape), owners, middle_inside, counts
    )
    return total + int(counts.get().sum(dtype=np.uint64))


def _sides(cells: Cells, finer: Cells) -> dict[str, int]:
    """Sides of a brick of cells, and of each cell, as the kernel is built with."""
    names = "ABOVE_X", "ABOVE_Y", "ABOVE_Z", "CELL_X", "CELL_Y", "CELL_Z"
    return dict(zip(names, (*cells.brick, *finer.brick), strict=True))


def sum_moments(session: Session, arrays: VoxelArrays) -> tuple[int, ...]:
    """Return sums over the voxels inside, exactly.

    In this order: their number; of i, j, k; of ii, jj, kk; of ij, jk, ik.
    """
    _, columns_y, columns_z = arrays.columns
    rows = columns_y * columns_z
    kernel = session.kernel(_MOMENTS, "sum_moments", **_defines(arrays), SUMS=SUMS)
    total = [0] * SUMS
    for first in range(0, rows, ROWS):
        count = min(ROWS, rows - first)
        sums = session.empty((count, SUMS), np.uint64)
        span = int4(arrays.shape), int4(arrays.columns), np.uint64(first), np.uint64(count)
        session.run(kernel, count, *span, *arrays.arguments(), sums, steps=arrays.shape[0])
        found = sums.get()
        high = (found >> np.uint64(32)).sum(axis=0, dtype=np.uint64).tolist()
        low = (found & np.uint64(0xFFFFFFFF)).sum(axis=0, dtype=np.uint64).tolist()
        total = [t + (h << 32) + n for t, h, n in zip(total, high, low, strict=True)]
    return tuple(total)


def count_blocks(session: Session, arrays: VoxelArrays, side: Shape) -> NDArray[np.int64]:
    """Return how many voxels are inside, in each block of *side* (x, y, z) voxels; [z, y, x].

    The last blocks along an axis may reach beyond the grid; no side is longer than it.
    """
    x, y, z = cell_shape(arrays.shape, side)
    _, parts_y, parts_z = cell_shape(side, (1, PART, PART))
    kernel = session.kernel(_BLOCKS, "count_blocks", **_defines(arrays), PART=PART)
    result = np.empty((z, y, x), np.int64)
    thick = max(1, COUNTS // (x * y * parts_y * parts_z))
    for first in range(0, z, thick):
        layers = min(thick, z - first)
        counts = session.empty((layers, parts_z, y, parts_y, x), np.uint32)
        shapes = int4(arrays.shape), int4(side), int4((x, y, layers))
        span = np.int32(first), int2(parts_y, parts_z)
        looks = math.prod(min(part, PART) for part in side[1:]) * words_for(side[0])
        session.run(kernel, counts.size, *shapes, *span, *arrays.arguments(), counts, steps=looks)
        counts.get().sum(axis=(1, 3), dtype=np.int64, out=result[first : first + layers])
    return result


def _defines(arrays: VoxelArrays) -> dict[str, int]:
    return {"RULE": int(Rule.CENTRE), **arrays.defines}
