"""Pictures of a model, by following a ray for each sample: `cl_kernels/raymarch`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pyopencl.array as cla

from clvox.device import Session
from clvox.device.session import Argument
from clvox.ops.attributes import Touched
from clvox.ops.beams import Beams, long4, ray_arguments
from clvox.ops.layout import VoxelArrays, float4, int2, int4
from clvox.ops.query import Rule
from clvox.picture_rays import PLANE_BITS, TIME_BITS, View

_MARCH = "raymarch/march.cl"

WIDTH = 8
"""Rays that go side by side on a processor, as the parts of a vector."""


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

    size: columns and rows of the whole picture; samples: root of the number of rays of a pixel,
    which are among `places` x `places` of them.  each: whether all of them are followed, or one of
    them, another one in each pixel of a row or column.
    count: pixels, from number *first* on, row by row; or, if `numbers` is given, uint32, those of
    its entries from *first* on.
    """

    size: tuple[int, int]
    samples: int
    first: int
    count: int
    numbers: cla.Array | None = None
    each: bool = True

    @classmethod
    def whole(cls, size: tuple[int, int], samples: int = 1, *, each: bool = True) -> Pixels:
        """All pixels of a picture."""
        return cls(size, samples, 0, size[0] * size[1], each=each)

    @property
    def places(self) -> int:
        """Places along the side of a pixel."""
        return self.samples**2

    def parts(self, rays: int) -> Iterator[Pixels]:
        """The same pixels, some after the other, of about so many rays at a time."""
        most = max(1, rays // self.rays_of_each)
        for first in range(0, self.count, most):
            yield replace(self, first=self.first + first, count=min(most, self.count - first))

    @property
    def rays(self) -> int:
        """How many rays there are."""
        return self.count * self.rays_of_each

    @property
    def rays_of_each(self) -> int:
        """How many rays of a pixel are followed."""
        return self.samples**2 if self.each else 1

    @property
    def defines(self) -> dict[str, int]:
        """What `raymarch/samples.h` is built with."""
        listed = int(self.numbers is not None)
        return {"LISTED": listed, "SAMPLES": self.samples, "EACH": int(self.each)}

    def arguments(self, other: cla.Array) -> tuple[Argument, ...]:
        """PIXEL_PARAMETERS of `raymarch/samples.h`; *other* stands in for a list."""
        numbers = other if self.numbers is None else self.numbers
        return int2(*self.size), np.uint64(self.first), np.uint64(self.count), numbers


def width_of(session: Session) -> int:
    """How many rays a work-item follows: elsewhere work-items are side by side already."""
    return WIDTH if session.device.kind == "cpu" else 1


def march(
    session: Session, scene: Scene, view: View, pixels: Pixels, beams: Beams | None = None
) -> Hits:
    """Return the first voxel along each ray that is inside, or touched if that is known.

    view: of rays through all places of the picture.
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
    width = width_of(session)
    defines = {"RULE": scene.rule, "LENGTHS": lengths, "WIDTH": width}
    defines |= {"PLANE": 0, "TILE": 0, "STATES": 0}
    plane = 0, 0, 0, 0
    if view.cut is not None:
        plane = *view.cut.normal, view.cut.most
        defines |= {"PLANE": 1, "PLANE_BITS": PLANE_BITS, "TIME_BITS": TIME_BITS}
    if beams is not None:
        near = beams.distances
        states = near.values if near.states is None else near.states
        known = beams.starts, int4(near.shape), near.values, states
        tile = beams.tile * pixels.places
        defines |= {"TILE": tile, "STATES": int(near.states is not None)}
        for name, side, cell in zip("XYZ", near.side, arrays.cell, strict=True):
            defines[f"BLOCK_{name}"] = side // cell
    kernel = session.kernel(_MARCH, "march", **defines, **pixels.defines, **arrays.defines)
    box = int4(arrays.shape), int4(arrays.columns), int4(view.low), int4(view.high)
    session.run(
        kernel,
        -(-pixels.rays // width),
        *pixels.arguments(none),
        *(*box, float4(scene.spacing), *ray_arguments(view.rays), long4(plane), *known),
        *(*arrays.arguments(scene.edge), voxels, far),
        steps=width * (sum(arrays.columns) // (4 if beams else 1) + 1),
    )
