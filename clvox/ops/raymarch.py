"""Pictures of a model, by following a ray for each sample: `cl_kernels/raymarch`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pyopencl.array as cla
from numpy.typing import NDArray
from pyopencl import cltypes

from clvox.camera import Integers, Rays, View
from clvox.device import Session
from clvox.device.session import Argument
from clvox.grid import Shape
from clvox.ops.attributes import Touched
from clvox.ops.distances import Distances
from clvox.ops.layout import VoxelArrays, int2, int4
from clvox.ops.query import Rule

_MARCH, _SHADE, _VOLUME = "raymarch/march.cl", "raymarch/shade.cl", "raymarch/shade_volume.cl"
_START = "raymarch/start.cl"

TILE = 8
"""Rays along the side of a tile whose rays go the first part of their way together."""

WINDOW = 3
"""A normal is the slope of the voxels that are at most so many away along each axis."""

LIGHTS = 2


@dataclass(frozen=True)
class Scene:
    """What is drawn: a model, and what is known of the voxels that its mesh touches.

    normals: packed, of the touched voxels; `flip` is -1 if they point inwards.
    distances: lets rays that begin somewhere skip what is empty.
    """

    arrays: VoxelArrays
    spacing: tuple[float, float, float]
    touched: Touched | None = None
    normals: cla.Array | None = None
    flip: int = 1
    distances: Distances | None = None

    @property
    def rule(self) -> Rule:
        """What rays meet: what is inside, and what is touched, if that is known."""
        return Rule.CENTRE if self.touched is None else Rule.TOUCH

    @property
    def edge(self) -> cla.Array | None:
        """Which voxels are touched."""
        return None if self.touched is None else self.touched.edge


class Hits(NamedTuple):
    """What rays meet: voxels, (rows, columns, 4) int32, and how far off, (rows, columns) float32.

    A voxel is (i, j, k) and a word: the axis along which it is entered, 4 if a cut opens it, and 8
    times what it is: 0 inside, 1 touched, 2 part of a cell that is inside.  -1, -1, -1, 0 is
    nothing.  Distances are in directions of the rays.
    """

    voxels: cla.Array
    far: cla.Array


@dataclass(frozen=True)
class Paint:
    """How things look; colours are linear, (red, green, blue).

    colours: of what is inside, touched, in a cell that is inside, and cut open.
    ambient, diffuse, specular, shininess, emission: of Phong's law.
    background: colour and opacity.  lines: whether the edges of voxels are drawn.
    offsets: (n, 3) float32, in voxels: where to look for what shades a place from the sky.
    """

    colours: tuple[tuple[float, float, float], ...]
    ambient: float
    diffuse: float
    specular: float
    shininess: float
    emission: float
    background: tuple[float, float, float, float]
    offsets: NDArray[np.float32]
    lines: bool = False


def march(session: Session, scene: Scene, view: View, rays: Rays, size: tuple[int, int]) -> Hits:
    """Return the first voxel along each ray that is inside, or touched if that is known.

    size: columns and rows.
    """
    columns, rows = size
    voxels = session.empty((rows, columns, 4), np.int32)
    far = session.empty((rows, columns), np.float32)
    _follow(session, scene, view, rays, size, 0, voxels, far)
    return Hits(voxels, far)


def measure_lengths(
    session: Session, scene: Scene, view: View, rays: Rays, size: tuple[int, int]
) -> cla.Array:
    """Return the length of each ray within voxels that are inside, (rows, columns) float32."""
    columns, rows = size
    far = session.empty((rows, columns), np.float32)
    none = session.empty(1, np.int32)
    inside = Scene(scene.arrays, scene.spacing, distances=scene.distances)
    _follow(session, inside, view, rays, size, 1, none, far)
    return far


def _follow(
    session: Session,
    scene: Scene,
    view: View,
    rays: Rays,
    size: tuple[int, int],
    lengths: int,
    voxels: cla.Array,
    far: cla.Array,
) -> None:
    columns, rows = size
    if columns * rows == 0:
        return
    arrays = scene.arrays
    near = scene.distances if rays.begins else None
    none = arrays.voxels
    beams: tuple[Argument, ...] = none, int4((0, 0, 0)), none, none
    defines = {"RULE": scene.rule, "LENGTHS": lengths, "TILE": 0, "STATES": 0, **arrays.defines}
    if near is not None:
        starts = find_starts(session, near, arrays.shape, rays, size)
        states = near.values if near.states is None else near.states
        beams = starts, int4(near.shape), near.values, states
        defines |= {"TILE": TILE, "STATES": int(near.states is not None)}
        for name, side, cell in zip("XYZ", near.side, arrays.cell, strict=True):
            defines[f"BLOCK_{name}"] = side // cell
    kernel = session.kernel(_MARCH, "march", **defines)
    box = int4(arrays.shape), int4(arrays.columns), int4(view.low), int4(view.high)
    session.run(
        kernel,
        columns * rows,
        *(int2(columns, rows), *box, _float4(scene.spacing), *_ray_arguments(rays), *beams),
        *(*arrays.arguments(scene.edge), voxels, far),
        steps=sum(arrays.columns),
    )


def find_starts(
    session: Session, distances: Distances, shape: Shape, rays: Rays, size: tuple[int, int]
) -> cla.Array:
    """Return how far the rays of each tile meet nothing, (tiles,) float32, in directions.

    Infinite for a tile whose rays meet nothing at all.  Rays begin somewhere.
    """
    columns, rows = size
    tiles = -(-columns // TILE) * -(-rows // TILE)
    starts = session.empty(tiles, np.float32)
    kernel = session.kernel(_START, "find_starts", TILE=TILE)
    per_block = np.array(distances.side, np.float64) * 2.0**rays.bits
    session.run(
        kernel,
        tiles,
        *(int2(columns, rows), int4(distances.shape), _float4(per_block)),
        *(np.float32(_end(shape, rays, size)), *_ray_arguments(rays), distances.values, starts),
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


def shade(
    session: Session,
    scene: Scene,
    view: View,
    rays: Rays,
    hits: Hits,
    samples: int,
    paint: Paint,
) -> cla.Array:
    """Return the colours of *hits*, `samples` x `samples` of which are a pixel.

    Returns (rows, columns, 4) uint8 on the device: red, green and blue in sRGB, and opacity.
    """
    rows, columns = (count // samples for count in hits.far.shape)
    pixels = session.empty((rows, columns, 4), np.uint8)
    if pixels.size == 0:
        return pixels
    arrays = scene.arrays
    stored = scene.normals is not None and scene.touched is not None
    defines = {
        "RULE": Rule.CENTRE,
        "SAMPLES": samples,
        "WINDOW": WINDOW,
        "STORED": int(stored),
        "LINES": int(paint.lines),
        "LIGHTS": LIGHTS,
        **arrays.defines,
    }
    kernel = session.kernel(_SHADE, "shade", **defines)
    widths = np.array(scene.spacing)
    none = arrays.voxels
    kept: tuple[Argument, ...] = none, none, none
    if scene.touched is not None and scene.normals is not None:
        kept = scene.touched.edge, scene.touched.rank, scene.normals
    phong = paint.ambient, paint.diffuse, paint.specular, paint.shininess
    colours = np.array(paint.colours, np.float32)
    pixel, spread = view.pixel
    session.run(
        kernel,
        columns * rows,
        *(int2(columns, rows), int4(arrays.shape), int4(view.low), int4(view.high)),
        *(*_ray_arguments(rays), _float4(widths)),
        *(_float4(view.right), _float4(view.up), _float4(view.back)),
        *(_float4(phong), np.float32(paint.emission), _float4(paint.background)),
        *(np.float32(pixel), np.float32(spread), np.float32(scene.flip)),
        *(session.upload(colours), np.int32(len(paint.offsets)), session.upload(paint.offsets)),
        *(hits.voxels, hits.far, *arrays.arguments(scene.edge), *kept, pixels),
        steps=samples**2 * (8 if stored else (2 * WINDOW + 1) ** 3) + len(paint.offsets),
    )
    return pixels


def shade_volume(
    session: Session,
    lengths: cla.Array,
    samples: int,
    colours: tuple[tuple[float, float, float], tuple[float, float, float]],
    density: float,
    *,
    counted: bool,
    background: tuple[float, float, float, float],
) -> cla.Array:
    """Return the colours of *lengths* within a solid, `samples` x `samples` of which are a pixel.

    colours: where little of the light is held back, and where nearly all of it is.  density: for
    each unit of length.  counted: opacity grows with the length, and not by Beer and Lambert's law.
    """
    rows, columns = (count // samples for count in lengths.shape)
    pixels = session.empty((rows, columns, 4), np.uint8)
    if pixels.size:
        kernel = session.kernel(_VOLUME, "shade_volume", SAMPLES=samples)
        session.run(
            kernel,
            columns * rows,
            *(int2(columns, rows), np.float32(density), np.int32(counted)),
            *(_float4(colours[0]), _float4(colours[1]), _float4(background), lengths, pixels),
        )
    return pixels


def _ray_arguments(rays: Rays) -> tuple[Argument, ...]:
    """RAY_PARAMETERS of `raymarch/rays.h`."""
    return (
        *(np.int32(rays.bits), np.int32(rays.fraction), np.int32(rays.turn)),
        *(np.int32(rays.begins), np.int64(rays.reach)),
        *map(_long4, (rays.start, rays.right, rays.down)),
        *map(_long4, (rays.direction, rays.turn_right, rays.turn_down)),
    )


def _long4(values: Integers) -> np.generic:
    return np.void((*values, 0), cltypes.long4)


def _float4(values: NDArray[np.float64] | tuple[float, ...]) -> np.generic:
    numbers = [*map(float, values), 0.0]
    return np.void(tuple(numbers[:4]), cltypes.float4)
