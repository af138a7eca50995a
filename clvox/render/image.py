"""The picture of a model, as an array."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clvox.camera import Camera
from clvox.errors import GridError
from clvox.models import VoxelModel
from clvox.ops.drawing import Picture, draw
from clvox.ops.raymarch import Scene
from clvox.ops.shading import Coat, Fog, Paint
from clvox.render.colours import coat_of
from clvox.render.style import Colour, Material, Style, check_style, fog_of, paint_of

MAX_SIDE = 16384
"""Most pixels along a side of a picture."""

MAX_SAMPLES = 8

DARKNESS = 2.5
"""Optical depth of a cube as large as the box around the model, by default."""


def render(
    model: VoxelModel,
    *,
    camera: Camera | None = None,
    size: tuple[int, int] = (1920, 1080),
    style: Style = "surface",
    background: Colour | None = None,
    material: Material | None = None,
    colours: ArrayLike | str | None = None,
    samples: int = 2,
    adaptive: bool = True,
    occlusion: bool = True,
    density: float | None = None,
    absorption: str = "beer",
) -> NDArray[np.uint8]:
    """Return a picture of a model.

    Rays run through the levels of the model itself.  Which voxel a ray meets first is exact, and
    the same on every device; colours may differ by rounding.

    Parameters
    ----------
    model : VoxelModel
        With ``attributes=("normals",)`` the surface has the normals of its mesh; otherwise they
        are derived from the voxels.
    camera : Camera, optional
        Where the picture is taken from, and what is cut away; by default ``Camera.around(model)``.
    size : (int, int)
        Columns and rows of pixels, each from 1 to 16384.
    style : "surface", "voxels" or "volume"
        "surface": the first voxel along each ray that is inside, or that the mesh touches if the
        model has its normals, or *colours* are asked for, lit by Phong's law.  "voxels": their
        cubes; colours tell voxels that the mesh touches, others that are inside, and cells that are
        wholly inside.  "volume": light is held back by how far a ray runs inside.
    background : (int, int, int), optional
        Red, green and blue from 0 to 255, in sRGB; by default the background is transparent.
    material : Material, optional
    colours : (triangles, 3) int or "bodies", optional
        In the style "surface", of a model with ``attributes=("links",)``: red, green and blue of
        each triangle of the mesh as it was given to `voxelize`, from 0 to 255, in sRGB; or a colour
        for each body, that is for triangles which common vertices connect.  A place has the colour
        of the nearest triangle that touches its cell.
    samples : int
        From 1 to 8: a pixel has *samples* x *samples* rays.  More make edges smoother.
    adaptive : bool
        Whether pixels that hardly differ from those around them make do with one of their rays.
    occlusion : bool
        Whether hollows, which see little of the sky, are darker.
    density : float, optional
        In the style "volume": for each unit of length; by default so that light goes through.
    absorption : "beer" or "count"
        In the style "volume": opacity by Beer and Lambert's law, or in proportion to the length
        inside, as if samples were counted (Young 2017).

    Returns
    -------
    (h, w, 4) uint8
        Red, green and blue in sRGB, and opacity, not multiplied into them.

    Raises
    ------
    GridError
        The size, the style, a colour or a number makes no sense, or what is given is no model, no
        camera or no material.
    MeshError
        There are *colours*, and the model has no links to triangles.

    Examples
    --------
    >>> import clvox, trimesh
    >>> ball = clvox.voxelize(trimesh.creation.icosphere(radius=10.0), resolution=64)
    >>> clvox.render(ball, size=(64, 48)).shape
    (48, 64, 4)
    """
    check_kinds(model, camera, material)
    columns, rows = pixels_of(size)
    style = check_style(style)
    whole = isinstance(samples, int | np.integer) and not isinstance(samples, bool)
    if not whole or not 1 <= samples <= MAX_SAMPLES:
        raise GridError(f"samples must be an integer from 1 to {MAX_SAMPLES}, got {samples!r}")
    if absorption not in ("beer", "count"):
        raise GridError(f"absorption must be 'beer' or 'count', got {absorption!r}")
    camera = camera or Camera.around(model, aspect=columns / rows)
    if colours is not None and style != "surface":
        raise GridError(f"colours are for the style 'surface', not for {style!r}")
    coat = None if colours is None else coat_of(model, colours)
    dense = _density(model, density)
    many = int(samples)
    view = camera.view(model.grid, (columns * many**2, rows * many**2))
    look: Paint | Fog
    if style == "volume":
        look = fog_of(material or Material(), dense, background, counted=absorption == "count")
    else:
        look = paint_of(material or Material(), style, background)
    # What a model holds is for the modules below; a picture reads it as the model itself does.
    drawing, scene = model._drawing, _scene(model, style, coat)  # noqa: SLF001
    picture = Picture(drawing, scene, view, (columns, rows), many, coat)
    image: NDArray[np.uint8] = draw(picture, look, occlusion=occlusion, adaptive=adaptive).get()
    return image


def _scene(model: VoxelModel, style: Style, coat: Coat | None) -> Scene:
    arrays, spacing = model._arrays, model.grid.spacing  # noqa: SLF001
    kept = model._attributes  # noqa: SLF001
    if kept is None or style == "volume":
        return Scene(arrays, spacing)
    if style == "surface" and kept.normals is None and coat is None:
        return Scene(arrays, spacing)
    return Scene(arrays, spacing, kept.touched, kept.normals, -1 if kept.inwards else 1)


def _density(model: VoxelModel, density: float | None) -> float:
    if density is None:
        low, high = model.bounds
        return DARKNESS / float(np.prod(high - low) ** (1 / 3))
    if not isinstance(density, int | float | np.number) or not 0 <= density < float("inf"):
        raise GridError(f"density must be a number, 0 or more, got {density!r}")
    return float(density)


def check_kinds(model: object, camera: object, material: object) -> None:
    """Raise a `GridError` if something is not what its name says."""
    if not isinstance(model, VoxelModel):
        raise GridError(
            f"what is drawn must be a VoxelModel, got a {type(model).__name__}; clvox.voxelize "
            "makes one of a mesh, and DexelModel.to_voxels of dexels"
        )
    if not isinstance(camera, Camera | None):
        raise GridError(f"camera must be a clvox.Camera, got a {type(camera).__name__}")
    if not isinstance(material, Material | None):
        raise GridError(f"material must be a clvox.Material, got a {type(material).__name__}")


def pixels_of(size: tuple[int, int]) -> tuple[int, int]:
    """Return columns and rows, if a picture can have so many."""
    try:
        numbers = np.asarray(size)
    except ValueError:
        numbers = np.empty(0)
    if numbers.shape != (2,) or numbers.dtype.kind not in "iu":
        raise GridError(f"size must be two integers, columns and rows, got {size!r}")
    if numbers.min() < 1 or numbers.max() > MAX_SIDE:
        raise GridError(f"size must be from 1 to {MAX_SIDE} pixels a side, got {size!r}")
    columns, rows = numbers.tolist()
    return columns, rows
