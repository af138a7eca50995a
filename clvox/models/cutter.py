"""Rotating tools, and the lowest place that one reaches above a point while it moves.

The tool's axis is z.  What a straight move sweeps above a point is all above that place, which has
a formula, or is the root of a monotonous function.  It is computed on the host, in IEEE double, so
it is the same for every device.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from clvox.errors import GridError

_HALVINGS = 32
"""An error of 2**-32 in the place where a function is lowest is one of 2**-64 in the function."""

Floats = NDArray[np.float64]

FURTHEST = 1e100
"""Largest coordinate of a path, so that sums and products of coordinates stay finite."""


def ahead_of(start: Floats, stop: Floats) -> tuple[Floats, float]:
    """Return how far a move goes across the axis, as an arrow and as a length.

    A length whose inverse would overflow is 0: the move is a plunge.
    """
    ahead: Floats = stop[:2] - start[:2]
    length = float(np.hypot(*ahead))
    return ahead, length if length > 1 / FURTHEST else 0.0


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
        The radius is not a positive, finite number, or the corner none between 0 and the radius.
    """

    radius: float
    corner: float = 0.0

    def __post_init__(self) -> None:
        for name, value in (("radius", self.radius), ("corner", self.corner)):
            if isinstance(value, bool) or not isinstance(value, int | float | np.number):
                raise GridError(f"the {name} of a cutter must be a number, got {value!r}")
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
        ahead, length = ahead_of(start, stop)
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
            return -slope / math.hypot(1, slope) * reach
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
