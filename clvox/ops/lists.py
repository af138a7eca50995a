"""The crossings of each ray as a list, in order: `cl_kernels/lists`."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pyopencl.array as cla
from numpy.typing import NDArray

from clvox.device import GROUP, Session
from clvox.device import session as sessions
from clvox.device.session import Argument
from clvox.grid import Shape
from clvox.ops import bins
from clvox.ops.bins import Binner, Bins
from clvox.ops.crossings import Window, fraction_bits
from clvox.ops.facets import Mesh, Progress
from clvox.ops.scan import prefix_sum
from clvox.ops.sorting import CROSSINGS_PER_LAUNCH, SHORT, sort_rows

WIDE_TILE = 128, 64
"""Rays of a tile where one work-item does it in a cache: neighbours follow along the first side."""

LARGEST_SIDE, SMALLEST_SIDE, MOST_TILES = 64, 8, 256
"""Rays along the sides of other tiles; a small bundle has smaller ones, so that there are many."""

LEAST_TILES = 1 << 6
"""So many tiles a launch may have in any case, since fewer would not keep a processor busy."""

_COUNT, _EMIT = 0, 3
_FIRST, _LAST = 1, 2

_BYTES_PER_LONG = 18
"""What a crossing takes while a row that no work-item can sort alone is sorted."""


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
    facets: Mesh,
    bits: int,
    shape: Shape,
    axis: int,
    *,
    direct: int = bins.DIRECT,
    tile: tuple[int, int] | None = None,
    short: int = SHORT,
    group: int | None = None,
    room: int | None = None,
) -> CrossingLists:
    """Return the crossings of every ray along *axis* of a grid of *shape* voxels.

    direct, tile, short, group: most tiles of a triangle that one work-item does, rays along the
    sides of a tile (that in which rays are numbered first), longest row that one work-item sorts,
    work-items to a tile.  room: bytes to work in, if there is enough for one tile.  The result does
    not depend on them.
    """
    listing = Listing(session, bits, shape, axis, direct, tile, short, group)
    listing.count(facets, room)
    return listing.write(facets, room)


class Listing:
    """Lists in the making: first counted, by which the size of the result is known, then written.

    Attributes
    ----------
    total : int
        Crossings of all rays, once they are counted.
    """

    def __init__(
        self,
        session: Session,
        bits: int,
        shape: Shape,
        axis: int,
        direct: int = bins.DIRECT,
        tile: tuple[int, int] | None = None,
        short: int = SHORT,
        group: int | None = None,
    ) -> None:
        self._session = session
        self._bits = bits
        self._axis = axis
        self._window = Window.whole(shape, axis)
        self._direct = direct
        self._tile = tile or _tile_of(session, self._window)
        self._short = short
        self._group = group or (1 if session.device.kind == "cpu" else GROUP)
        self._along, slow = _sorted_sides(self._window, axis)
        self._offsets = session.empty(self._window.rays + 1, np.uint64)
        self._rows = slow * -(-self._along // self._tile[0])
        self._kept: Bins | None = None
        self.total = 0

    @staticmethod
    def nbytes_of(session: Session, shape: Shape, axis: int) -> tuple[int, int]:
        """Return the bytes of a bundle's offsets, and of what counting takes beside them."""
        window = Window.whole(shape, axis)
        along, slow = _sorted_sides(window, axis)
        rows = slow * -(-along // _tile_of(session, window)[0])
        # Counts, their sums, and sums of many.
        return 8 * (window.rays + 1), sum(session.size_of(size * rows) for size in (4, 8, 1))

    @property
    def work_nbytes(self) -> int:
        """Bytes that writing takes beside the result and the bins, once all are counted."""
        room = self._room_for_long
        sizes = 8 * self._rows, 8 * room, 4 * (room + 1)
        return sum(map(self._session.size_of, sizes))

    @property
    def list_nbytes(self) -> int:
        """Bytes that writing allocates beside the bins."""
        room = self._room_for_long
        sizes = 4 * self.total, 4 * self.total, 8 * room, 4 * (room + 1)
        return sum(map(self._session.size_of, sizes))

    def count(self, mesh: Mesh, room: int | None = None, progress: Progress | None = None) -> None:
        """Count the crossings of each ray; bins may take *room* bytes."""
        done = _Done(self._window, progress)
        rows = self._session.empty(self._rows, np.uint32)

        def visit(found: Bins) -> None:
            self._run("count_tile", _COUNT, found, (rows, self._offsets), done)
            if found.first and found.last and found.window == self._window:
                self._kept = found

        self._binner(mesh, room).visit(self._window, visit)
        self._row_starts, self.total = prefix_sum(self._session, rows, bits=64)

    @property
    def keeps_bins(self) -> bool:
        """Whether the bins of all rays that were counted are there still."""
        return self._kept is not None

    def forget(self) -> None:
        """Give back the bins of the rays that were counted, to make them again."""
        self._kept = None

    def write(
        self, mesh: Mesh, room: int | None = None, progress: Progress | None = None
    ) -> CrossingLists:
        """Return the lists; bins, and then long rows, may take *room* bytes."""
        session, done = self._session, _Done(self._window, progress)
        depth, sides = session.empty(self.total, np.int32), session.empty(self.total, np.int32)
        found = session.zeros(2, np.uint32)
        listed = session.empty(self._room_for_long, np.uint64)
        lengths = session.zeros(self._room_for_long + 1, np.uint32)
        lists = self._offsets, depth, sides
        ends = np.uint64(self._window.rays), np.uint64(self.total)
        outputs = *ends, self._row_starts, *lists, found, listed, lengths

        def visit(bins: Bins) -> None:
            self._run("write_tile", _EMIT, bins, outputs, done)

        kept, self._kept = self._kept, None
        if kept is None:
            self._binner(mesh, room).visit(self._window, visit)
        else:
            visit(kept)
            del kept
        entries = int(found.get()[0]) if self.total else 0
        _sort_long(session, lists, entries, listed, lengths, self._short, room)
        return CrossingLists(*lists, fraction_bits(self._bits))

    @property
    def _room_for_long(self) -> int:
        """Most rows that no work-item can sort alone."""
        return max(1, min(self._window.rays, self.total // (self._short + 1)))

    @property
    def _sides(self) -> tuple[int, int]:
        """Rays of a tile along u and v."""
        wide, high = self._tile
        return (high, wide) if self._axis == 1 else (wide, high)

    def _binner(self, mesh: Mesh, room: int | None) -> Binner:
        how = self._bits, self._axis, self._sides, self._direct
        return Binner(self._session, mesh, *how, room)

    def _run(
        self,
        name: str,
        sink: int,
        bins: Bins,
        outputs: tuple[Argument, ...],
        done: _Done,
    ) -> None:
        """Run a kernel for all tiles of a window."""
        defines = {"AXIS": self._axis, "STEP_BITS": self._bits}
        defines |= dict(zip(("SIDE_U", "SIDE_V"), self._sides, strict=True))
        defines |= {"FRACTION_BITS": fraction_bits(self._bits), "SINK": sink}
        defines |= {"SHORT": self._short, "GROUP": self._group}
        numbers = () if bins.numbers is None else (bins.numbers,)
        # What is written has a place already, whatever came before.
        defines |= {"NUMBERED": len(numbers), "MORE": int(sink == _COUNT and not bins.first)}
        kernel = self._session.kernel("lists/list_tiles.cl", name, **defines)
        mesh = bins.facets.faces, bins.facets.vertices, *numbers, bins.starts, bins.triangles
        part = np.int32(_FIRST * bins.first + _LAST * bins.last)
        for first, last in self._launches(bins):
            span = np.uint64(first), np.uint64(last), bins.window.box, np.int32(self._along), part
            items = (last - first) * self._group
            self._session.run(kernel, items, *span, *mesh, *outputs, group=self._group)
            if bins.last:
                rays, tiles = bins.window.rays, bins.starts.size - 1
                done.add(rays * last // tiles - rays * first // tiles)

    def _launches(self, bins: Bins) -> Iterator[tuple[int, int]]:
        """Cut the tiles into spans, each of about as many steps as a launch may have."""
        starts = bins.starts.get().astype(np.int64)
        # A triangle costs its share of the rays of its tiles, more or less, and a tile its rays.
        share = 4 * bins.window.rays // max(bins.facets.triangles, 1) + 8
        rays = math.prod(self._tile)
        steps = np.minimum(share, rays) * starts
        steps += rays * np.arange(len(starts))
        filling = sessions.ITEMS_PER_LAUNCH // self._group
        least = LEAST_TILES if self._group == 1 else max(LEAST_TILES, filling)
        first, tiles = 0, len(starts) - 1
        while first < tiles:
            enough = (
                int(np.searchsorted(steps, steps[first] + sessions.STEPS_PER_LAUNCH, "right")) - 1
            )
            last = min(max(enough, first + least), tiles)
            yield first, last
            first = last


class _Done:
    """How many rays are done, and who is told."""

    def __init__(self, window: Window, progress: Progress | None) -> None:
        self._rays = window.rays
        self._done = 0
        self._progress = progress

    def add(self, rays: int) -> None:
        self._done += rays
        if self._progress is not None:
            self._progress(min(self._done, self._rays), self._rays)


def _sorted_sides(window: Window, axis: int) -> tuple[int, int]:
    """Rays along the axis in which neighbours follow, and along the other one."""
    along_u, along_v = window.sides
    return (along_v, along_u) if axis == 1 else (along_u, along_v)


def _tile_of(session: Session, window: Window) -> tuple[int, int]:
    """Rays along the sides of a tile: few enough that all of a device has work."""
    device, rays = session.device, math.prod(WIDE_TILE)
    # Counters of rays, and where rows begin; the driver may need some, too.
    local = 4 * rays + 16 * WIDE_TILE[1]
    room = device.kind == "cpu" and local <= device.handle.local_mem_size
    if room and window.rays >= MOST_TILES * rays:
        return WIDE_TILE
    side = LARGEST_SIDE
    while side > SMALLEST_SIDE and window.rays < MOST_TILES * side * side:
        side //= 2
    return side, side


def _sort_long(
    session: Session,
    lists: tuple[cla.Array, cla.Array, cla.Array],
    entries: int,
    listed: cla.Array,
    lengths: cla.Array,
    short: int,
    room: int | None,
) -> None:
    """Sort the rows on the list, which no work-item could sort alone, by way of copies.

    As many at a time as there is room for, but one at least.
    """
    if not entries:
        return
    rays, counts = listed[:entries].get(), lengths[:entries].get()
    ends = np.cumsum(counts, dtype=np.int64)
    first = 0
    while first < entries:
        start = ends[first - 1] if first else 0
        most = ends[-1] if room is None else start + room // _BYTES_PER_LONG
        last = max(int(np.searchsorted(ends, most, side="right")), first + 1)
        _sort_some(session, lists, rays[first:last], counts[first:last], short)
        first = last


def _sort_some(
    session: Session,
    lists: tuple[cla.Array, cla.Array, cla.Array],
    rays: NDArray[np.uint64],
    counts: NDArray[np.uint32],
    short: int,
) -> None:
    """Sort the rows of some rays, which have so many crossings."""
    entries = len(rays)
    places = np.zeros(entries + 1, np.uint64)
    np.cumsum(counts, out=places[1:])
    total = int(places[-1])
    listed, starts = session.upload(rays), session.upload(places)
    rows = session.empty(total, np.int64)

    def move(back: int) -> None:
        kernel = session.kernel("lists/move_rows.cl", "move_rows", BACK=back)
        offsets, depth, side = lists
        for first in range(0, total, CROSSINGS_PER_LAUNCH):
            last = min(first + CROSSINGS_PER_LAUNCH, total)
            span = np.uint64(first), np.uint64(last), np.uint32(entries)
            ends = offsets, listed, starts
            session.run(kernel, last - first, *span, *ends, depth, side, rows)

    move(0)
    sort_rows(session, starts, rows, short=short)
    move(1)
