"""What a cutter that moves takes away from a dexel model: three axes, exact sweeps.

The tool's axis is z, as are the rays.  What a move takes from a ray is all above a place, rounded
up to the unit of depths; so of each ray it is enough to know the lowest such place.

Rays are kept by tiles.  A move looks only at tiles that it touches, and of those only at ones where
the solid is higher than the move may reach down.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clvox.errors import GridError
from clvox.grid import Grid
from clvox.models.cutter import FURTHEST, Cutter, Floats, ahead_of
from clvox.ops.dexels import Frame
from clvox.ops.facets import Progress
from clvox.ops.lists import CrossingLists

if TYPE_CHECKING:
    from clvox.device import Session
    from clvox.models.dexels import DexelModel

SIDE = 8
"""Rays along the side of a tile."""

TILES = 1 << 12
"""Most tiles that are cut at once: what a move takes on the host is bounded."""

_ROUNDING = 1e-9
"""Part of a length by which sums of floats may be wrong, and more: no tile is skipped for it."""


@dataclass(frozen=True)
class Cut:
    """What is left after a cutter's path, and what each move took.

    Attributes
    ----------
    model : DexelModel
        Its new ends come from one more mesh, whose triangles are the moves.
    removed : (moves,) float64
        Volume that each move took away; together the difference of the volumes.
    engagement : (moves,) float64
        The most that each move took from one ray: the deepest cut along the tool's axis.
    """

    model: DexelModel
    removed: Floats
    engagement: Floats


class Work:
    """The rays while they are cut: the solid of each ends where the lowest cut begins.

    Attributes
    ----------
    looked_at : int
        Tiles that moves had to look into.
    """

    def __init__(self, grid: Grid, frame: Frame, pieces: CrossingLists) -> None:
        """Begin with the rays of resolved pieces, uncut."""
        self._grid = grid
        self._frame = frame
        self._offsets = pieces.offsets.get().astype(np.int64)
        self._depths: NDArray[np.int32] = pieces.depth.get()
        self._sides: NDArray[np.uint32] = pieces.side.get().view(np.uint32)
        self.looked_at = 0
        across = np.array(frame.across)
        self._tiles = -(-across // SIDE)
        # Depths of a ray without pieces: nothing can be lower.
        self._nothing = np.iinfo(np.int32).min
        begin, end = self._offsets[:-1], self._offsets[1:]
        some = end > begin
        first = np.full(frame.rays, self._nothing, np.int32)
        first[some], last = self._depths[begin[some]], first.copy()
        last[some] = self._depths[end[some] - 1]
        # By tile and place in it: where the solid above has been cut away, at first where it ends;
        # where it begins; and which move cut.
        self._top, self._bottom = self._by_tiles(last), self._by_tiles(first)
        self._move = np.full(self._top.shape, -1, np.int32)
        # The highest place in a tile where there is anything to cut.
        self._crest = self._top.max(axis=1)

    def cut(self, number: int, cutter: Cutter, start: Floats, stop: Floats) -> tuple[int, int]:
        """Take away what one move does; return the lengths it took, and the most from one ray."""
        total, most = 0, 0
        tiles = self._touched(cutter, start, stop)
        self.looked_at += len(tiles)
        for at in range(0, len(tiles), TILES):
            taken = self._cut_tiles(tiles[at : at + TILES], number, cutter, start, stop)
            total, most = total + int(taken.sum()), max(most, int(taken.max(initial=0)))
        return total, most

    def cut_all(
        self, cutter: Cutter, moves: Sequence[tuple[Floats, Floats]], tell: Progress | None
    ) -> tuple[Floats, Floats]:
        """Take away what all moves do; return the volume that each took, and its deepest cut."""
        took = []
        for number, (start, stop) in enumerate(moves):
            took.append(self.cut(number, cutter, start, stop))
            if tell is not None:
                tell(number + 1, len(moves))
        width_x, width_y, width_z = self._grid.spacing
        lengths = np.array(took, np.float64) * (width_z / (1 << self._frame.fraction_bits))
        return lengths[:, 0] * (width_x * width_y), lengths[:, 1]

    def left(self, session: Session, first_triangle: int) -> CrossingLists:
        """Return the ends of what is left, on the device.

        first_triangle: the number of the first move, as that of a triangle.
        """
        counts = np.diff(self._offsets) // 2
        rays = np.repeat(np.arange(self._frame.rays), counts)
        top = self._by_rays(self._top)[rays]
        depth, side = self._depths.reshape(-1, 2), self._sides.reshape(-1, 2)
        kept, shorter = depth[:, 0] < top, depth[:, 1] > top
        depth, side = depth.copy(), side.copy()
        depth[shorter, 1] = top[shorter]
        moves = self._by_rays(self._move)[rays[shorter]].astype(np.uint32)
        side[shorter, 1] = (moves + np.uint32(first_triangle)) << np.uint32(1)
        offsets = np.zeros(self._frame.rays + 1, np.uint64)
        np.cumsum(2 * np.bincount(rays[kept], minlength=self._frame.rays), out=offsets[1:])
        depths, sides = depth[kept].ravel(), side[kept].ravel().view(np.int32)
        return CrossingLists(
            session.upload(offsets),
            session.upload(depths),
            session.upload(sides),
            self._frame.fraction_bits,
        )

    def _by_tiles(self, values: NDArray[np.int32]) -> NDArray[np.int32]:
        """Values of the rays, by tile and place in it; nothing beyond the grid."""
        along, across = self._frame.across
        wide, high = (self._tiles * SIDE).tolist()
        padded = np.full((high, wide), self._nothing, np.int32)
        padded[:across, :along] = values.reshape(across, along)
        tiles = padded.reshape(high // SIDE, SIDE, wide // SIDE, SIDE).swapaxes(1, 2)
        return np.ascontiguousarray(tiles).reshape(-1, SIDE * SIDE)

    def _by_rays(self, values: NDArray[np.int32]) -> NDArray[np.int32]:
        """Values of tiles, by ray."""
        along, across = self._frame.across
        wide, high = self._tiles.tolist()
        rows = values.reshape(high, wide, SIDE, SIDE).swapaxes(1, 2)
        return rows.reshape(high * SIDE, wide * SIDE)[:across, :along].ravel()

    def _touched(self, cutter: Cutter, start: Floats, stop: Floats) -> NDArray[np.intp]:
        """Numbers of the tiles in which the move may cut anything."""
        spans, middles = [], []
        halves = [SIDE / 2 * float(self._grid.spacing[axis]) for axis in range(2)]
        for axis in range(2):
            low = min(start[axis], stop[axis]) - cutter.radius - self._grid.origin[axis]
            high = max(start[axis], stop[axis]) + cutter.radius - self._grid.origin[axis]
            width, count = 2 * halves[axis], int(self._tiles[axis])
            first = min(max(np.floor(low / width), 0), count)
            last = min(max(np.floor(high / width) + 1, 0), count)
            spans.append(np.arange(int(first), max(int(first), int(last))))
            middles.append(self._grid.origin[axis] + (spans[axis] + 0.5) * width)
        tiles = (spans[1][:, None] * self._tiles[0] + spans[0]).ravel()
        # Cheapest first: where the solid is below all of the move, however long it is.
        tiles_above = self._crest[tiles] > self._place(np.array(min(start[2], stop[2])))
        x, y = np.meshgrid(*middles)
        tiles, x, y = tiles[tiles_above], x.ravel()[tiles_above], y.ravel()[tiles_above]
        reach = (cutter.radius + math.hypot(*halves)) * (1 + _ROUNDING)
        near, lowest = _lowest_tip(start, stop, x, y, reach)
        tiles = tiles[near]
        found: NDArray[np.intp] = tiles[self._crest[tiles] > self._place(lowest[near])]
        return found

    def _place(self, height: Floats) -> NDArray[np.int32]:
        """Depths of heights, rounded up, in the box."""
        low, high = self._frame.box
        depth = (height - self._grid.origin[2]) / self._grid.spacing[2] - 0.5
        scaled = np.ceil(depth * (1 << self._frame.fraction_bits))
        places: NDArray[np.int32] = np.minimum(np.maximum(scaled, low), high).astype(np.int32)
        return places

    def _cut_tiles(
        self,
        tiles: NDArray[np.intp],
        number: int,
        cutter: Cutter,
        start: Floats,
        stop: Floats,
    ) -> NDArray[np.int64]:
        """Cut the rays of tiles; return the length that each ray lost, of those that lost any."""
        # Rays with nothing left need no look.
        which, place = np.nonzero(self._top[tiles] > self._bottom[tiles])
        tile = tiles[which]
        row, column = np.divmod(tile, self._tiles[0])
        i, j = column * SIDE + place % SIDE, row * SIDE + place // SIDE
        centers: list[Floats] = [
            np.asarray(self._grid.origin[axis] + (at + 0.5) * self._grid.spacing[axis], np.float64)
            for axis, at in enumerate((i, j))
        ]
        places = self._place(cutter.lowest(start, stop, *centers))
        before = self._top[tile, place]
        lower = places < before
        tile, place, places, before = tile[lower], place[lower], places[lower], before[lower]
        rays = j[lower] * self._frame.across[0] + i[lower]
        self._top[tile, place], self._move[tile, place] = places, number
        tops = self._top[tiles]
        self._crest[tiles] = np.where(tops > self._bottom[tiles], tops, self._nothing).max(axis=1)
        return self._below(rays, before) - self._below(rays, places)

    def _below(self, rays: NDArray[np.intp], places: NDArray[np.int32]) -> NDArray[np.int64]:
        """How much of each ray, uncut, is inside below a place."""
        begin, end = self._offsets[rays], self._offsets[rays + 1]
        total = np.zeros(len(rays), np.int64)
        for at in range(0, int((end - begin).max(initial=0)), 2):
            has = begin + at < end
            first = begin[has] + at
            enter, leave = (self._depths[first + by].astype(np.int64) for by in range(2))
            total[has] += np.minimum(np.maximum(places[has], enter), leave) - enter
        return total


def _lowest_tip(
    start: Floats, stop: Floats, x: Floats, y: Floats, reach: float
) -> tuple[NDArray[np.bool_], Floats]:
    """Return which points the tip comes within *reach* of, seen from above, and how low."""
    ahead, length = ahead_of(start, stop)
    low = np.full(x.shape, min(float(start[2]), float(stop[2])))
    if length == 0:
        return np.hypot(x - start[0], y - start[1]) <= reach, low
    along = ((x - start[0]) * ahead[0] + (y - start[1]) * ahead[1]) / length
    beside = ((y - start[1]) * ahead[0] - (x - start[0]) * ahead[1]) / length
    near = (np.abs(beside) <= reach) & (along >= -reach) & (along <= length + reach)
    # The lower end of the part that is within reach.
    slope = float(stop[2] - start[2]) / length
    lowest = np.clip(along - np.copysign(reach, slope), 0.0, length)
    # A rounding error less, for a sum of floats.
    slack = _ROUNDING * (abs(float(start[2])) + abs(float(stop[2])))
    return near, np.maximum(start[2] + slope * lowest - slack, low)


def moves_of(path: ArrayLike) -> Iterator[tuple[Floats, Floats]]:
    """Return the moves of a path, (n + 1, 3) points: n times (start, stop).

    Raises
    ------
    GridError
        It has not that shape, or a number is not finite, or beyond `FURTHEST`.
    """
    try:
        points: Any = np.asarray(path, dtype=np.float64)
    except (TypeError, ValueError):
        raise GridError(
            f"a path must be (n, 3) numbers, a point in each row, got {path!r}"
        ) from None
    if points.ndim != 2 or points.shape[1] != 3 or len(points) < 2:
        raise GridError(f"a path has the shape (n, 3), two points at least, got {points.shape}")
    if not (np.abs(points) <= FURTHEST).all():
        raise GridError(f"the points of a path must be finite, and none beyond {FURTHEST:g}")
    return itertools.pairwise(points)
