"""Where a picture is taken from: views, and their rays in integers.

A view knows nothing of grids; places are in voxels, (x, y, z), counted from the corner of voxel
(0, 0, 0), and `spacing` says how wide a voxel is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clvox.errors import GridError

Integers: TypeAlias = tuple[int, int, int]

STEP_BITS = 16
"""Steps in a voxel, as a power of two, on which rays are placed."""

MIN_DIRECTION_BITS, MAX_DIRECTION_BITS = 8, 17
"""Bits of the largest part of a direction."""

TIME_BITS = 61
"""Bits of the moments at which a ray meets the planes between voxels; their differences fit."""

PADDING = 256
"""More voxels than lie beyond the grid in its last cell, twice, and in one more cell."""

START_BITS = 62
"""Bits of the place of a ray before its fraction is dropped."""

MARGIN = 0.06
"""Part of the picture that stays empty on each side."""


@dataclass(frozen=True)
class Rays:
    """Parallel rays, one for each sample of a picture, in integers.

    The ray of column u and row v runs through ``(start + u * right + v * down) >> fraction``,
    in steps of 2**-bits voxels, and to both sides without end, along `direction`.

    A ray meets the plane p of axis j at the moment ``(p * 2**bits - place[j]) * pace[j]``, the
    pace being the product of the other parts of the direction that are not 0, with the sign of
    its own part: these moments are exact, and fit into 64 bits for all rays with a place below
    `reach`.
    """

    bits: int
    fraction: int
    reach: int
    direction: Integers
    start: Integers
    right: Integers
    down: Integers

    def below(self, row: int) -> Rays:
        """Return the rays from *row* on."""
        x, y, z = (at + row * step for at, step in zip(self.start, self.down, strict=True))
        return Rays(
            self.bits, self.fraction, self.reach, self.direction, (x, y, z), self.right, self.down
        )


@dataclass(frozen=True)
class View:
    """An orthographic view.

    Attributes
    ----------
    rays : Rays
    right, up, back : (3,) float64
        Unit vectors in the mesh's frame: right and up in the picture, and from it to the eye.
    """

    rays: Rays
    right: NDArray[np.float64]
    up: NDArray[np.float64]
    back: NDArray[np.float64]

    @classmethod
    def fit(
        cls,
        box: ArrayLike,
        shape: Integers,
        spacing: ArrayLike,
        size: tuple[int, int],
        *,
        direction: ArrayLike,
        up: ArrayLike,
    ) -> View:
        """Return the view along *direction* in which a box fills the picture.

        Parameters
        ----------
        box : (2, 3) float
            Lowest and highest corner, in voxels; within the grid.
        shape : (3,) int
            Voxels of the grid.
        spacing : (3,) float
        size : (int, int)
            Columns and rows of samples.
        direction, up : (3,) float
            Where the eye looks, and what is up, in the mesh's frame.

        Raises
        ------
        GridError
            The two are not finite, or parallel; or spacings differ too much to draw.
        """
        low, high = np.asarray(box, dtype=np.float64)
        widths = np.asarray(spacing, dtype=np.float64)
        ahead = _unit("direction", direction)
        # Places lie on a plane through the middle of the box, across the direction: that of a ray
        # which meets the grid is no farther from the middle than the grid's diagonal.
        diagonal = float(np.linalg.norm(np.array(shape) * widths))
        reach = float((diagonal / widths).max()) + 2 * max(shape) + PADDING
        reach_bits = math.ceil(math.log2(reach))
        most = (TIME_BITS - STEP_BITS - reach_bits) // 2
        if most < MIN_DIRECTION_BITS:
            raise GridError(f"voxels of {tuple(widths.tolist())} are too unequal to draw")
        direction_bits = min(most, MAX_DIRECTION_BITS)
        along = ahead / widths
        whole = np.rint(along / np.abs(along).max() * (2**direction_bits - 1))
        back = _unit("direction", -whole * widths)
        right = np.cross(_unit("up", up), back)
        if np.linalg.norm(right) < 1e-6:
            raise GridError(f"up must not be parallel to the direction {_plain(direction)}")
        right /= np.linalg.norm(right)
        above = np.cross(back, right)

        corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
        offsets = (corners - 0.5) * (high - low) * widths
        across = 2 * np.abs(offsets @ right).max(), 2 * np.abs(offsets @ above).max()
        step = max(extent / count for extent, count in zip(across, size, strict=True))
        step /= 1 - 2 * MARGIN

        columns, rows = size
        right_steps, down_steps = right * step / widths, -above * step / widths
        first = (low + high) / 2 - (columns - 1) / 2 * right_steps - (rows - 1) / 2 * down_steps
        farthest = float(
            (np.abs(first) + columns * np.abs(right_steps) + rows * np.abs(down_steps)).max()
        )
        fraction = min(16, START_BITS - STEP_BITS - math.ceil(math.log2(farthest + 1)))
        if fraction < 0:
            raise GridError(f"a picture of {columns} x {rows} is too unequal to draw")
        scale = 2.0 ** (STEP_BITS + fraction)
        rays = Rays(
            STEP_BITS,
            fraction,
            1 << (reach_bits + STEP_BITS),
            _integers(whole),
            _integers(first * scale),
            _integers(right_steps * scale),
            _integers(down_steps * scale),
        )
        return cls(rays, right, above, back)


def _integers(values: NDArray[np.float64]) -> Integers:
    x, y, z = (round(value) for value in values.tolist())
    return x, y, z


def _unit(name: str, value: ArrayLike) -> NDArray[np.float64]:
    try:
        vector = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        vector = np.empty(0)
    if vector.shape != (3,) or not np.isfinite(vector).all() or not vector.any():
        raise GridError(f"{name} must be three finite numbers, not all 0, got {_plain(value)!r}")
    vector = vector / np.abs(vector).max()
    unit: NDArray[np.float64] = vector / np.linalg.norm(vector)
    return unit


def _plain(value: object) -> object:
    return value.tolist() if isinstance(value, np.ndarray) else value
