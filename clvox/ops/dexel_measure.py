"""Questions about pieces of rays: `cl_kernels/dexels`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from clvox.device import Session
from clvox.ops.dexels import Frame, launches
from clvox.ops.lists import CrossingLists

RUN = 64
"""Rays in a row that one work-item sums over."""

NOWHERE = -(1 << 31)
"""Depth of an end that there is not: below that of any other."""

SLAB_BYTES = 1 << 26
"""About how much of the lengths in cells is on the device at once."""

_SUMS = 10


class Findings(NamedTuple):
    """What `examine` finds.

    thinnest: length of the shortest piece, in units of the depth, on the ray `thinnest_ray`; 0 and
    -1 if there is none.  depth: most crossings of a ray, `deepest_ray`, the first such.
    odd_rays: how many rays have an odd number of crossings.
    """

    thinnest: int
    thinnest_ray: int
    depth: int
    deepest_ray: int
    odd_rays: int


def examine(
    session: Session, frame: Frame, crossings: CrossingLists, pieces: CrossingLists
) -> Findings:
    """Return the shortest of resolved *pieces*, the deepest ray and the odd ones of *crossings*."""
    runs = -(-frame.rays // RUN)
    depth, odd, length = (session.empty(runs, np.uint32) for _ in range(3))
    deepest, thinnest = (session.empty(runs, np.uint64) for _ in range(2))
    kernel = session.kernel("dexels/examine_rows.cl", "examine_rows", RUN=RUN)
    session.run(
        kernel,
        runs,
        *(np.uint64(frame.rays), crossings.offsets, pieces.offsets, pieces.depth),
        *(depth, deepest, odd, length, thinnest),
        steps=RUN,
    )
    depths, lengths = depth.get(), length.get()
    most, least = int(depths.argmax()), int(lengths.argmin())
    empty = pieces.count == 0
    return Findings(
        thinnest=0 if empty else int(lengths[least]),
        thinnest_ray=-1 if empty else int(thinnest.get()[least]),
        depth=int(depths[most]),
        deepest_ray=int(deepest.get()[most]),
        odd_rays=int(odd.get().sum(dtype=np.int64)),
    )


def sum_moments(session: Session, frame: Frame, pieces: CrossingLists) -> tuple[int, ...]:
    """Return sums over resolved pieces from e to w, depths from the box's face, on rays (i, j).

    Of w - e times 1, i, j, i i, j j and i j; of w^2 - e^2 times 1, i and j; and of w^3 - e^3.
    """
    runs = -(-frame.rays // RUN)
    sums = session.empty((runs, _SUMS, 2), np.uint64)
    kernel = session.kernel("dexels/sum_moments.cl", "sum_moments", RUN=RUN)
    session.run(
        kernel,
        runs,
        *(np.uint64(frame.rays), np.int32(frame.across[0]), frame.box[0]),
        *(pieces.offsets, pieces.depth, sums),
        steps=RUN,
    )
    halves = sums.get()
    # Fewer than 2**32 runs: sums of their 32-bit quarters do not overflow.
    quarters = halves[..., None] >> np.array([0, 32], np.uint64) & np.uint64(0xFFFFFFFF)
    added = quarters.sum(axis=0).reshape(_SUMS, 4).tolist()
    return tuple(sum(part << (32 * at) for at, part in enumerate(parts)) for parts in added)


def sum_lengths(session: Session, frame: Frame, pieces: CrossingLists) -> NDArray[np.uint32]:
    """Return how much of each ray is inside, (rays,) uint32, in units of the depth."""
    lengths = session.empty(frame.rays, np.uint32)
    kernel = session.kernel("dexels/measure_rows.cl", "sum_lengths")
    for first, last in launches(frame.rays):
        items = int(last - first)
        session.run(kernel, items, first, last, pieces.offsets, pieces.depth, lengths)
    found: NDArray[np.uint32] = lengths.get()
    return found


def sum_cells(
    session: Session, frame: Frame, pieces: CrossingLists, side: int
) -> NDArray[np.uint32]:
    """Return how much of each cell of each ray is inside, in units of the depth.

    side: voxels of a cell, along the ray.

    Returns
    -------
    ndarray of uint32
        Indexed [z, y, x], with cells along the axis of the rays.
    """
    along, rows = frame.across
    cells = -(-frame.shape[frame.axis] // side)
    shape = [count if a != frame.axis else cells for a, count in enumerate(frame.shape)][::-1]
    lengths = np.empty(shape, np.uint32)
    kernel = session.kernel("dexels/measure_rows.cl", "sum_cells")
    for first, last in _rows_at_once(rows, along * cells):
        part: tuple[slice, ...] = (slice(first, last),)
        if frame.axis == 2:
            part = slice(None), slice(first, last)
        held = lengths[part]
        made = session.empty(held.shape, np.uint32)
        session.run(
            kernel,
            along * (last - first),
            *(np.uint64(first * along), np.uint64(last * along), np.int32(along)),
            *(*frame.box, np.uint32(side << frame.fraction_bits), np.int32(cells)),
            *_strides(frame.axis, held.shape),
            *(pieces.offsets, pieces.depth, made),
        )
        lengths[part] = made.get()
    return lengths


def look_up(
    session: Session, pieces: CrossingLists, rays: NDArray[np.int64], places: NDArray[np.int32]
) -> NDArray[np.uint8]:
    """Return 1 for each place on a ray that is inside, else 0; the ray -1 is nowhere."""
    inside = session.empty(rays.size, np.uint8)
    if rays.size:
        kernel = session.kernel("dexels/search_rows.cl", "look_up")
        where = np.uint64(rays.size), session.upload(rays), session.upload(places)
        session.run(kernel, rays.size, *where, pieces.offsets, pieces.depth, inside)
    found: NDArray[np.uint8] = inside.get()
    return found


def find_ends(
    session: Session, pieces: CrossingLists, rays: NDArray[np.int64], places: NDArray[np.int32]
) -> tuple[NDArray[np.int32], NDArray[np.uint32]]:
    """Return depth and side of the first end behind each place; `NOWHERE` and 0 if none is."""
    depth, side = session.empty(rays.size, np.int32), session.empty(rays.size, np.uint32)
    if rays.size:
        kernel = session.kernel("dexels/search_rows.cl", "find_ends")
        where = np.uint64(rays.size), session.upload(rays), session.upload(places)
        ends = pieces.offsets, pieces.depth, pieces.side
        session.run(kernel, rays.size, *where, *ends, depth, side)
    return depth.get(), side.get()


def _rows_at_once(rows: int, entries: int) -> Iterator[tuple[int, int]]:
    """Cut rows of rays into slabs, of so many entries each, that fit the budget."""
    most = max(1, SLAB_BYTES // (4 * entries))
    for first in range(0, rows, most):
        yield first, min(first + most, rows)


def _strides(axis: int, shape: tuple[int, ...]) -> tuple[np.uint64, np.uint64, np.uint64]:
    """Entries between rays of a row, rows, and cells, of an array [z, y, x]."""
    by_axis = 1, shape[2], shape[1] * shape[2]
    first, second = (stride for a, stride in enumerate(by_axis) if a != axis)
    return np.uint64(first), np.uint64(second), np.uint64(by_axis[axis])
