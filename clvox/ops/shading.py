"""The colours of what rays meet: `cl_kernels/raymarch`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pyopencl.array as cla

from clvox.device import Session
from clvox.device.session import Argument
from clvox.ops.beams import ray_arguments
from clvox.ops.facets import Facets
from clvox.ops.layout import float4, int2, int4
from clvox.ops.query import Rule
from clvox.ops.raymarch import Hits, Pixels, Scene
from clvox.ops.sky import MARGIN, Sky
from clvox.picture_rays import View

_SHADE, _VOLUME = "raymarch/shade.cl", "raymarch/shade_volume.cl"
_CHOOSE = "raymarch/choose.cl"

WINDOW = 3
"""A normal is the slope of the voxels that are at most so many away along each axis."""

_KEY, _FILL = np.array([(-0.55, 0.8, 0.75), (0.9, -0.1, 0.5)])

TOWARD_LIGHTS = tuple(toward / np.linalg.norm(toward) for toward in (_KEY, _FILL))
"""Where light comes from: right, up and back in the picture.  Key and fill."""


@dataclass(frozen=True)
class Paint:
    """How things look; colours are linear, (red, green, blue).

    colours: of what is inside, touched, in a cell that is inside, and cut open.
    ambient, diffuse, specular, shininess, emission: of Phong's law.
    background: colour and opacity.  lines: whether the edges of voxels are drawn.
    """

    colours: tuple[tuple[float, float, float], ...]
    ambient: float
    diffuse: float
    specular: float
    shininess: float
    emission: float
    background: tuple[float, float, float, float]
    lines: bool = False


@dataclass(frozen=True)
class Coat:
    """A colour for each triangle of the mesh that a model was made of.

    offsets, linked: the triangles of each cell, as compressed rows.  facets: the mesh, on the
    lattice of so many *bits*.  colours: (triangles, 3) float32, linear.
    """

    offsets: cla.Array
    linked: cla.Array
    facets: Facets
    bits: int
    colours: cla.Array

    @property
    def arguments(self) -> tuple[Argument, ...]:
        """What `shade.cl` takes."""
        return self.offsets, self.linked, self.facets.faces, self.facets.vertices, self.colours


@dataclass(frozen=True)
class Fog:
    """How what light goes through looks; colours are linear, (red, green, blue).

    thin, thick: where little of the light is held back, and where nearly all of it is.
    density: for each unit of length.  counted: opacity grows with the length, and not by Beer and
    Lambert's law.  background: colour and opacity.
    """

    thin: tuple[float, float, float]
    thick: tuple[float, float, float]
    density: float
    counted: bool
    background: tuple[float, float, float, float]


def shade(
    session: Session,
    scene: Scene,
    view: View,
    pixels: Pixels,
    hits: Hits,
    paint: Paint,
    sky: Sky | None,
    canvas: cla.Array,
    coat: Coat | None = None,
) -> None:
    """Put the colours of *hits*, those of *pixels*, into *canvas*.

    canvas: (rows, columns, 4) uint8: red, green and blue in sRGB, and opacity.
    """
    if pixels.count == 0:
        return
    arrays = scene.arrays
    stored = scene.normals is not None and scene.touched is not None
    defines = {
        "RULE": Rule.CENTRE,
        "WINDOW": WINDOW,
        "STORED": int(stored),
        "LINES": int(paint.lines),
        "LIGHTS": len(TOWARD_LIGHTS),
        "SKY": int(sky is not None),
        "SKY_MARGIN": MARGIN,
        **pixels.defines,
        **arrays.defines,
    }
    none = arrays.voxels
    defines |= {"COLOURED": 0} if coat is None else {"COLOURED": 1, "LATTICE_BITS": coat.bits}
    kernel = session.kernel(_SHADE, "shade", **defines)
    kept: tuple[Argument, ...] = none, none, none
    if scene.touched is not None:
        normals = none if scene.normals is None else scene.normals
        kept = scene.touched.edge, scene.touched.rank, normals
    coloured = (none,) * 5 if coat is None else coat.arguments
    above: tuple[Argument, ...] = int4((0, 0, 0)), float4((1, 1, 1)), np.float32(0), none
    if sky is not None:
        above = int4(sky.shape), float4(sky.side), np.float32(sky.reach), sky.values
    phong = paint.ambient, paint.diffuse, paint.specular, paint.shininess
    colours = np.array(paint.colours, np.float32)
    pixel, spread = view.pixel
    facing = view.back if view.cut is None else view.cut.facing
    lights = [toward @ (view.right, view.up, view.back) for toward in TOWARD_LIGHTS]
    session.run(
        kernel,
        pixels.count,
        *(*pixels.arguments(none), int4(arrays.shape)),
        *(*ray_arguments(view.rays), float4(scene.spacing)),
        *(*map(float4, lights), float4(view.up), float4(view.back), float4(facing)),
        *(float4(phong), np.float32(paint.emission), float4(paint.background)),
        *(np.float32(pixel), np.float32(spread), np.float32(scene.flip)),
        *(session.upload(colours), *above),
        *(hits.voxels, hits.far, *arrays.arguments(scene.edge), *kept, *coloured, canvas),
        steps=pixels.samples**2 * (8 if stored else (2 * WINDOW + 1) ** 2),
    )


def shade_volume(
    session: Session, lengths: cla.Array, pixels: Pixels, fog: Fog, canvas: cla.Array
) -> None:
    """Put the colours of *lengths* within a solid, those of *pixels*, into *canvas*, as `shade`."""
    if pixels.count == 0:
        return
    kernel = session.kernel(_VOLUME, "shade_volume", **pixels.defines)
    session.run(
        kernel,
        pixels.count,
        *(*pixels.arguments(lengths), np.float32(fog.density), np.int32(fog.counted)),
        *(float4(fog.thin), float4(fog.thick), float4(fog.background), lengths, canvas),
        steps=pixels.samples**2,
    )


def choose_pixels(session: Session, canvas: cla.Array, least: int) -> tuple[int, cla.Array]:
    """Return which pixels differ from one of the eight around them by *least* or more in a byte.

    canvas: (rows, columns, 4) uint8.

    Returns
    -------
    count : int
    numbers : uint32, of which the first *count* are theirs, in no particular order
    """
    rows, columns, _ = canvas.shape
    listed, numbers = session.zeros(1, np.uint32), session.empty(rows * columns, np.uint32)
    kernel = session.kernel(_CHOOSE, "choose")
    size = int2(columns, rows)
    items = rows * -(-columns // 4)
    session.run(kernel, items, size, np.uint32(least), canvas, listed, numbers, steps=32)
    return int(listed.get()[0]), numbers
