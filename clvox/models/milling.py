"""What a cutter that moves takes away from a dexel model: three axes, exact sweeps.

The tool's axis is z, as are the rays.  The material that a straight move takes from a ray is
all that is above the lowest place which the cutter's surface reaches there; that place has a
formula, or is the root of a monotonous function.  It is computed on the host, in IEEE double, so it
is the same for every device, and rounded up to the unit of depths.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clvox.errors import GridError
from clvox.grid import Grid
from clvox.ops.dexels import CAP, Frame
from clvox.ops.lists import CrossingLists

if TYPE_CHECKING:
    from clvox.device import Session
    from clvox.models.dexels import DexelModel

_HALVINGS = 32
"""An error of 2**-32 in the place where a function is lowest is one of 2**-64 in the function."""

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Cutter:
    """A rotating tool about an axis along z; its shank is as wide as the tool and has no end.

    Attributes
    ----------
    radius : float
    corner : float
        Radius of the rounding between bottom and side: 0 for a flat end mill, *radius* for a ball
        end mill, between them a bull-nose.

    Raises
    ------
    GridError
        The radius is not positive and finite, or the corner not between 0 and the radius.
    """

    radius: float
    corner: float = 0.0

    def __post_init__(self) -> None:
        if not 0 < self.radius < np.inf:
            raise GridError(f"the radius of a cutter must be positive, got {self.radius}")
        if not 0 <= self.corner <= self.radius:
            raise GridError(
                f"the corner of a cutter must be between 0 and its radius {self.radius}, got "
                f"{self.corner}"
            )

    @classmethod
    def flat(cls, radius: float) -> Cutter:
        """Return a flat end mill."""
        return cls(radius)

    @classmethod
    def ball(cls, radius: float) -> Cutter:
        """Return a ball end mill."""
        return cls(radius, radius)

    @classmethod
    def bull(cls, radius: float, corner: float) -> Cutter:
        """Return a bull-nose end mill."""
        return cls(radius, corner)

    def profile(self, away: Floats) -> Floats:
        """Return the height of the cutter's surface above its tip, *away* from the axis.

        Beyond the radius there is no cutter, and the height is that at the radius.
        """
        over: Floats = np.clip(away - (self.radius - self.corner), 0.0, self.corner)
        height: Floats = self.corner - np.sqrt((self.corner - over) * (self.corner + over))
        return height

    def lowest(self, start: Floats, stop: Floats, x: Floats, y: Floats) -> Floats:
        """Return the lowest place that the cutter reaches above each point (x, y).

        Its tip moves along a straight line from *start* to *stop*, (3,).  Infinite where it does
        not come by.
        """
        found = np.full(x.shape, np.inf)
        ahead: Floats = stop[:2] - start[:2]
        length = float(np.hypot(*ahead))
        if length == 0:
            away = np.hypot(x - start[0], y - start[1])
            near = away <= self.radius
            found[near] = min(start[2], stop[2]) + self.profile(away[near])
            return found
        along = ((x - start[0]) * ahead[0] + (y - start[1]) * ahead[1]) / length
        beside = ((y - start[1]) * ahead[0] - (x - start[0]) * ahead[1]) / length
        reach = np.sqrt(np.maximum((self.radius - beside) * (self.radius + beside), 0.0))
        # Where the tip is while the cutter is above the point.
        first, last = np.maximum(0.0, along - reach), np.minimum(length, along + reach)
        near = (np.abs(beside) <= self.radius) & (first <= last)
        along, beside, reach = along[near], beside[near], reach[near]
        slope = float(stop[2] - start[2]) / length
        tip = np.clip(along + self._behind(slope, beside, reach), first[near], last[near])
        height = start[2] + slope * tip
        found[near] = height + self.profile(np.hypot(beside, tip - along))
        return found

    def _behind(self, slope: float, beside: Floats, reach: Floats) -> Floats:
        """How far past a point, on an endless line, the tip is when the cutter is lowest there.

        Between -reach and reach the height is a convex function of it, so on a part of the line
        the lowest place is the nearest to this one.
        """
        if slope == 0:
            return np.zeros(beside.shape)
        if self.corner == 0:
            return -float(np.sign(slope)) * reach
        if self.corner == self.radius:
            return -slope / math.sqrt(1 + slope * slope) * reach
        flat = self.radius - self.corner
        low, high = -reach, reach.copy()
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            away = np.hypot(beside, middle)
            over = np.clip(away - flat, 0.0, self.corner)
            # The sign of slope + profile'(away) * middle / away, times what makes it finite.
            rising = slope * np.sqrt((self.corner - over) * (self.corner + over))
            up = rising + over * middle / np.where(away > 0, away, 1.0) > 0
            high = np.where(up, middle, high)
            low = np.where(up, low, middle)
        return (low + high) / 2


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


@dataclass
class Work:
    """The rays while they are cut: the solid of each ends where the lowest cut begins.

    offsets, depths: resolved ends on the host.
    top: where the solid above has been cut away, per ray; move: which one did it, or -1.
    """

    grid: Grid
    frame: Frame
    offsets: NDArray[np.int64]
    depths: NDArray[np.int64]
    top: NDArray[np.int64]
    move: NDArray[np.int64]

    @classmethod
    def of(cls, grid: Grid, frame: Frame, pieces: CrossingLists) -> Work:
        """Return the rays of resolved pieces, uncut."""
        top = np.full(frame.rays, int(frame.box[1]), np.int64)
        offsets, depths = pieces.offsets.get(), pieces.depth.get()
        move = np.full(frame.rays, -1, np.int64)
        return cls(grid, frame, offsets.astype(np.int64), depths.astype(np.int64), top, move)

    def cut(self, number: int, cutter: Cutter, start: Floats, stop: Floats) -> tuple[int, int]:
        """Take away what one move does; return the lengths it took, and the most from one ray."""
        rays, x, y = self._near(cutter, start, stop)
        low, high = (int(face) for face in self.frame.box)
        lowest = cutter.lowest(start, stop, x, y)
        depth = (lowest - self.grid.origin[2]) / self.grid.spacing[2] - 0.5
        # Far outside of the box it does not matter where.
        scaled = np.ceil(np.clip(depth, -1e8, 1e8) * (1 << self.frame.fraction_bits))
        places = np.clip(scaled, low, high).astype(np.int64)
        lower = places < self.top[rays]
        rays, places = rays[lower], places[lower]
        taken = self._below(rays, self.top[rays]) - self._below(rays, places)
        self.top[rays], self.move[rays] = places, number
        return int(taken.sum()), int(taken.max(initial=0))

    def rows(self, session: Session) -> CrossingLists:
        """Return all that the moves swept, as pieces up to the face of the box."""
        high = int(self.frame.box[1])
        swept = self.top < high
        counts = np.zeros(self.frame.rays + 1, np.uint64)
        counts[1:] = np.cumsum(2 * swept)
        depth = np.full(2 * int(swept.sum()), high, np.int32)
        depth[::2] = self.top[swept]
        side = np.full(len(depth), CAP << 1, np.uint32)
        side[::2] = self.move[swept] << 1 | 1
        arrays = [session.upload(array) for array in (counts, depth, side.view(np.int32))]
        return CrossingLists(arrays[0], arrays[1], arrays[2], self.frame.fraction_bits)

    def _near(
        self, cutter: Cutter, start: Floats, stop: Floats
    ) -> tuple[NDArray[np.int64], Floats, Floats]:
        """Rays that the move may touch, and where they are."""
        spans, centers = [], []
        for axis in range(2):
            origin, width = self.grid.origin[axis], self.grid.spacing[axis]
            ends = np.array([start[axis], stop[axis]])
            low = (ends.min() - cutter.radius - origin) / width - 0.5
            high = (ends.max() + cutter.radius - origin) / width - 0.5
            count = self.grid.shape[axis]
            first, last = np.clip([np.ceil(low), np.floor(high) + 1], 0, count).astype(int).tolist()
            spans.append(np.arange(first, max(first, last)))
            centers.append(origin + (spans[axis] + 0.5) * width)
        rays = (spans[1][:, None] * self.grid.shape[0] + spans[0]).ravel()
        x, y = np.meshgrid(centers[0], centers[1])
        return rays, x.ravel(), y.ravel()

    def _below(self, rays: NDArray[np.int64], places: NDArray[np.int64]) -> NDArray[np.int64]:
        """How much of each ray, uncut, is inside below a place."""
        begin, end = self.offsets[rays], self.offsets[rays + 1]
        total = np.zeros(len(rays), np.int64)
        for at in range(0, int((end - begin).max(initial=0)), 2):
            has = begin + at < end
            first = begin[has] + at
            enter, leave = self.depths[first], self.depths[first + 1]
            total[has] += np.clip(places[has], enter, leave) - enter
        return total


def moves_of(path: ArrayLike) -> Iterator[tuple[Floats, Floats]]:
    """Return the moves of a path, (n + 1, 3) points: n times (start, stop).

    Raises
    ------
    GridError
        It has not that shape, or a number is not finite.
    """
    try:
        points: Any = np.asarray(path, dtype=np.float64)
    except (TypeError, ValueError):
        raise GridError(
            f"a path must be (n, 3) numbers, a point in each row, got {path!r}"
        ) from None
    if points.ndim != 2 or points.shape[1] != 3 or len(points) < 2:
        raise GridError(f"a path has the shape (n, 3), two points at least, got {points.shape}")
    if not np.isfinite(points).all():
        raise GridError("the points of a path must be finite")
    return itertools.pairwise(points)
