"""Rows of crossings, in order: `cl_kernels/lists/sort_rows.cl`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pyopencl.array as cla

from clvox.device import Session
from clvox.ops import crossings
from clvox.ops.crossings import Window, near
from clvox.ops.facets import Mesh
from clvox.ops.scan import prefix_sum

SHORT = 32
"""Longest row that one work-item sorts."""

LIST_BYTES = 1 << 28
"""About how much of the lists of the rays of a grid is on the device at once."""

_BYTES_PER_ENTRY = 32
# A ray takes 4 + 8 bytes, a crossing 8, and 8 more while a long row is sorted; both together are
# within the budget if either is within half of it.

CROSSINGS_PER_LAUNCH = 1 << 22


class Rows(NamedTuple):
    """The crossings of the rays of a window, as they are sorted.

    window: the rays, along x, y or z; ray (u, v) has the number v * (rays along u) + u along x
    and z, and u * (rays along v) + v along y.
    offsets: (rays + 1,) uint64, where each ray's crossings begin.
    crossings: int64, depth * 2**32 + triangle * 2 + (1 if the ray goes in); depth is fixed point in
    voxels, rounded up; triangles of a mesh in parts are numbered within each part.  There may be
    more entries than crossings.
    """

    window: Window
    offsets: cla.Array
    crossings: cla.Array


def sort_crossings(
    session: Session,
    facets: Mesh,
    bits: int,
    axis: int,
    window: Window,
    most: int | None = None,
    *,
    direct: int = crossings.DIRECT,
    tile: int = crossings.TILE,
    short: int = SHORT,
) -> Rows | None:
    """Return the crossings of the rays of *window* in order; None if there are more than *most*.

    Two passes over the triangles: one counts, one writes.
    """
    # One count more than there are rays, so that the last offset is the end of the last row.
    counts = session.zeros(window.rays + 1, np.uint32)
    crossings.add_counts(session, facets, bits, axis, window, counts, direct=direct, tile=tile)
    offsets, total = prefix_sum(session, counts, bits=64)
    if most is not None and total > most:
        return None
    rows = session.empty(total, np.int64)
    if total:
        crossings.emit_crossings(
            session, facets, bits, axis, window, offsets, counts, rows, direct=direct, tile=tile
        )
        sort_rows(session, offsets, rows, short=short)
    return Rows(window, offsets, rows)


def sorted_windows(
    session: Session, facets: Mesh, bits: int, whole: Window, list_bytes: int, depth: int = 0
) -> Iterator[Rows]:
    """The crossings of all rays along y, as many rays at a time as *list_bytes* allow.

    One ray alone is listed whatever it takes; or, with *depth*, as many layers of rays, which
    are then cut nowhere else.
    """
    most = list_bytes // _BYTES_PER_ENTRY
    waiting = [whole]
    while waiting:
        window = waiting.pop()
        halves = window.layers(depth) if depth else window.halves()
        rows = None
        if not halves or window.rays <= most:
            mesh, limit = near(facets, bits, 1, window), most if halves else None
            rows = sort_crossings(session, mesh, bits, 1, window, limit)
        if rows is None:
            waiting += reversed(halves)
        else:
            yield rows


def sort_rows(session: Session, offsets: cla.Array, rows: cla.Array, *, short: int = SHORT) -> None:
    """Sort each row of *rows*, int64, in place; offsets: (rows + 1,) uint64."""
    rays = offsets.size - 1
    room = max(1, min(rays, rows.size // (short + 1)))
    found = session.zeros(2, np.uint32)
    listed = session.empty(room, np.uint64)
    lengths = session.empty(room, np.uint32)
    kernel = session.kernel("lists/sort_rows.cl", "sort_short", SHORT=short)
    long = found, listed, lengths
    session.run(kernel, rays, np.uint64(rays), offsets, rows, *long, steps=short)
    entries, longest = found.get().tolist()
    if not entries:
        return
    starts, total = prefix_sum(session, lengths[:entries], bits=64)
    scratch = session.empty(total, np.int64)
    kernel = session.kernel("lists/sort_rows.cl", "merge_runs", SHORT=short)
    # An even number of passes, so that the last one writes where the first one read.
    passes = (longest - 1).bit_length()
    for number in range(passes + passes % 2):
        forth = np.int32(number % 2 == 0)
        for first in range(0, total, CROSSINGS_PER_LAUNCH):
            last = min(first + CROSSINGS_PER_LAUNCH, total)
            session.run(
                kernel,
                last - first,
                *(np.uint64(first), np.uint64(last), np.uint32(entries), forth),
                *(np.uint32(1 << number), offsets, listed, starts, rows, scratch),
            )
