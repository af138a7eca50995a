"""What a build needs, what it may take, and what would fit."""

from __future__ import annotations

import math
import operator
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NoReturn

import numpy as np

from clvox.device import Session
from clvox.device.job import Job
from clvox.errors import GridError, OutOfMemoryError
from clvox.grid import Grid, Shape
from clvox.mesh import Surface
from clvox.ops.layout import Cells, Slab, cell_shape, words_for
from clvox.ops.multilevel import RANK_WORDS

LEAST_WORK = 1 << 16
"""Bytes to work in that every build has beside its result and a slab of one layer."""

SMALL = 1 << 12
"""Bytes that are not worth counting, such as sums that a kernel gives back."""

_MARGIN = 1.1
"""Bricks grow with the surface only nearly: a pitch that is said to fit has so much room."""


def find_budget(session: Session, memory_budget: int | None) -> int:
    """Return the bytes that a build may take: those given, or those that the device has free.

    Raises
    ------
    GridError
        The number given is not a positive integer.
    """
    if memory_budget is None:
        # An eighth is left to drivers, screens and other programs.
        return max(session.device.memory // 8 * 7 - session.nbytes, 0)
    try:
        budget = operator.index(memory_budget)
    except TypeError:
        budget = 0
    if budget < 1:
        raise GridError(
            f"memory_budget must be a positive whole number of bytes, got {memory_budget!r}"
        )
    return budget


def top_nbytes(shape: Shape, levels: tuple[Shape, ...]) -> dict[str, int]:
    """Return the bytes of the arrays that the grid's *shape* decides: of the first level.

    levels: as of a model; only the bricks count.
    """
    for brick in levels[:0:-1]:
        shape = cell_shape(shape, brick)
    words = words_for(shape[0]) * shape[1] * shape[2]
    return {"voxels": 4 * words} if len(levels) == 1 else _level("", words)


def middle_nbytes(cells: Cells) -> dict[str, int]:
    """Return the bytes of the arrays of the level between, in the bricks below *cells*."""
    return _level("middle_", cells.count * cells.brick_words)


def _level(prefix: str, words: int) -> dict[str, int]:
    ranks = -(-words // RANK_WORDS)
    return {
        f"{prefix}boundary": 4 * words,
        f"{prefix}inside": 4 * words,
        # Twice while it is summed.
        f"{prefix}rank": 8 * ranks,
    }


def slab_nbytes(cells: Cells, slab: Slab) -> int:
    """Return the bytes of what crossings are flipped into beside the bricks."""
    last = cells.last
    return 4 * last.face_words * (slab.bricks + 2 * slab.layers * last.shape[0])


@dataclass(frozen=True)
class Room:
    """Where a build has to fit in.

    Attributes
    ----------
    session : Session
    job : Job
    grid : Grid
    surface : Surface
    levels : tuple of (3,) int
    """

    session: Session
    job: Job
    grid: Grid
    surface: Surface
    levels: tuple[Shape, ...]

    def require(self, arrays: Mapping[str, int], work: int = 0) -> int:
        """Return how many bytes are left beside the result and *work* bytes to work in.

        Nothing is allocated.  arrays: bytes of each array of the result, as far as they are known.

        Raises
        ------
        OutOfMemoryError
            It does not fit; the message says what is needed, and what would fit.
        """
        largest = self.session.device.largest_allocation
        main = max(arrays, key=lambda name: arrays[name])
        result = sum(map(self.session.size_of, arrays.values()))
        work += work // 16
        needed = result + work + LEAST_WORK
        shape = " x ".join(map(str, self.grid.shape))
        if self.session.size_of(arrays[main]) > largest:
            raise OutOfMemoryError(
                f"{shape} voxels need {arrays[main]:,} bytes in one buffer for {main}; "
                f"{self.session.device} allows {largest:,}. "
                f"{self._advice(dict(arrays), largest)}"
            )
        if needed > self.job.most:
            raise OutOfMemoryError(
                f"{shape} voxels need {needed:,} bytes of the device or more ({result:,} for the "
                f"result); {self.job.most:,} may be used. "
                f"{self._advice(dict(arrays), self.job.most - work - LEAST_WORK)}"
                "Otherwise give a larger memory_budget."
            )
        return self.job.most - result - work - SMALL

    def refuse_work(self, needed: int) -> NoReturn:
        """Refuse work on the thinnest slab that there is, which takes *needed* bytes or more.

        Advice allows for twice as many: nobody knows what would have been asked for next.

        Raises
        ------
        OutOfMemoryError
            In any case.
        """
        shape = " x ".join(map(str, self.grid.shape))
        raise OutOfMemoryError(
            f"{shape} voxels need {needed:,} bytes of the device or more, even one layer of cells "
            f"at a time; {self.job.most:,} may be used. "
            f"{self._advice({'work': 2 * needed}, self.job.most)}"
            "Otherwise give a larger memory_budget."
        ) from None

    def _advice(self, known: dict[str, int], room: int) -> str:
        """What would fit into *room* bytes; nothing if nothing would."""
        return advice(self.grid, self._coarsening(self._expected() | known, room))

    def _coarsening(self, arrays: Mapping[str, int], room: int) -> float | None:
        """By how much wider voxels would do; None if none would.

        Cells go with the cube of it, and bricks with its square.
        """
        for power in range(1, 500):
            factor = 1.02**power
            shape = scaled(self.grid.shape, factor)
            taken = top_nbytes(shape, self.levels)
            for name, nbytes in arrays.items():
                taken.setdefault(name, math.ceil(_MARGIN * nbytes / factor**2))
            taken["slab"] = self._slab_nbytes(shape, taken.get("bricks", 0))
            if sum(map(self.session.size_of, taken.values())) <= room:
                return factor
        return None

    def _slab_nbytes(self, shape: Shape, bricks_nbytes: int) -> int:
        """About how many bytes a slab of one layer takes; a layer has up to thrice its share."""
        if len(self.levels) == 1:
            return 4 * words_for(shape[0]) * shape[2]
        brick = self.levels[-1]
        depth = self.levels[1][2] if len(self.levels) == 3 else 1
        columns = cell_shape(shape, brick)
        bricks = bricks_nbytes // (4 * words_for(math.prod(brick)))
        share = -(-3 * bricks * depth // columns[2])
        return 4 * words_for(brick[0] * brick[2]) * (min(bricks, share) + 2 * depth * columns[0])

    def _expected(self) -> dict[str, int]:
        """About how many bytes the arrays take whose size the surface decides."""
        corners = self.surface.vertices / self.grid.spacing
        a, b, c = (corners[self.surface.faces[:, corner]] for corner in range(3))
        # A plane touches up to twice as many cells as its area holds faces of them.
        twice = float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
        arrays: dict[str, int] = {}
        if len(self.levels) > 1:
            bricks = math.ceil(twice / _face(self.levels[1:]))
            if len(self.levels) == 3:
                arrays |= _level("middle_", bricks * words_for(math.prod(self.levels[1])))
                bricks = math.ceil(twice / _face(self.levels[2:]))
            arrays["bricks"] = 4 * bricks * words_for(math.prod(self.levels[-1]))
        return arrays


def _face(bricks: tuple[Shape, ...]) -> float:
    """Area of a side of a cell, in voxels; of one as long as it is wide and high."""
    volume = math.prod(math.prod(brick) for brick in bricks)
    return float(volume ** (2 / 3))


def scaled(shape: Shape, factor: float) -> Shape:
    """Return the shape of a grid whose voxels are wider."""
    x, y, z = (math.ceil(count / factor) for count in shape)
    return x, y, z


def advice(grid: Grid, factor: float | None) -> str:
    """Return words for voxels wider by a factor, that would do; none if none would."""
    if factor is None:
        return ""
    widths = [round_up(width * factor) for width in grid.spacing]
    pitch = str(widths[0]) if len(set(widths)) == 1 else f"({', '.join(map(str, widths))})"
    longest = math.floor(max(grid.shape) / factor)
    return f"A pitch of {pitch}, about {longest} voxels along the longest side, would fit. "


def round_up(width: float) -> float:
    """Return a number of three significant digits that is not less."""
    digits = 2 - math.floor(math.log10(width))
    return round(math.ceil(width * 10.0**digits) / 10.0**digits, max(digits, 0))


def cut_slabs(cells: Cells, room: int) -> list[Slab]:
    """Return slabs that each take at most *room* bytes to flip in, or are one layer thick."""
    layers, bricks = _layers_and_bricks(cells)
    sizes = [
        slab_nbytes(cells, Slab(0, depth, 0, count))
        for depth, count in zip(layers, bricks, strict=True)
    ]
    slabs: list[Slab] = []
    taken = 0
    for size, depth, count in zip(sizes, layers, bricks, strict=True):
        if slabs and taken + size <= room:
            last = slabs[-1]
            slabs[-1] = last._replace(layers=last.layers + depth, bricks=last.bricks + count)
            taken += size
        else:
            at = slabs[-1] if slabs else Slab(0, 0, 0, 0)
            slabs.append(Slab(at.first_layer + at.layers, depth, at.first_brick + at.bricks, count))
            taken = size
    return slabs


def _layers_and_bricks(cells: Cells) -> tuple[list[int], list[int]]:
    """For each layer of coarse cells: the layers of cells of voxels in it, and their bricks."""
    counts = np.bitwise_count(cells.boundary.get()).sum(axis=(1, 2), dtype=np.int64)
    if cells.finer is None:
        return [1] * len(counts), counts.tolist()
    below = np.bitwise_count(cells.finer.boundary.get()).sum(axis=1, dtype=np.int64)
    before = np.concatenate([[0], np.cumsum(below)])
    ends = np.cumsum(counts)
    depth, all_layers = cells.brick[2], cells.finer.shape[2]
    layers = [min(depth, all_layers - first) for first in range(0, all_layers, depth)]
    return layers, (before[ends] - before[ends - counts]).tolist()
