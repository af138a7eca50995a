"""Questions about single voxels, and boxes of them: `cl_kernels/query`."""

from __future__ import annotations

from enum import IntEnum

import numpy as np
import pyopencl.array as cla
from numpy.typing import NDArray

from clvox.device import Session
from clvox.grid import Shape
from clvox.ops.layout import VoxelArrays, int4

RUN = 128
"""Voxels along x that one work-item expands."""


class Rule(IntEnum):
    """Which voxels count: RULE of `common/model.h`."""

    CENTRE = 0
    TOUCH = 1
    WITHIN = 2
    CLASS = 3


def look_up(
    session: Session,
    arrays: VoxelArrays,
    voxels: NDArray[np.int32],
    rule: Rule = Rule.CENTRE,
    edge: cla.Array | None = None,
) -> NDArray[np.uint8]:
    """Return what *rule* says of each of *voxels*, (n, 3) int32 (i, j, k); 0 for a negative i.

    edge: which voxels are touched, laid out like `arrays.voxels`; for all rules but CENTRE.
    """
    count = len(voxels)
    answers = session.empty(count, np.uint8)
    if count == 0:
        return answers.get()
    kernel = session.kernel("query/look_up.cl", "look_up", RULE=rule, **arrays.defines)
    session.run(
        kernel,
        count,
        *(np.uint64(count), session.share(voxels)),
        *(*arrays.arguments(edge), answers),
    )
    return answers.get()


def expand(
    session: Session,
    arrays: VoxelArrays,
    start: Shape,
    stop: Shape,
    rule: Rule = Rule.CENTRE,
    edge: cla.Array | None = None,
    into: NDArray[np.uint8] | None = None,
) -> NDArray[np.uint8]:
    """Return what *rule* says of the voxels from *start* to before *stop*; [z, y, x] uint8.

    It is written into *into*, an array of that shape in one piece, if given.
    """
    x, y, z = (last - first for first, last in zip(start, stop, strict=True))
    if into is None:
        into = np.empty((z, y, x), np.uint8)
    if into.size == 0:
        return into
    out = session.empty((z, y, x), np.uint8)
    kernel = session.kernel("query/expand.cl", "expand", RULE=rule, RUN=RUN, **arrays.defines)
    runs = -(-x // RUN) * y * z
    box = int4(start), int4((x, y, z))
    session.run(kernel, runs, *box, *arrays.arguments(edge), out, steps=RUN)
    out.get(ary=into)
    return into


def expand_cells(
    session: Session, arrays: VoxelArrays, start: Shape, stop: Shape, level: int = 0
) -> NDArray[np.uint8]:
    """Return the state of the cells of *level* from *start* to before *stop*; [z, y, x] uint8.

    0 is outside, 1 inside, 2 boundary.
    """
    x, y, z = (last - first for first, last in zip(start, stop, strict=True))
    out = session.empty((z, y, x), np.uint8)
    if out.size == 0:
        return out.get()
    kernel = session.kernel("query/expand.cl", "expand_cells", RULE=0, RUN=RUN, **arrays.defines)
    box = int4(start), int4((x, y, z)), np.int32(level)
    session.run(kernel, x * y * z, *box, *arrays.arguments(), out)
    return out.get()
