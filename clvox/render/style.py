"""How things look: materials and colours."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

import numpy as np

from clvox.errors import GridError
from clvox.ops.shading import Fog, Paint

Style: TypeAlias = Literal["surface", "voxels", "volume"]
"""What `render` draws: see there."""

Colour: TypeAlias = tuple[int, int, int]
"""Red, green and blue in sRGB, each from 0 to 255."""

Linear: TypeAlias = tuple[float, float, float]

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
            if not isinstance(value, int | float | np.number) or not 0 <= value < float("inf"):
                raise GridError(f"{name} must be a number, 0 or more, got {value!r}")


def paint_of(material: Material, style: Style, background: Colour | None) -> Paint:
    """Return how things are to look, as kernels take it."""
    own, cut = linear("color", material.color), linear("cut_color", material.cut_color)
    colours: tuple[Linear, ...] = (own, own, own, cut)
    if style == "voxels":
        by_kind = (linear("color", colour) for colour in (INSIDE, TOUCHED, CELL))
        colours = (*by_kind, cut)
    return Paint(
        colours,
        material.ambient,
        material.diffuse,
        material.specular,
        material.shininess,
        material.emission,
        backdrop(background),
        lines=style == "voxels",
    )


def fog_of(material: Material, density: float, background: Colour | None, *, counted: bool) -> Fog:
    """Return how what light goes through is to look, as kernels take it."""
    thin, thick = linear("thin_color", material.thin_color), linear("", material.thick_color)
    return Fog(thin, thick, density, counted, backdrop(background))


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
    try:
        numbers = np.asarray(colour)
    except ValueError:
        numbers = np.empty(0)
    if numbers.shape != (3,) or numbers.dtype.kind not in "iu":
        raise GridError(f"{name} must be three integers, got {colour!r}")
    if numbers.min() < 0 or numbers.max() > 255:
        raise GridError(f"{name} must be from 0 to 255, got {colour!r}")
    part = numbers / 255
    red, green, blue = np.where(part <= 0.04045, part / 12.92, ((part + 0.055) / 1.055) ** 2.4)
    return float(red), float(green), float(blue)
