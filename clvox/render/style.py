"""How things look: materials, colours, and where they are shaded from the sky."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from clvox.errors import GridError
from clvox.grid import Grid
from clvox.ops.raymarch import Paint

Style: TypeAlias = Literal["surface", "voxels", "volume"]
"""What `render` draws: see there."""

Colour: TypeAlias = tuple[int, int, int]
"""Red, green and blue in sRGB, each from 0 to 255."""

Linear: TypeAlias = tuple[float, float, float]

SKY_POINTS = 96
"""Places looked at around a place, to see how much of the sky is hidden there."""

SKY_REACH = 0.05
"""How far they are away at most, as a part of the grid's longest side."""

INSIDE, TOUCHED, CELL = (92, 158, 173), (233, 140, 62), (57, 92, 138)
"""Colours of voxels inside, voxels that the mesh touches, and cells that are wholly inside."""


@dataclass(frozen=True)
class Material:
    """How a surface reflects light, by Phong's law (Young 2017, equations 4.6 to 4.9).

    Attributes
    ----------
    color, cut_color : (int, int, int)
        Red, green and blue in sRGB, from 0 to 255: of the surface, and of what a cut opens.
    ambient, diffuse, specular : float
        How much of the sky's light, of a lamp's light, and of its mirrored light comes back.
    shininess : float
        How narrow highlights are.
    emission : float
        How much of its colour the surface gives off by itself.
    thin_color, thick_color : (int, int, int)
        In the style "volume": the colours where little, and nearly all, of the light is held back.
    """

    color: Colour = (139, 174, 205)
    cut_color: Colour = (226, 132, 74)
    ambient: float = 0.28
    diffuse: float = 0.85
    specular: float = 0.22
    shininess: float = 28.0
    emission: float = 0.0
    thin_color: Colour = (120, 172, 212)
    thick_color: Colour = (18, 42, 84)

    def __post_init__(self) -> None:
        for name in ("color", "cut_color", "thin_color", "thick_color"):
            linear(name, getattr(self, name))
        for name in ("ambient", "diffuse", "specular", "shininess", "emission"):
            value = getattr(self, name)
            if not isinstance(value, int | float) or not 0 <= value < float("inf"):
                raise GridError(f"{name} must be a number, 0 or more, got {value!r}")


def paint_of(
    material: Material, style: Style, background: Colour | None, grid: Grid, *, occlusion: bool
) -> Paint:
    """Return how things are to look, as kernels take it."""
    own, cut = linear("color", material.color), linear("cut_color", material.cut_color)
    colours: tuple[Linear, ...] = (own, own, own, cut)
    if style == "voxels":
        by_kind = (linear("color", colour) for colour in (INSIDE, TOUCHED, CELL))
        colours = (*by_kind, cut)
    offsets = sky_offsets(grid) if occlusion else np.zeros((0, 3), np.float32)
    return Paint(
        colours,
        material.ambient,
        material.diffuse,
        material.specular,
        material.shininess,
        material.emission,
        backdrop(background),
        offsets,
        lines=style == "voxels",
    )


def sky_offsets(grid: Grid) -> NDArray[np.float32]:
    """Return places in a ball, in voxels, spread evenly over directions and distances."""
    number = np.arange(SKY_POINTS) + 0.5
    z = 1 - 2 * number / SKY_POINTS
    turn = number * np.pi * (3 - np.sqrt(5.0))
    ring = np.sqrt(1 - z * z)
    directions = np.stack([ring * np.cos(turn), ring * np.sin(turn), z], axis=1)
    # The golden ratio once more, so that distance and direction do not go together.
    distance = (number * (np.sqrt(5.0) - 1) / 2) % 1
    widths = np.array(grid.spacing)
    reach = max(SKY_REACH * float((widths * grid.shape).max()), 3 * float(widths.max()))
    offsets: NDArray[np.float32] = (directions * reach * distance[:, None] / widths).astype("f4")
    return offsets


def check_style(style: str) -> Style:
    """Return *style*, if there is such a one."""
    for known in get_args(Style):
        if style == known:
            found: Style = known
            return found
    raise GridError(f"style must be one of {', '.join(map(repr, get_args(Style)))}, got {style!r}")


def backdrop(colour: Colour | None) -> tuple[float, float, float, float]:
    """Return the background, linear, and its opacity; without one it is transparent."""
    return (0.0, 0.0, 0.0, 0.0) if colour is None else (*linear("background", colour), 1.0)


def linear(name: str, colour: Colour) -> Linear:
    """Return a colour as amounts of light, from 0 to 1."""
    numbers = np.asarray(colour)
    if numbers.shape != (3,) or numbers.dtype.kind not in "iu":
        raise GridError(f"{name} must be three integers, got {colour!r}")
    if numbers.min() < 0 or numbers.max() > 255:
        raise GridError(f"{name} must be from 0 to 255, got {colour!r}")
    part = numbers / 255
    red, green, blue = np.where(part <= 0.04045, part / 12.92, ((part + 0.055) / 1.055) ** 2.4)
    return float(red), float(green), float(blue)
