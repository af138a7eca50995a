"""Where a picture is taken from: cameras, in the mesh's frame."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clvox.errors import GridError
from clvox.picture_rays import Integers, View, cutting_plane, integer_rays, integers

if TYPE_CHECKING:
    from clvox.grid import Grid

MARGIN = 0.06
"""Part of the picture that stays empty on each side."""

DIRECTION = -0.62, 1.0, -0.72
"""Where the eye looks by default: from the front, the right, and above."""

FOV = 28.0
"""Degrees from the lower to the upper side of the picture, by default."""


@dataclass(frozen=True)
class Camera:
    """Where a picture is taken from, and what of the model it shows.

    Attributes
    ----------
    eye, target, up : (3,) float
        Where the eye is, what is in the middle of the picture, and what is up in it.
    fov : float, optional
        Degrees between the lower and the upper side of the picture, above 0 and below 170.
    height : float, optional
        Length that the picture's height shows, seen from far away: rays are parallel.  Give this
        or *fov*; by default fov is 28.
    near : float
        Nothing nearer to the eye's plane than this is seen.
    box : ((x, y, z), (x, y, z)), optional
        Lowest and highest corner of what is seen, to the nearest voxel: look inside a model.
    cut : ((x, y, z), (x, y, z)), optional
        A point of a plane and its normal, at any angle: what lies on the side to which the normal
        points is left out, and what the plane opens is drawn as a flat face.

    Raises
    ------
    GridError
        Numbers that are not finite, an eye in its target, *up* along the view, or *fov* and
        *height* both.

    Examples
    --------
    >>> import clvox
    >>> camera = clvox.Camera((0, -30, 10), (0, 0, 0), (0, 0, 1), fov=35)
    """

    eye: tuple[float, float, float]
    target: tuple[float, float, float]
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    fov: float | None = None
    height: float | None = None
    near: float = 0.0
    box: tuple[tuple[float, float, float], tuple[float, float, float]] | None = None
    cut: tuple[tuple[float, float, float], tuple[float, float, float]] | None = None

    def __post_init__(self) -> None:
        for name in ("eye", "target", "up"):
            object.__setattr__(self, name, _triple(name, getattr(self, name)))
        if self.fov is not None and self.height is not None:
            raise GridError(
                "give fov= (degrees) or height= (a length, for parallel rays), not both"
            )
        if self.height is None:
            fov = FOV if self.fov is None else self.fov
            object.__setattr__(self, "fov", _number("fov", fov, 0.0, 170.0))
        else:
            object.__setattr__(self, "height", _number("height", self.height, 0.0))
        if not 0 <= self.near < math.inf:
            raise GridError(f"near must be a length, 0 or more, got {self.near!r}")
        if self.box is not None:
            low, high = _corners(self.box)
            object.__setattr__(self, "box", (low, high))
        if self.cut is not None:
            object.__setattr__(self, "cut", _point_and_normal(self.cut))
        self.frame()

    @classmethod
    def around(
        cls,
        model: Any,
        *,
        direction: ArrayLike = DIRECTION,
        up: ArrayLike = (0.0, 0.0, 1.0),
        fov: float | None = None,
        parallel: bool = False,
        aspect: float = 16 / 9,
    ) -> Camera:
        """Return the camera that shows all of a model, as large as it can be.

        Parameters
        ----------
        model : object with ``outline`` or ``bounds``
            A `VoxelModel`, or a mesh, or a grid.
        direction, up : (3,) float
            Where the eye looks, and what is up.
        fov : float, optional
            Degrees between the lower and the upper side of the picture; 28 by default.
        parallel : bool
            Whether rays are to be parallel.
        aspect : float
            Width of the picture by its height.
        """
        low, high = np.asarray(model.bounds, dtype=np.float64)
        # A trimesh.Trimesh has an `outline`, too: a method that draws.
        outline = getattr(model, "outline", None)
        points = outline if isinstance(outline, np.ndarray) else _box_corners(low, high)
        middle, ahead = (low + high) / 2, _unit("direction", direction)
        size = float(np.linalg.norm(high - low)) or 1.0
        looking = cls(_tuple(middle - ahead * size), _tuple(middle), _triple("up", up), height=size)
        right, above, back = looking.frame()
        part = 1 - 2 * MARGIN
        across, upright, depth = np.stack([right, above, back]) @ (points - middle).T
        if parallel:
            offset = sum(
                (values.max() + values.min()) / 2 * axis
                for values, axis in ((across, right), (upright, above))
            )
            height = float(max(np.ptp(upright), np.ptp(across) / aspect)) / part
            eye, target = np.array(looking.eye) + offset, middle + offset
            return replace(looking, eye=_tuple(eye), target=_tuple(target), height=height or 1.0)
        degrees = _number("fov", FOV if fov is None else fov, 0.0, 170.0)
        slope = math.tan(math.radians(degrees) / 2) * part
        # Sideways, so that the picture's middle is that of what is seen: nearer parts look larger.
        shift = np.zeros(2)
        for _ in range(8):
            aside = np.stack([across - shift[0], upright - shift[1]])
            wanted = np.maximum(np.abs(aside[0]) / aspect, np.abs(aside[1])) / slope
            distance = max(float((depth + wanted).max()), float(depth.max()) + 1e-6 * size)
            seen = aside / (distance - depth)
            shift += (seen.max(axis=1) + seen.min(axis=1)) / 2 * distance
        target = middle + shift[0] * right + shift[1] * above
        eye = _tuple(target + back * distance)
        return replace(looking, eye=eye, target=_tuple(target), fov=degrees, height=None)

    def turned(self, degrees: float) -> Camera:
        """Return the camera after a walk around its target, about the direction *up*."""
        turn, axis = math.radians(degrees), _unit("up", self.up)
        away = np.array(self.eye) - np.array(self.target)
        along = axis * (axis @ away)
        moved = along + (away - along) * math.cos(turn) + np.cross(axis, away) * math.sin(turn)
        return replace(self, eye=_tuple(np.array(self.target) + moved))

    def view(self, grid: Grid, size: tuple[int, int]) -> View:
        """Return the rays of a picture of *size* samples, columns and rows, in *grid*.

        Raises
        ------
        GridError
            The eye is too far away, or spacings differ too much, to draw.
        """
        right, above, back = self.frame()
        low, high = self._voxels(grid)
        widths, shape = np.array(grid.spacing), np.array(grid.shape)
        columns, rows = size
        origin, eye = np.array(grid.origin), np.array(self.eye)
        corners = _box_corners(origin, origin + shape * widths)
        # Rays begin just before the grid, if the eye is far off.
        depths = -(corners - eye) @ back
        margin = 1e-3 * float(np.linalg.norm(shape * widths))
        begin = max(self.near, float(depths.min()) - margin)
        if self.height is None:
            slope = 2 * math.tan(math.radians(self.fov or FOV) / 2) / rows
            step, spread = slope * begin, slope
        else:
            step, spread = self.height / rows, 0.0
        middle = eye - begin * back
        across, along = right / widths, -above / widths
        first = (middle - origin) / widths - step * (
            (columns - 1) / 2 * across + (rows - 1) / 2 * along
        )
        ahead = -back / widths - spread * ((columns - 1) / 2 * across + (rows - 1) / 2 * along)
        turns = spread * across, spread * along
        rays = integer_rays(
            grid, size, (first, step * across, step * along), (ahead, *turns), from_eye=spread > 0
        )
        cut = None
        if self.cut is not None:
            point, normal = (np.array(part) for part in self.cut)
            cut = cutting_plane(grid, rays, point, normal)
        return View(rays, right, above, back, low, high, (step, spread), begin, cut)

    def frame(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return unit vectors to the right, upwards, and back to the eye; (3,) float64 each."""
        away = np.array(self.eye) - np.array(self.target)
        if not away.any():
            raise GridError(f"eye and target must differ, both are {self.eye}")
        back = _unit("eye - target", away)
        right = np.cross(_unit("up", self.up), back)
        if np.linalg.norm(right) < 1e-6:
            raise GridError(f"up must not be parallel to the view, got {self.up}")
        right /= np.linalg.norm(right)
        return right, np.cross(back, right), back

    def _voxels(self, grid: Grid) -> tuple[Integers, Integers]:
        if self.box is None:
            return (0, 0, 0), grid.shape
        places = (np.array(self.box) - grid.origin) / grid.spacing
        low, high = np.rint(np.clip(places, 0, grid.shape))
        return integers(low), integers(np.maximum(low, high))


def _box_corners(low: NDArray[np.float64], high: NDArray[np.float64]) -> NDArray[np.float64]:
    parts = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    corners: NDArray[np.float64] = low + parts * (high - low)
    return corners


def _tuple(values: NDArray[np.float64]) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z


def _triple(name: str, value: ArrayLike) -> tuple[float, float, float]:
    try:
        vector = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        vector = np.empty(0)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise GridError(f"{name} must be three finite numbers, got {_plain(value)!r}")
    return _tuple(vector)


def _number(name: str, value: float, low: float, high: float = math.inf) -> float:
    number = float(value) if isinstance(value, int | float | np.number) else math.nan
    if not low < number < high:
        most = f" and below {high:g}" if high < math.inf else ""
        raise GridError(f"{name} must be a number above {low:g}{most}, got {value!r}")
    return number


def _corners(
    box: ArrayLike,
) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    try:
        corners = np.asarray(box, dtype=np.float64)
    except (TypeError, ValueError):
        corners = np.empty(0)
    if corners.shape != (2, 3) or np.isnan(corners).any() or (corners[0] > corners[1]).any():
        raise GridError(
            f"box must be a lowest and a highest corner, each of three numbers, got {_plain(box)!r}"
        )
    return _tuple(corners[0]), _tuple(corners[1])


def _point_and_normal(
    cut: ArrayLike,
) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    try:
        parts = np.asarray(cut, dtype=np.float64)
    except (TypeError, ValueError):
        parts = np.empty(0)
    if parts.shape != (2, 3) or not np.isfinite(parts).all() or not parts[1].any():
        raise GridError(
            "cut must be a point and a normal, each of three numbers, the normal's not all 0, got "
            f"{_plain(cut)!r}"
        )
    return _tuple(parts[0]), _tuple(_unit("cut", parts[1]))


def _unit(name: str, value: ArrayLike) -> NDArray[np.float64]:
    try:
        vector = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        vector = np.empty(0)
    if vector.shape != (3,) or not np.isfinite(vector).all() or not vector.any():
        raise GridError(f"{name} must be three finite numbers, not all 0, got {_plain(value)!r}")
    vector = vector / np.abs(vector).max()
    unit: NDArray[np.float64] = vector / np.linalg.norm(vector)
    return unit


def _plain(value: object) -> object:
    return value.tolist() if isinstance(value, np.ndarray) else value
