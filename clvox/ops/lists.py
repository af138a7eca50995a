"""The crossings of each ray as a list, in order: `cl_kernels/lists`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pyopencl.array as cla
from numpy.typing import NDArray

from clvox.device import GROUP, Session
from clvox.device.session import Argument
from clvox.grid import Shape
from clvox.ops import crossings
from clvox.ops.crossings import Window, fraction_bits, near
from clvox.ops.facets import Facets, Mesh, visit_facets
from clvox.ops.scan import prefix_sum

SHORT = 32
"""Longest row that one work-item sorts."""

CROSSINGS_PER_LAUNCH = 1 << 22
TILES_PER_LAUNCH = 1 << 12

DIRECT = 16
"""Most tiles of a triangle that one work-item does alone."""

LARGEST_SIDE, SMALLEST_SIDE, MOST_TILES = 64, 8, 256
"""Rays along the side of a tile; a small bundle has smaller tiles, so that there are many."""

LIST_BYTES = 1 << 28
"""About how much of the lists of the rays of a grid is on the device at once."""

_BYTES_PER_ENTRY = 32
# A ray takes 4 + 8 bytes, a crossing 8, and 8 more while a long row is sorted; both together are
# within the budget if either is within half of it.

_COUNT, _EMIT = 0, 3


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


@dataclass(frozen=True)
class CrossingLists:
    """The crossings of every ray of a grid along one axis, on the device, in order.

    Attributes
    ----------
    offsets : (rays + 1,) uint64
        Where the crossings of each ray begin.  Rays are numbered through the grid's array shape
        without the axis along them.
    depth : (n,) int32
        Fixed point in voxels, `fraction_bits` after the point, rounded up; 0 is the centre of
        voxel 0.  So the slot is ``ceil(depth / 2**fraction_bits)``.
    side : (n,) int32
        ``triangle * 2 + (1 if the ray goes in)``.
    fraction_bits : int

    Crossings of a ray are ordered by depth, then by triangle; those of equal depth act together.
    """

    offsets: cla.Array
    depth: cla.Array
    side: cla.Array
    fraction_bits: int

    @property
    def count(self) -> int:
        """Number of crossings."""
        return int(self.depth.size)

    @property
    def nbytes(self) -> int:
        """Bytes on the device."""
        return int(self.offsets.nbytes + self.depth.nbytes + self.side.nbytes)

    def triangle(self) -> NDArray[np.int32]:
        """Return the triangle of each crossing, on the host."""
        sides: NDArray[np.int32] = self.side.get()
        return (sides.view(np.uint32) >> 1).astype(np.int32)

    def sign(self) -> NDArray[np.int32]:
        """Return +1 where the ray goes in and -1 where it goes out, on the host."""
        sides: NDArray[np.int32] = self.side.get()
        return 2 * (sides & 1) - 1


def list_crossings(
    session: Session,
    facets: Facets,
    bits: int,
    shape: Shape,
    axis: int,
    *,
    direct: int = DIRECT,
    side: int | None = None,
    short: int = SHORT,
    group: int | None = None,
) -> CrossingLists:
    """Return the crossings of every ray along *axis* of a grid of *shape* voxels.

    direct, side, short, group: most tiles of a triangle that one work-item does, rays along the
    side of a tile, longest row that one work-item sorts, work-items to a tile.  The result does
    not depend on them.
    """
    window = Window.whole(shape, axis)
    side = side or _side_of(window)
    group = group or (1 if session.device.kind == "cpu" else GROUP)
    starts, triangles = bin_triangles(session, facets, bits, axis, window, side, direct)
    tiles = starts.size - 1
    along, slow = sorted_sides(window, axis)
    rows = session.empty(slow * -(-along // side), np.uint32)
    offsets = session.empty(window.rays + 1, np.uint64)
    defines = {"AXIS": axis, "STEP_BITS": bits, "FRACTION_BITS": fraction_bits(bits)}
    defines |= {"SIDE": side, "SHORT": short, "GROUP": group}
    inputs = facets.faces, facets.vertices, starts, triangles

    def run(name: str, sink: int, work: int, *outputs: Argument) -> None:
        # About what each of the work-items does, if all tiles are alike.
        steps = -(-work // (tiles * group))
        kernel = session.kernel("lists/list_tiles.cl", name, SINK=sink, **defines)
        for first in range(0, tiles, TILES_PER_LAUNCH):
            last = min(first + TILES_PER_LAUNCH, tiles)
            span = np.uint64(first), np.uint64(last), window.box
            items = (last - first) * group
            session.run(kernel, items, *span, *inputs, *outputs, group=group, steps=steps)

    looks = window.rays + triangles.size
    run("count_tile", _COUNT, looks, rows, offsets)
    row_starts, total = prefix_sum(session, rows, bits=64)
    depth, sides = session.empty(total, np.int32), session.empty(total, np.int32)
    room = max(1, min(window.rays, total // (short + 1)))
    found = session.zeros(2, np.uint32)
    listed, lengths = session.empty(room, np.uint64), session.zeros(room + 1, np.uint32)
    lists, long_rows = (offsets, depth, sides), (found, listed, lengths)
    run("write_tile", _EMIT, looks + total, np.uint64(total), row_starts, *lists, *long_rows)
    if total:
        _sort_long(session, lists, int(found.get()[0]), listed, lengths, short)
    return CrossingLists(offsets, depth, sides, fraction_bits(bits))


def bin_triangles(
    session: Session,
    facets: Facets,
    bits: int,
    axis: int,
    window: Window,
    side: int,
    direct: int = DIRECT,
) -> tuple[cla.Array, cla.Array]:
    """Return the triangles that each tile of *side* by *side* rays may meet.

    Returns
    -------
    starts : (tiles + 1,) uint64
        Where the triangles of each tile begin; tiles are numbered along v first.
    triangles : uint32
        In no particular order within a tile.
    """
    tiles = -(-window.sides[0] // side) * -(-window.sides[1] // side)
    counts = session.zeros(tiles + 1, np.uint32)
    defines = {"AXIS": axis, "STEP_BITS": bits, "SIDE": side, "DIRECT": direct}
    file = "lists/bin_triangles.cl"
    visit_facets(session, file, "bin", facets, window.box, (counts,), defines | {"PASS": 0})
    starts, pairs = prefix_sum(session, counts, bits=64)
    triangles = session.empty(pairs, np.uint32)
    if pairs:
        bins = starts, counts, triangles
        visit_facets(session, file, "bin", facets, window.box, bins, defines | {"PASS": 1})
    return starts, triangles


def sorted_sides(window: Window, axis: int) -> tuple[int, int]:
    """Rays along the axis in which neighbours follow, and along the other one."""
    along_u, along_v = window.sides
    return (along_v, along_u) if axis == 1 else (along_u, along_v)


def _side_of(window: Window) -> int:
    """Rays along the side of a tile: few enough that all of a device has work."""
    side = LARGEST_SIDE
    while side > SMALLEST_SIDE and window.rays < MOST_TILES * side * side:
        side //= 2
    return side


def _sort_long(
    session: Session,
    lists: tuple[cla.Array, cla.Array, cla.Array],
    entries: int,
    listed: cla.Array,
    lengths: cla.Array,
    short: int,
) -> None:
    """Sort the rows on the list, which no work-item could sort alone, by way of a copy."""
    if not entries:
        return
    # The entry after the last is zero, so that its sum is where the last row ends.
    starts, total = prefix_sum(session, lengths[: entries + 1], bits=64)
    rows = session.empty(total, np.int64)

    def move(back: int) -> None:
        kernel = session.kernel("lists/move_rows.cl", "move_rows", BACK=back)
        offsets, depth, side = lists
        for first in range(0, total, CROSSINGS_PER_LAUNCH):
            last = min(first + CROSSINGS_PER_LAUNCH, total)
            span = np.uint64(first), np.uint64(last), np.uint32(entries)
            places = offsets, listed, starts
            session.run(kernel, last - first, *span, *places, depth, side, rows)

    move(0)
    sort_rows(session, starts, rows, short=short)
    move(1)


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
