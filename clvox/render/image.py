"""The picture of a model, as an array."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clvox.camera import View
from clvox.errors import GridError
from clvox.models import VoxelModel
from clvox.ops.raymarch import SIDE, Paint, march_surface, shade_surface

DIRECTION = -0.62, 1.0, -0.72
"""Where the eye looks by default: from the front, the right, and above."""

COLOUR = 0.26, 0.42, 0.62
"""Of the surface; linear, as are all colours here."""

SKY_POINTS = 96
"""Places looked at around a place, to see how much of the sky is hidden there."""

SKY_REACH = 0.05
"""How far they are away at most, as a part of the grid's longest side."""

MAX_SIDE = 16384
"""Most pixels along a side of a picture."""

SAMPLES_PER_LAUNCH = 1 << 18


def render(
    model: VoxelModel,
    *,
    size: tuple[int, int] = (1920, 1080),
    direction: ArrayLike = DIRECTION,
    up: ArrayLike = (0.0, 0.0, 1.0),
    background: tuple[int, int, int] | None = None,
) -> NDArray[np.uint8]:
    """Return a picture of the surface of a model, seen from far away.

    The view is orthographic, and as close as the whole solid allows.  Which voxel a ray meets
    first is exact, and the same on every device; colours may differ by rounding.

    Parameters
    ----------
    model : VoxelModel
    size : (int, int)
        Columns and rows of pixels, each from 1 to 16384.
    direction, up : (3,) float
        Where the eye looks, and what is up.
    background : (int, int, int), optional
        Red, green and blue from 0 to 255, in sRGB; by default the background is transparent.

    Returns
    -------
    (h, w, 4) uint8
        Red, green and blue in sRGB, and opacity, not multiplied into them.

    Raises
    ------
    GridError
        The size, the direction or the background makes no sense.

    Examples
    --------
    >>> import clvox, trimesh
    >>> ball = clvox.voxelize(trimesh.creation.icosphere(radius=10.0), resolution=64)
    >>> clvox.render(ball, size=(64, 48)).shape
    (48, 64, 4)
    """
    columns, rows = _size(size)
    paint = Paint(COLOUR, _background(background), _offsets(model))
    samples = columns * SIDE, rows * SIDE
    grid = model.grid
    view = View.fit(_box(model), grid.shape, grid.spacing, samples, direction=direction, up=up)
    # What a model holds is for the modules below; a picture reads it as the model itself does.
    session, arrays = model._session, model._arrays  # noqa: SLF001
    image = np.empty((rows, columns, 4), np.uint8)
    band = max(1, SAMPLES_PER_LAUNCH // (samples[0] * SIDE))
    for row in range(0, rows, band):
        count = min(band, rows - row)
        rays = view.rays.below(row * SIDE)
        hits = march_surface(session, arrays, rays, (samples[0], count * SIDE))
        pixels = shade_surface(session, arrays, view, grid.spacing, hits, rays, paint)
        image[row : row + count] = pixels.get()
    return image


def _box(model: VoxelModel) -> NDArray[np.float64]:
    """The part of the grid to look at, in voxels: where there are cells that are not empty."""
    shape = np.array(model.grid.shape, dtype=np.float64)
    whole = np.stack([np.zeros(3), shape])
    if len(model.levels) == 1:
        return whole
    occupied = model.to_array(level=0) != 0
    if not occupied.any():
        return whole
    low, high = [], []
    for axis in (2, 1, 0):
        others = tuple({0, 1, 2} - {axis})
        (found,) = np.nonzero(occupied.any(axis=others))
        low.append(found[0])
        high.append(found[-1] + 1)
    cell = np.prod(model.levels[1:], axis=0)
    box: NDArray[np.float64] = np.minimum(np.array([low, high]) * cell, shape)
    return box


def _offsets(model: VoxelModel) -> NDArray[np.float32]:
    """Places in a ball, in voxels, spread evenly over directions and distances."""
    number = np.arange(SKY_POINTS) + 0.5
    z = 1 - 2 * number / SKY_POINTS
    turn = number * np.pi * (3 - np.sqrt(5.0))
    ring = np.sqrt(1 - z * z)
    directions = np.stack([ring * np.cos(turn), ring * np.sin(turn), z], axis=1)
    # The golden ratio once more, so that distance and direction do not go together.
    distance = (number * (np.sqrt(5.0) - 1) / 2) % 1
    widths = np.array(model.grid.spacing)
    reach = max(SKY_REACH * float((widths * model.grid.shape).max()), 3 * float(widths.max()))
    offsets: NDArray[np.float32] = (directions * reach * distance[:, None] / widths).astype("f4")
    return offsets


def _size(size: tuple[int, int]) -> tuple[int, int]:
    numbers = np.asarray(size)
    if numbers.shape != (2,) or numbers.dtype.kind not in "iu":
        raise GridError(f"size must be two integers, columns and rows, got {size!r}")
    if numbers.min() < 1 or numbers.max() > MAX_SIDE:
        raise GridError(f"size must be from 1 to {MAX_SIDE} pixels a side, got {size!r}")
    columns, rows = numbers.tolist()
    return columns, rows


def _background(colour: tuple[int, int, int] | None) -> tuple[float, float, float, float]:
    if colour is None:
        return 0.0, 0.0, 0.0, 0.0
    numbers = np.asarray(colour)
    if numbers.shape != (3,) or numbers.dtype.kind not in "iu":
        raise GridError(f"background must be three integers, got {colour!r}")
    if numbers.min() < 0 or numbers.max() > 255:
        raise GridError(f"background must be from 0 to 255, got {colour!r}")
    part = numbers / 255
    linear = np.where(part <= 0.04045, part / 12.92, ((part + 0.055) / 1.055) ** 2.4)
    red, green, blue = linear.tolist()
    return red, green, blue, 1.0
