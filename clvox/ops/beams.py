"""How far the rays of a picture go before they may meet something: `cl_kernels/raymarch`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pyopencl.array as cla
from pyopencl import cltypes

from clvox.device import Session
from clvox.device.session import Argument
from clvox.grid import Shape
from clvox.ops.distances import Distances
from clvox.ops.layout import VoxelArrays, float4, int2, int4
from clvox.ops.query import Rule
from clvox.picture_rays import Rays

_START, _REFINE = "raymarch/start.cl", "raymarch/refine.cl"

TILE = 8
"""Pixels along the side of a tile whose rays go the first part of their way together."""

SMALL_TILE = 4
"""Pixels along the side of a tile whose rays go on together, near bricks."""

CRUMBS = 4
"""Crumbs along the sides of a brick."""


class Beams(NamedTuple):
    """How far the rays of each tile meet nothing, and the distances that say so.

    starts: (tiles,) float32, in directions.  tile: pixels along the side of a tile.
    """

    starts: cla.Array
    distances: Distances
    tile: int


def find_beams(
    session: Session,
    distances: Distances,
    arrays: VoxelArrays,
    rays: Rays,
    size: tuple[int, int],
    samples: int = 1,
) -> Beams | None:
    """Return how far rays go before they may meet something; None if they begin nowhere.

    size: columns and rows of pixels, with `samples` x `samples` rays each.
    """
    if not rays.begins:
        return None
    fine = size[0] * samples, size[1] * samples
    starts = find_starts(session, distances, arrays.shape, rays, fine, TILE * samples)
    if distances.crumbs is None:
        return Beams(starts, distances, TILE)
    starts = refine_starts(session, distances, arrays, rays, fine, starts, SMALL_TILE * samples)
    return Beams(starts, distances, SMALL_TILE)


def find_starts(
    session: Session,
    distances: Distances,
    shape: Shape,
    rays: Rays,
    size: tuple[int, int],
    tile: int = TILE,
) -> cla.Array:
    """Return how far the rays of each tile meet nothing, (tiles,) float32, in directions.

    Infinite for a tile whose rays meet nothing at all.  Rays begin somewhere.  tile: rays along
    its side.
    """
    columns, rows = size
    tiles = -(-columns // tile) * -(-rows // tile)
    starts = session.empty(tiles, np.float32)
    kernel = session.kernel(_START, "find_starts", TILE=tile)
    per_block = np.array(distances.side, np.float64) * 2.0**rays.bits
    session.run(
        kernel,
        tiles,
        *(int2(columns, rows), int4(distances.shape), float4([*per_block, 1.0])),
        *(np.float32(_end(shape, rays, size)), *ray_arguments(rays), distances.values, starts),
    )
    return starts


def refine_starts(
    session: Session,
    distances: Distances,
    arrays: VoxelArrays,
    rays: Rays,
    size: tuple[int, int],
    wide: cla.Array,
    tile: int = SMALL_TILE,
) -> cla.Array:
    """Return how far the rays of each small tile meet nothing, (tiles,) float32, in directions.

    wide: the same of tiles that are wider, as `TILE` is to `SMALL_TILE`.  tile: rays along the side
    of a small one, a multiple of `SMALL_TILE`.  The model has bricks, and *distances* their crumbs.
    """
    assert distances.crumbs is not None
    columns, rows = size
    tiles = -(-columns // tile) * -(-rows // tile)
    starts = session.empty(tiles, np.float32)
    defines = {
        "TILE": tile,
        "WIDE_TILE": tile // SMALL_TILE * TILE,
        "STATES": int(distances.states is not None),
        "RULE": Rule.CENTRE,
    }
    kernel = session.kernel(_REFINE, "refine_starts", **defines, **arrays.defines)
    per_crumb = np.array(arrays.cell, np.float64) * (2.0**rays.bits / CRUMBS)
    states = distances.values if distances.states is None else distances.states
    session.run(
        kernel,
        tiles,
        *(int2(columns, rows), int4(arrays.columns), float4([*per_crumb, 1.0])),
        *(*ray_arguments(rays), wide, states, distances.crumbs, *arrays.arguments(), starts),
        steps=32,
    )
    return starts


def _end(shape: Shape, rays: Rays, size: tuple[int, int]) -> float:
    """In directions, a moment at which all rays are past the grid, or beside it for ever."""
    columns, rows = size
    corners = np.array([(u, v) for u in (0, columns) for v in (0, rows)], np.float64)
    across, along = np.array(rays.turn_right, float), np.array(rays.turn_down, float)
    ahead = np.array(rays.direction, float) + corners[:, :1] * across + corners[:, 1:] * along
    middle = ahead.mean(axis=0) / 2.0**rays.turn
    start = np.array(rays.start, float) + corners.mean(axis=0) @ np.stack(
        [np.array(rays.right, float), np.array(rays.down, float)]
    )
    start = start / 2.0**rays.fraction
    # Rays of one picture are as far along the view at any moment, and the view is that of the
    # middle one, up to unequal spacings: twice as far is far enough.
    reach = np.abs(start).max() + max(shape) * 2.0**rays.bits
    return float(4 * np.sqrt(3) * reach / np.abs(middle).max())


def ray_arguments(rays: Rays) -> tuple[Argument, ...]:
    """RAY_PARAMETERS of `raymarch/rays.h`."""
    return (
        *(np.int32(rays.bits), np.int32(rays.fraction), np.int32(rays.turn)),
        *(np.int32(rays.begins), np.int64(rays.reach)),
        *map(long4, (rays.start, rays.right, rays.down)),
        *map(long4, (rays.direction, rays.turn_right, rays.turn_down)),
    )


def long4(values: tuple[int, ...]) -> np.generic:
    """A kernel's argument for up to four wide integers."""
    return np.void((*values, 0)[:4], cltypes.long4)
