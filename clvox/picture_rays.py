"""The rays of a picture, in integers.

Rays live in a grid: their places are in steps of a voxel, (x, y, z), counted from the corner of
voxel (0, 0, 0).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clvox.errors import GridError

if TYPE_CHECKING:
    from clvox.grid import Grid

Integers: TypeAlias = tuple[int, int, int]

STEP_BITS = 16
"""Steps in a voxel, as a power of two, on which parallel rays are placed."""

EYE_STEP_BITS = 10
"""The same for rays from an eye: fewer, so that more bits are left to tell directions apart."""

MIN_DIRECTION_BITS, MAX_DIRECTION_BITS = 8, 17
"""Bits of the largest part of a direction."""

TURN_BITS = 24
"""Bits of a direction's part that are dropped: pixels need not be whole steps apart."""

TIME_BITS = 61
"""Bits of the moments at which a ray meets the planes between voxels; their differences fit."""

PADDING = 256
"""More voxels than lie beyond the grid in its last cell of voxels, twice, and in one more cell.

Rays look farther only with two levels: up to 64 cells of at most 64 voxels (`ops.distances`).
Where the fewest bits of a moment are spare for it, that is with a reach of 2**11 voxels and 17 bits
of directions, such a moment is up to (2**11 + 2**12) * 2**(16 + 2 * 17), which is below 2**63.
"""

START_BITS = 62
"""Bits of the place of a ray before its fraction is dropped."""

PLANE_BITS = 20
"""Bits behind the point of the moment at which a ray meets a plane, in directions."""

PLANE_NORMAL_BITS = 24
"""Most bits of the largest part of a plane's normal."""


@dataclass(frozen=True)
class Rays:
    """The rays of a picture, in columns and rows, in integers.

    The ray of column u and row v runs through the place ``(start + u * right + v * down) >>
    fraction``, in steps of 2**-bits voxels, along ``(direction + u * turn_right + v * turn_down)
    >> turn``.  It begins there, at the moment 0, if it `begins`, and otherwise has no ends.

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
    turn: int = 0
    turn_right: Integers = (0, 0, 0)
    turn_down: Integers = (0, 0, 0)
    begins: bool = False


@dataclass(frozen=True)
class Plane:
    """A plane that cuts away what lies beyond it, in the places of rays.

    A place is kept if its product with *normal* is at most *most*.  A ray meets the plane at the
    moment ``whole * turns + (whole * parts >> PLANE_BITS)``, where whole is the moments of one
    direction, and turns and parts are the quotient, rounded down, of how far the plane is by how
    fast the ray nears it, and its first `PLANE_BITS` bits behind the point.

    facing: unit normal, in the mesh's frame.  beyond: the same plane for places in voxels: their
    product with the first three parts is above the fourth beyond it.
    """

    normal: Integers
    most: int
    facing: NDArray[np.float64]
    beyond: tuple[float, float, float, float]


@dataclass(frozen=True)
class View:
    """A camera in front of a grid.

    Attributes
    ----------
    rays : Rays
    right, up, back : (3,) float64
        Unit vectors in the mesh's frame: right and up in the picture, and from it to the eye.
    low, high : (3,) int
        The voxels that are drawn: from *low* to before *high*.
    pixel : (float, float)
        How far apart rays are, in the mesh's unit, where they begin, and how much farther at each
        unit of length farther along the view.
    begin : float
        How far from the eye rays begin, along the view.
    cut : Plane, optional
        What lies beyond it is not drawn.
    """

    rays: Rays
    right: NDArray[np.float64]
    up: NDArray[np.float64]
    back: NDArray[np.float64]
    low: Integers
    high: Integers
    pixel: tuple[float, float]
    begin: float
    cut: Plane | None = None


def integer_rays(
    grid: Grid,
    size: tuple[int, int],
    places: tuple[NDArray[np.float64], ...],
    directions: tuple[NDArray[np.float64], ...],
    *,
    from_eye: bool,
) -> Rays:
    """Return rays, rounded: places, directions: in voxels, of the first, and per column and row."""
    columns, rows = size
    shape = np.array(grid.shape)
    ends = [
        [part[0] + u * part[1] + v * part[2] for u in (0, columns) for v in (0, rows)]
        for part in (places, directions)
    ]
    farthest, steepest = (float(np.abs(end).max()) for end in ends)
    if not math.isfinite(farthest + steepest) or steepest == 0:
        raise GridError("the camera's numbers are too large to draw with")
    # A ray that meets the grid and is parallel to its neighbours begins within twice its diagonal.
    widths = np.array(grid.spacing)
    diagonal = float(np.linalg.norm(shape * widths) / widths.min())
    reach = (farthest if from_eye else min(farthest, 2 * diagonal)) + 2 * shape.max() + PADDING
    reach_bits = math.ceil(math.log2(reach))
    bits = EYE_STEP_BITS if from_eye else STEP_BITS
    most = (TIME_BITS - bits - reach_bits) // 2
    if most < MIN_DIRECTION_BITS:
        raise GridError(
            f"the eye is too far away, or voxels of {tuple(widths.tolist())} are too unequal to "
            "draw"
        )
    direction_bits = min(most, MAX_DIRECTION_BITS)
    turn = TURN_BITS if from_eye else 0
    fraction = min(16, START_BITS - bits - math.ceil(math.log2(farthest + 1)))
    if fraction < 0:
        raise GridError(f"a picture of {columns} x {rows} is too unequal to draw")
    scale = 2.0 ** (bits + fraction)
    grow = (2**direction_bits - 1) / steepest * 2.0**turn
    ahead, turn_right, turn_down = (integers(np.rint(part * grow)) for part in directions)
    start, right, down = (integers(part * scale) for part in places)
    return Rays(
        bits,
        fraction,
        1 << (reach_bits + bits),
        ahead,
        start,
        right,
        down,
        turn,
        turn_right,
        turn_down,
        begins=True,
    )


def cutting_plane(
    grid: Grid, rays: Rays, point: NDArray[np.float64], normal: NDArray[np.float64]
) -> Plane:
    """Return the plane through *point* that cuts away what lies ahead along *normal*."""
    widths = np.array(grid.spacing)
    # Nothing is drawn so far off, and what is farther would not fit into float32.
    farthest = 2.0**60 * widths
    place = np.clip(point - grid.origin, -farthest, farthest) / widths
    across = normal * widths
    across /= np.abs(across).max()
    # So that products with places fit into 62 bits, and those with directions into 43.
    most_bits = min(PLANE_NORMAL_BITS, TIME_BITS - 2 - rays.reach.bit_length())
    whole = integers(across * (2**most_bits - 1))
    steps = integers(place * 2.0**rays.bits)
    most = sum(part * at for part, at in zip(whole, steps, strict=True))
    limit = 1 << TIME_BITS
    beyond = *(across.tolist()), float(across @ place)
    facing = normal / np.linalg.norm(normal)
    return Plane(whole, max(-limit, min(most, limit)), facing, beyond)


def integers(values: NDArray[np.float64]) -> Integers:
    """Return three numbers, rounded."""
    x, y, z = (round(value) for value in values.tolist())
    return x, y, z
