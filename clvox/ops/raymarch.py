"""Pictures of a model, by following a ray for each sample: `cl_kernels/raymarch`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pyopencl.array as cla
from pyopencl import cltypes

from clvox.camera import PLANE_BITS, TIME_BITS, Rays, View
from clvox.device import Session
from clvox.device.session import Argument
from clvox.grid import Shape
from clvox.ops.attributes import Touched
from clvox.ops.distances import Distances
from clvox.ops.layout import VoxelArrays, float4, int2, int4
from clvox.ops.query import Rule

_MARCH, _START = "raymarch/march.cl", "raymarch/start.cl"

TILE = 8
"""Pixels along the side of a tile whose rays go the first part of their way together."""


@dataclass(frozen=True)
class Scene:
    """What is drawn: a model, and what is known of the voxels that its mesh touches.

    normals: packed, of the touched voxels; `flip` is -1 if they point inwards.
    """

    arrays: VoxelArrays
    spacing: tuple[float, float, float]
    touched: Touched | None = None
    normals: cla.Array | None = None
    flip: int = 1

    @property
    def rule(self) -> Rule:
        """What rays meet: what is inside, and what is touched, if that is known."""
        return Rule.CENTRE if self.touched is None else Rule.TOUCH

    @property
    def edge(self) -> cla.Array | None:
        """Which voxels are touched."""
        return None if self.touched is None else self.touched.edge


class Hits(NamedTuple):
    """What rays meet: voxels, (rays, 4) int32, and how far off, (rays,) float32.

    A voxel is (i, j, k) and a word: the axis along which it is entered, or 3 for a plane at an
    angle, 4 if a cut opens it, and 8 times what it is: 0 inside, 1 touched, 2 part of a cell that
    is inside.  -1, -1, -1, 0 is nothing.  Distances are in directions of the rays.
    """

    voxels: cla.Array
    far: cla.Array


@dataclass(frozen=True)
class Pixels:
    """Some pixels of a picture, and how many rays there are for each.

    size: columns and rows of the whole picture; samples: rays along the side of a pixel.
    count: pixels, from number *first* on, row by row; or, if `numbers` is given, uint32, those of
    its entries from *first* on.
    """

    size: tuple[int, int]
    samples: int
    first: int
    count: int
    numbers: cla.Array | None = None

    @classmethod
    def whole(cls, size: tuple[int, int], samples: int = 1) -> Pixels:
        """All pixels of a picture."""
        return cls(size, samples, 0, size[0] * size[1])

    def parts(self, rays: int) -> Iterator[Pixels]:
        """The same pixels, some after the other, of about so many rays at a time."""
        most = max(1, rays // self.samples**2)
        for first in range(0, self.count, most):
            yield replace(self, first=self.first + first, count=min(most, self.count - first))

    @property
    def rays(self) -> int:
        """How many rays there are."""
        return self.count * self.samples**2

    @property
    def defines(self) -> dict[str, int]:
        """What `raymarch/samples.h` is built with."""
        return {"LISTED": int(self.numbers is not None), "SAMPLES": self.samples}

    def arguments(self, other: cla.Array) -> tuple[Argument, ...]:
        """PIXEL_PARAMETERS of `raymarch/samples.h`; *other* stands in for a list."""
        numbers = other if self.numbers is None else self.numbers
        return int2(*self.size), np.uint64(self.first), np.uint64(self.count), numbers


class Beams(NamedTuple):
    """How far the rays of each tile meet nothing, and the distances that say so.

    starts: (tiles,) float32, in directions.  tile: pixels along the side of a tile.
    """

    starts: cla.Array
    distances: Distances
    tile: int


def march(
    session: Session, scene: Scene, view: View, pixels: Pixels, beams: Beams | None = None
) -> Hits:
    """Return the first voxel along each ray that is inside, or touched if that is known.

    view: of all rays of the picture, as many as *pixels* says for each of its pixels.
    """
    voxels = session.empty((pixels.rays, 4), np.int32)
    far = session.empty(pixels.rays, np.float32)
    _follow(session, scene, view, pixels, beams, 0, voxels, far)
    return Hits(voxels, far)


def measure_lengths(
    session: Session, scene: Scene, view: View, pixels: Pixels, beams: Beams | None = None
) -> cla.Array:
    """Return the length of each ray within voxels that are inside, (rays,) float32."""
    far = session.empty(pixels.rays, np.float32)
    none = session.empty(1, np.int32)
    inside = Scene(scene.arrays, scene.spacing)
    _follow(session, inside, view, pixels, beams, 1, none, far)
    return far


def _follow(
    session: Session,
    scene: Scene,
    view: View,
    pixels: Pixels,
    beams: Beams | None,
    lengths: int,
    voxels: cla.Array,
    far: cla.Array,
) -> None:
    if pixels.rays == 0:
        return
    arrays = scene.arrays
    none = arrays.voxels
    known: tuple[Argument, ...] = none, int4((0, 0, 0)), none, none
    defines = {"RULE": scene.rule, "LENGTHS": lengths, "PLANE": 0, "TILE": 0, "STATES": 0}
    plane = 0, 0, 0, 0
    if view.cut is not None:
        plane = *view.cut.normal, view.cut.most
        defines |= {"PLANE": 1, "PLANE_BITS": PLANE_BITS, "TIME_BITS": TIME_BITS}
    if beams is not None:
        near = beams.distances
        states = near.values if near.states is None else near.states
        known = beams.starts, int4(near.shape), near.values, states
        tile = beams.tile * pixels.samples
        defines |= {"TILE": tile, "STATES": int(near.states is not None)}
        for name, side, cell in zip("XYZ", near.side, arrays.cell, strict=True):
            defines[f"BLOCK_{name}"] = side // cell
    kernel = session.kernel(_MARCH, "march", **defines, **pixels.defines, **arrays.defines)
    box = int4(arrays.shape), int4(arrays.columns), int4(view.low), int4(view.high)
    session.run(
        kernel,
        pixels.rays,
        *pixels.arguments(none),
        *(*box, float4(scene.spacing), *ray_arguments(view.rays), _long4(plane), *known),
        *(*arrays.arguments(scene.edge), voxels, far),
        steps=sum(arrays.columns) // (4 if beams else 1) + 1,
    )


def find_beams(
    session: Session,
    distances: Distances,
    shape: Shape,
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
    starts = find_starts(session, distances, shape, rays, fine, TILE * samples)
    return Beams(starts, distances, TILE)


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
        *(int2(columns, rows), int4(distances.shape), float4(per_block)),
        *(np.float32(_end(shape, rays, size)), *ray_arguments(rays), distances.values, starts),
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
        *map(_long4, (rays.start, rays.right, rays.down)),
        *map(_long4, (rays.direction, rays.turn_right, rays.turn_down)),
    )


def _long4(values: tuple[int, ...]) -> np.generic:
    return np.void((*values, 0)[:4], cltypes.long4)
