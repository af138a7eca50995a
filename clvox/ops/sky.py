"""How full the space around each place is: `cl_kernels/raymarch/sky.cl`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pyopencl.array as cla
from numpy.typing import NDArray

from clvox.device import Session
from clvox.grid import Shape
from clvox.ops.layout import VoxelArrays, float4, int4
from clvox.ops.query import Rule

_FILE = "raymarch/sky.cl"

ALONG = 80
"""About how many blocks there are along the longest side."""

REACH = 0.025
"""How far hollows are felt, as a part of the grid's longest side: the blur's standard deviation."""

FEWEST = 1.5
"""It is at least so many voxels."""

MARGIN = 6
"""Empty blocks around the grid, so that there is a sky above its faces."""

WIDEST = 1 << 20
"""Most voxels along a block's side, more than any grid has: products of three fit into 63 bits."""

ONE = 1 << 16
"""The sum of all weights of a blur."""


@dataclass(frozen=True)
class Sky:
    """Blocks of voxels, and how much of each and of what is around it is inside.

    shape: blocks (x, y, z), those of the margin included; side: voxels along the sides of one.
    reach: the blur's standard deviation, in the mesh's unit.
    values: uint8, x fastest, 255 where everything is inside.
    """

    shape: Shape
    side: Shape
    reach: float
    values: cla.Array

    @property
    def nbytes(self) -> int:
        """Bytes on the device."""
        return int(self.values.nbytes)


@dataclass(frozen=True)
class Part:
    """The part of a model that is drawn: what has been cut away hides no sky.

    low, high: the voxels from *low* to before *high*.  plane: what lies beyond it is cut away:
    voxels whose place, from the grid's corner, times its first three parts is above the fourth.
    """

    low: Shape
    high: Shape
    plane: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)


def measure_sky(
    session: Session,
    arrays: VoxelArrays,
    spacing: tuple[float, float, float],
    part: Part | None = None,
) -> Sky:
    """Return how full the space in and around a model is, or in and around a part of it."""
    part = part or Part((0, 0, 0), arrays.shape)
    widths = np.array(spacing)
    longest = float((widths * arrays.shape).max())
    reach = max(REACH * longest, FEWEST * float(widths.max()))
    side = _block_side(arrays.cell, widths, longest / ALONG)
    x, y, z = (-(-np.array(arrays.shape) // side) + 2 * MARGIN).tolist()
    shape, sides = (x, y, z), int4((int(side[0]), int(side[1]), int(side[2])))
    count = x * y * z
    values, other = session.empty(count, np.uint8), session.empty(count, np.uint8)
    defines = {"RULE": Rule.CENTRE, "MARGIN": MARGIN, **arrays.defines}
    kernel = session.kernel(_FILE, "share_out", **defines)
    box = int4(part.low), int4(part.high)
    session.run(
        kernel,
        count,
        *(int4(shape), sides, *box, float4(part.plane), *arrays.arguments(), values),
        steps=max(1, int(np.prod(side)) // 8),
    )
    kernel = session.kernel(_FILE, "blur", **defines)
    for axis in range(3):
        weights = blur_weights(reach / float(widths[axis] * side[axis]))
        last = np.int32(len(weights) - 1)
        given = session.upload(weights)
        session.run(kernel, count, int4(shape), np.int32(axis), last, given, values, other)
        values, other = other, values
    return Sky(shape, (int(side[0]), int(side[1]), int(side[2])), reach, values)


def blur_weights(deviation: float) -> NDArray[np.int32]:
    """Return the weights of a place and of those on one side of it; all, on both, make `ONE`."""
    reach = min(max(1, round(2.5 * deviation)), 2 * MARGIN)
    shares = np.exp(-0.5 * (np.arange(reach + 1) / max(deviation, 1e-3)) ** 2)
    shares[1:] *= 2
    weights = np.floor(shares / shares.sum() * ONE / np.where(np.arange(reach + 1) > 0, 2, 1))
    weights[0] += ONE - (weights[0] + 2 * weights[1:].sum())
    whole: NDArray[np.int32] = weights.astype(np.int32)
    return whole


def _block_side(cell: Shape, widths: NDArray[np.float64], wanted: float) -> NDArray[np.int64]:
    """Voxels along the sides of a block about *wanted* wide: whole cells, if they are smaller."""
    voxels = np.clip(np.rint(wanted / widths), 1, WIDEST).astype(np.int64)
    cells = np.maximum(1, np.rint(voxels / cell)).astype(np.int64) * cell
    side: NDArray[np.int64] = np.where(np.array(cell) <= 1.5 * voxels, cells, voxels)
    return side
