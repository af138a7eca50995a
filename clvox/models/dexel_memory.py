"""What dexels of a mesh need, what they may take, and what would fit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from clvox.device import Session
from clvox.device.job import Job
from clvox.errors import OutOfMemoryError
from clvox.grid import Axis, Grid, Shape
from clvox.mesh import Surface
from clvox.models.memory import LEAST_WORK, SMALL, advice, scaled
from clvox.ops.lists import Listing

_MARGIN = 1.1
"""Crossings go only nearly with the surface: a pitch that is said to fit has so much room."""


@dataclass
class DexelRoom:
    """Where bundles of rays along *axes* have to fit in, one after the other.

    crossings: of each axis, as far as they are counted.
    """

    session: Session
    job: Job
    grid: Grid
    surface: Surface
    axes: list[Axis]
    crossings: dict[Axis, int] = field(default_factory=dict)

    def require(self, work: int = 0) -> None:
        """Refuse what cannot fit, before it is allocated.

        All results, as far as they are known, *work* bytes to make them, and `LEAST_WORK`.

        Raises
        ------
        OutOfMemoryError
            They do not fit; the message says what is needed, and what would fit.
        """
        size_of, largest = self.session.size_of, self.session.device.largest_allocation
        result, counting = self._result(self.grid.shape, self.crossings)
        most = max(result.values())
        words = self._words()
        if size_of(most) > largest:
            name = max(result, key=lambda name: result[name])
            raise OutOfMemoryError(
                f"{words} need {most:,} bytes in one buffer for {name}; {self.session.device} "
                f"allows {largest:,}. {self._advice()}"
            )
        nbytes = sum(map(size_of, result.values()))
        needed = nbytes + max(work, counting) + LEAST_WORK
        if needed > self.job.most:
            raise OutOfMemoryError(
                f"{words} need {needed:,} bytes of the device or more ({nbytes:,} for the result); "
                f"{self.job.most:,} may be used. {self._advice()}"
                "Otherwise give a larger memory_budget."
            )

    def later_nbytes(self, axis: Axis) -> int:
        """Return the bytes of the offsets of bundles after that along *axis*."""
        shape = self.grid.shape
        later = self.axes[self.axes.index(axis) + 1 :]
        sizes = (Listing.nbytes_of(self.session, shape, "xyz".index(axis))[0] for axis in later)
        return sum(map(self.session.size_of, sizes))

    def _words(self) -> str:
        shape = dict(zip("xyz", self.grid.shape, strict=True))
        bundles = [
            " x ".join(str(count) for other, count in shape.items() if other != axis)
            for axis in self.axes
        ]
        rays = " and ".join(
            f"{sides} along {axis}" for sides, axis in zip(bundles, self.axes, strict=True)
        )
        counted = sum(self.crossings.values())
        return f"rays {rays}" + (f" with {counted:,} crossings" if counted else "")

    def _result(self, shape: Shape, crossings: Mapping[Axis, float]) -> tuple[dict[str, int], int]:
        """Bytes of each array of the result, and of what counting takes."""
        arrays: dict[str, int] = {}
        counting = 0
        for axis in self.axes:
            offsets, work = Listing.nbytes_of(self.session, shape, "xyz".index(axis))
            arrays[f"offsets along {axis}"] = offsets
            counting = max(counting, work)
            for name in ("depths", "triangles"):
                arrays[f"{name} along {axis}"] = 4 * math.ceil(crossings.get(axis, 0))
        return arrays, counting

    def _advice(self) -> str:
        return advice(self.grid, self._coarsening())

    def _coarsening(self) -> float | None:
        """By how much wider voxels would do; None if none would."""
        largest = self.session.device.largest_allocation
        expected = self._expected() | self.crossings
        for power in range(1, 700):
            factor = 1.02**power
            fewer = {axis: _MARGIN * count / factor**2 for axis, count in expected.items()}
            result, counting = self._result(scaled(self.grid.shape, factor), fewer)
            sizes = [self.session.size_of(nbytes) for nbytes in result.values()]
            needed = sum(sizes) + counting + max(fewer.values()) + LEAST_WORK + SMALL
            if max(sizes) <= largest and needed <= self.job.most:
                return factor
        return None

    def _expected(self) -> dict[Axis, float]:
        """About how many crossings the rays along each axis have."""
        corners = self.surface.vertices / self.grid.spacing
        a, b, c = (corners[self.surface.faces[:, corner]] for corner in range(3))
        shadows = np.abs(np.cross(b - a, c - a)).sum(axis=0) / 2
        return {axis: float(shadows["xyz".index(axis)]) for axis in self.axes}
