"""How many voxels a model has: `cl_kernels/measure`."""

from __future__ import annotations

import math

import numpy as np
import pyopencl.array as cla

from clvox.device import Session
from clvox.ops.layout import Cells, VoxelArrays, int4
from clvox.ops.multilevel import list_bricks
from clvox.ops.query import Rule

_FILE = "measure/count_voxels.cl"

RUN = 256
"""Words that one work-item counts."""


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
        kernel = session.kernel(_FILE, "count_bits", RULE=rule, RUN=RUN)
        marks = arrays.voxels if edge is None else edge
        session.run(kernel, parts, np.uint64(words), arrays.voxels, marks, counts)
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
    kernel = session.kernel(_FILE, "count_cells", RULE=Rule.CENTRE, RUN=RUN)
    session.run(kernel, ny * nz, int4(cells.shape), inside, counts)
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
        _FILE, "count_middle", RULE=Rule.CENTRE, RUN=RUN, **_sides(cells, finer)
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
