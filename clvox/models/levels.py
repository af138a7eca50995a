"""Which levels a model has: the shape of its coarse grid, and of its bricks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clvox.errors import GridError
from clvox.grid import Grid, Shape
from clvox.ops.layout import cell_shape

Levels: TypeAlias = Sequence[ArrayLike]

MOST_CELLS = 1 << 27
"""Most cells of a coarse grid; finer grids get larger bricks."""

MOST_SIDE = 64
"""Longest side of a brick, in voxels."""

BRICK_SIDES = 8, 16, 32, 64
"""Sides of the bricks tried by default, the fastest first."""


def resolve_levels(shape: Shape, levels: Levels | None) -> tuple[Shape, ...]:
    """Return the shapes of the levels asked for, or of the default ones, for *shape* voxels.

    Raises
    ------
    GridError
        The levels do not hold *shape*, or a brick's side is not between 1 and 64 voxels.
    """
    if levels is None:
        for side in BRICK_SIDES:
            brick = (side, side, side)
            cells = cell_shape(shape, brick)
            if cells[0] * cells[1] * cells[2] <= MOST_CELLS:
                return cells, brick
        raise GridError(
            f"a grid of {shape} voxels needs more than {MOST_CELLS} cells of {MOST_SIDE} voxels a "
            "side. Use a coarser pitch."
        )
    shapes = _shapes(levels)
    if len(shapes) == 1 and shapes[0] != shape:
        raise GridError(f"one level must have the grid's shape {shape}, got {shapes[0]}")
    if len(shapes) == 2:
        if max(shapes[1]) > MOST_SIDE:
            raise GridError(f"a brick has 1 to {MOST_SIDE} voxels a side, got {shapes[1]}")
        if shapes[0] != (needed := cell_shape(shape, shapes[1])):
            raise GridError(
                f"a grid of {shape} voxels has {needed} cells of {shapes[1]}; levels say "
                f"{shapes[0]}"
            )
    return shapes


def fill_box(bounds: NDArray[np.float64], levels: Levels) -> Grid:
    """Return the grid that the levels cut a box, (2, 3), into, without padding."""
    shapes = _shapes(levels)
    shape = np.prod(np.array(shapes, dtype=np.int64), axis=0)
    low, high = bounds
    return Grid(low, (high - low) / shape, shape)


def _shapes(levels: Levels) -> tuple[Shape, ...]:
    try:
        shapes = np.array(list(levels))
    except (TypeError, ValueError):
        shapes = np.array(None)
    if shapes.dtype.kind not in "iu" or shapes.ndim != 2 or shapes.shape[1] != 3:
        raise GridError(f"levels must be triples of integers, got {levels!r}")
    if not 1 <= len(shapes) <= 2:
        raise GridError(f"a model has one or two levels, got {len(shapes)}")
    if shapes.min() < 1:
        raise GridError(f"levels must be positive, got {levels!r}")
    return tuple((int(x), int(y), int(z)) for x, y, z in shapes)
