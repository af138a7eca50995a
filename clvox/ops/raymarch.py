"""Pictures of a model, by following a ray for each sample: `cl_kernels/raymarch`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pyopencl.array as cla
from numpy.typing import NDArray
from pyopencl import cltypes

from clvox.camera import Integers, Rays, View
from clvox.device import Session
from clvox.device.session import Argument
from clvox.ops.layout import VoxelArrays, int2, int4
from clvox.ops.query import Rule

SIDE = 2
"""Samples along the side of a pixel."""

WINDOW = 3
"""A normal is the slope of the voxels that are at most so many away along each axis."""


@dataclass(frozen=True)
class Paint:
    """How a surface looks; colours are linear, (red, green, blue).

    offsets: (n, 3) float32, in voxels: where to look for what shades a place from the sky.
    background: colour and opacity.
    """

    colour: tuple[float, float, float]
    background: tuple[float, float, float, float]
    offsets: NDArray[np.float32]


def march_surface(
    session: Session, arrays: VoxelArrays, rays: Rays, size: tuple[int, int]
) -> cla.Array:
    """Return the first voxel that is inside along each ray, or -1, three times.

    size: columns and rows.  Returns (rows, columns, 3) int32 on the device.
    """
    columns, rows = size
    hits = session.empty((rows, columns, 3), np.int32)
    if hits.size == 0:
        return hits
    kernel = session.kernel(
        "raymarch/march_surface.cl", "march_surface", RULE=Rule.CENTRE, **arrays.defines
    )
    session.run(
        kernel,
        columns * rows,
        *(int2(columns, rows), int4(arrays.shape), int4(arrays.columns), *_ray_arguments(rays)),
        *(*arrays.arguments(), hits),
        steps=sum(arrays.columns),
    )
    return hits


def shade_surface(
    session: Session,
    arrays: VoxelArrays,
    view: View,
    spacing: tuple[float, float, float],
    hits: cla.Array,
    rays: Rays,
    paint: Paint,
) -> cla.Array:
    """Return the colours of the surface at *hits*, which `march_surface` found along *rays*.

    hits: SIDE x SIDE to a pixel.  Returns (rows, columns, 4) uint8 on the device: red, green and
    blue in sRGB, and opacity.
    """
    rows, columns = hits.shape[0] // SIDE, hits.shape[1] // SIDE
    pixels = session.empty((rows, columns, 4), np.uint8)
    if pixels.size == 0:
        return pixels
    kernel = session.kernel(
        "raymarch/shade_surface.cl",
        "shade_surface",
        RULE=Rule.CENTRE,
        SIDE=SIDE,
        WINDOW=WINDOW,
        **arrays.defines,
    )
    widths = np.array(spacing) / min(spacing)
    session.run(
        kernel,
        columns * rows,
        *(int2(columns, rows), int4(arrays.shape), *_ray_arguments(rays)),
        *(_float4(widths), _float4(view.right), _float4(view.up), _float4(view.back)),
        *(_float4(paint.colour), _float4(paint.background)),
        *(np.int32(len(paint.offsets)), session.upload(paint.offsets), hits),
        *(*arrays.arguments(), pixels),
        steps=SIDE**2 * (2 * WINDOW + 1) ** 3,
    )
    return pixels


def _ray_arguments(rays: Rays) -> tuple[Argument, ...]:
    """RAY_PARAMETERS of `raymarch/rays.h`."""
    return (
        np.int32(rays.bits),
        np.int32(rays.fraction),
        np.int64(rays.reach),
        *map(_long4, (rays.direction, rays.start, rays.right, rays.down)),
    )


def _long4(values: Integers) -> np.generic:
    return np.void((*values, 0), cltypes.long4)


def _float4(values: NDArray[np.float64] | tuple[float, ...]) -> np.generic:
    numbers = [*map(float, values), 0.0]
    return np.void(tuple(numbers[:4]), cltypes.float4)
