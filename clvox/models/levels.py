"""Which levels a model has: the shape of its coarse grid, and of its bricks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clvox.errors import GridError
from clvox.grid import Grid, Shape
from clvox.ops.layout import cell_shape

Levels: TypeAlias = Sequence[ArrayLike]

MOST_CELLS = 1 << 27
"""Most cells of a coarse grid above bricks of voxels; a finer grid gets a level between."""

MOST_SIDE = 64
"""Longest side of a brick."""

BRICK = (8, 8, 8)
"""The bricks of default levels, for which the kernels are fastest."""

SMALL_BRICK = (4, 4, 4)
"""The bricks of voxels below a level of bricks: those need the fewest bytes."""


def resolve_levels(shape: Shape, levels: Levels | None) -> tuple[Shape, ...]:
    """Return the shapes of the levels asked for, or of the default ones, for *shape* voxels.

    Raises
    ------
    GridError
        The levels do not hold *shape*, or a brick's side is not between 1 and 64 voxels.
    """
    if levels is None:
        return _default(shape)
    shapes = _shapes(levels)
    if len(shapes) == 1 and shapes[0] != shape:
        raise GridError(f"one level must have the grid's shape {shape}, got {shapes[0]}")
    needed = shape
    for brick in shapes[:0:-1]:
        needed = cell_shape(needed, brick)
        if max(brick) > MOST_SIDE:
            raise GridError(f"a brick has 1 to {MOST_SIDE} cells or voxels a side, got {brick}")
    if shapes[0] != needed:
        raise GridError(
            f"a grid of {shape} voxels has {needed} coarse cells below {shapes[1:]}; levels say "
            f"{shapes[0]}"
        )
    return shapes


def _default(shape: Shape) -> tuple[Shape, ...]:
    """Two levels, or three as soon as those would have too many coarse cells.

    Of three levels, the smaller the last bricks the fewer bytes there are: all bricks of the
    surface together grow with their side.
    """
    cells = cell_shape(shape, BRICK)
    if math.prod(cells) <= MOST_CELLS:
        return cells, BRICK
    finest = SMALL_BRICK
    coarse = cell_shape(cell_shape(shape, finest), BRICK)
    if math.prod(coarse) > MOST_CELLS:
        finest = BRICK
        coarse = cell_shape(cells, BRICK)
    return coarse, BRICK, finest


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
    if not 1 <= len(shapes) <= 3:
        raise GridError(f"a model has one to three levels, got {len(shapes)}")
    if shapes.min() < 1:
        raise GridError(f"levels must be positive, got {levels!r}")
    return tuple((int(x), int(y), int(z)) for x, y, z in shapes)
