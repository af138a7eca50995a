"""Where the voxels are (`Grid`), and the integer frame in which geometry is decided (`Lattice`)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clvox._blocks import BLOCK, in_blocks
from clvox.errors import GridError

Axis: TypeAlias = Literal["x", "y", "z"]
Triple: TypeAlias = tuple[float, float, float]
Shape: TypeAlias = tuple[int, int, int]

MAX_SPAN = 2**24
"""Steps that the grid and all meshes of a job may span along an axis: see docs/algorithms."""

MAX_BITS = 14
MIN_BITS = 7
"""Most and fewest bits that a voxel's width may have on the lattice."""

MAX_SHAPE = MAX_SPAN >> MIN_BITS
"""Most voxels along an axis: more could not be told apart on the coarsest lattice."""

MAX_SIDE = MAX_SHAPE - 1
"""Most voxels along an axis of a grid: its mesh may round outwards by half a step at either end."""


@dataclass(frozen=True)
class Grid:
    """An axis-aligned box of voxels.

    The centre of voxel (i, j, k) is ``origin + (i + 1/2, j + 1/2, k + 1/2) * spacing``.  Points
    and triples are always in the order (x, y, z); NumPy arrays of voxels are indexed [z, y, x].

    Parameters
    ----------
    origin : (3,) float
        The lowest corner of voxel (0, 0, 0), in the length unit of the meshes.
    spacing : (3,) float or float
        Width of a voxel along x, y and z.  The three need not be equal.
    shape : (3,) int
        Number of voxels along x, y and z.

    Raises
    ------
    GridError
        A number is not finite, a spacing is not positive, or a shape is not a positive integer.
    """

    origin: Triple
    spacing: Triple
    shape: Shape

    def __init__(self, origin: ArrayLike, spacing: ArrayLike, shape: ArrayLike) -> None:
        object.__setattr__(self, "origin", _floats("origin", origin))
        object.__setattr__(self, "spacing", _floats("spacing", spacing, spread=True))
        object.__setattr__(self, "shape", _integers("shape", shape))
        if min(self.spacing) <= 0:
            raise GridError(f"spacing must be positive, got {self.spacing}")
        if min(self.shape) < 1 or max(self.shape) > MAX_SIDE:
            raise GridError(f"shape must be between 1 and {MAX_SIDE} voxels, got {self.shape}")
        if not np.isfinite(self.bounds).all():
            raise GridError(
                f"the far corner of the grid overflows: origin {self.origin}, "
                f"spacing {self.spacing}, shape {self.shape}"
            )

    @classmethod
    def fit(
        cls, mesh: Any, *, resolution: int | None = None, pitch: ArrayLike | None = None
    ) -> Grid:
        """Return the grid that holds *mesh*, centred on it.

        Parameters
        ----------
        mesh : object with ``bounds``, or (vertices, faces)
            What the grid has to hold; a `trimesh.Trimesh`, for example.
        resolution : int
            Number of voxels along the longest side.  Voxels are then cubes.
        pitch : float or (3,) float
            Width of a voxel.  Give this or *resolution*.

        Returns
        -------
        Grid
            With ceil(extent / pitch - 1e-9) voxels along each side, at least one.

        Raises
        ------
        GridError
            Neither or both of *resolution* and *pitch*; a value that is not positive; or a
            mesh without extent.
        """
        low, high = _bounds(mesh)
        extent = high - low
        if (resolution is None) == (pitch is None):
            raise GridError("give either resolution= (voxels along the longest side) or pitch=")
        if resolution is not None:
            (count,) = _integers("resolution", [resolution], size=1)
            if not 1 <= count <= MAX_SIDE:
                raise GridError(f"resolution must be between 1 and {MAX_SIDE}, got {count}")
            if extent.max() <= 0:
                raise GridError(f"the mesh has no extent: it is the one point {tuple(low)}")
            spacing = np.full(3, extent.max() / count)
            if spacing[0] <= 0:
                raise GridError(f"an extent of {extent.max()} cannot be cut into {count} voxels")
        else:
            spacing = np.array(_floats("pitch", pitch, spread=True))
            if spacing.min() <= 0:
                raise GridError(f"pitch must be positive, got {_plain(pitch)}")
        with np.errstate(over="ignore"):
            sides = np.maximum(np.ceil(extent / spacing - 1e-9), 1)
        if sides.max() > MAX_SIDE:
            raise GridError(
                f"pitch {_plain(pitch)} cuts an extent of {extent.max():g} into {sides.max():g} "
                f"voxels; at most {MAX_SIDE} can be told apart. Use a coarser pitch."
            )
        origin = (low + high) / 2 - sides * spacing / 2
        return cls(origin, spacing, sides.astype(np.int64))

    @property
    def bounds(self) -> NDArray[np.float64]:
        """Lowest and highest corner of the box; (2, 3) float64."""
        low = np.array(self.origin)
        with np.errstate(over="ignore"):
            return np.stack([low, low + np.array(self.spacing) * np.array(self.shape)])

    @property
    def size(self) -> int:
        """Number of voxels."""
        return math.prod(self.shape)

    @property
    def voxel_volume(self) -> float:
        """Volume of one voxel."""
        return math.prod(self.spacing)

    @property
    def array_shape(self) -> Shape:
        """Shape of an array of this grid's voxels: (nz, ny, nx)."""
        nx, ny, nz = self.shape
        return nz, ny, nx

    def indices(self, points: ArrayLike) -> NDArray[np.int32]:
        """Return the voxel (i, j, k) that holds each point; -1, three times, for none.

        Parameters
        ----------
        points : (n, 3) float64
            A voxel owns its lower faces.  Points outside of the grid, and points that are not
            finite, are in none.

        Returns
        -------
        (n, 3) int32
        """
        try:
            where = np.ascontiguousarray(points, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise GridError(f"points must be numbers of the shape (n, 3): {error}") from error
        if where.ndim != 2 or where.shape[1] != 3:
            raise GridError(f"points must have the shape (n, 3), got {where.shape}")
        cells = np.empty(where.shape, dtype=np.int32)
        flat, flat_cells = where.reshape(-1), cells.reshape(-1)
        origins, spacings, counts = _repeated(len(where), self.origin, self.spacing, self.shape)

        def part(start: int, stop: int) -> None:
            span, size = slice(3 * start, 3 * stop), 3 * (stop - start)
            with np.errstate(invalid="ignore", over="ignore"):
                along = flat[span] - origins[:size]
                along /= spacings[:size]
                np.floor(along, out=along)
                flat_cells[span] = along
            within = (along >= 0) & (along < counts[:size])
            if not within.all():
                held = within[0::3] & within[1::3] & within[2::3]
                cells[start:stop][~held] = -1

        in_blocks(part, len(where))
        return cells

    def centers(self, indices: ArrayLike) -> NDArray[np.float64]:
        """Return the centre of each voxel (i, j, k); (n, 3) float64."""
        cells = np.asarray(indices, dtype=np.float64)
        centers: NDArray[np.float64] = np.array(self.origin) + (cells + 0.5) * self.spacing
        return centers


@dataclass(frozen=True)
class Lattice:
    """The integer frame of a grid: lattice 0 is the centre of voxel 0, a voxel is 2**bits steps.

    All geometry is decided on the lattice, in integers, so that every device gives the same
    bits; the widths that follow from *bits* and `MAX_SPAN` are in docs/algorithms.
    """

    grid: Grid
    bits: int

    @classmethod
    def fit(cls, grid: Grid, bounds: ArrayLike, *, bits: int | None = None) -> Lattice:
        """Return the finest lattice on which *grid* and everything within *bounds* fit.

        Parameters
        ----------
        grid : Grid
        bounds : (2, 3) float64
            Lowest and highest corner of all meshes of the job.
        bits : int, optional
            Pins the lattice.  Models that are to be combined share it.

        Raises
        ------
        GridError
            Mesh and grid together span more voxels than the lattice can tell apart, or *bits*
            is out of range or leaves too little room for the span.
        """
        low, high = np.asarray(bounds, dtype=np.float64)
        origin, spacing = np.array(grid.origin), np.array(grid.spacing)
        with np.errstate(over="ignore"):
            below = np.minimum((low - origin) / spacing, 0.0)
            above = np.maximum((high - origin) / spacing, np.array(grid.shape, dtype=np.float64))
            # A vertex may be rounded outwards by half a step at either end: one step more,
            # which is never more than 2**-MIN_BITS of a voxel.
            span = float((above - below).max()) + 2.0**-MIN_BITS
        if not span <= MAX_SHAPE:
            raise GridError(
                f"the mesh and the grid together span {span:.6g} voxels; only fewer than "
                f"{MAX_SHAPE} can be told apart. Use a coarser pitch, or cut the mesh near "
                "the grid first."
            )
        most = min(MAX_BITS, math.floor(math.log2(MAX_SPAN / span)))
        if bits is None:
            bits = most
        (bits,) = _integers("lattice_bits", [bits], size=1)
        if not MIN_BITS <= bits <= MAX_BITS:
            raise GridError(f"lattice_bits must be from {MIN_BITS} to {MAX_BITS}, got {bits}")
        if bits > most:
            raise GridError(
                f"lattice_bits={bits} leaves no room for a span of {span:.6g} voxels; "
                f"at most {most} does"
            )
        return cls(grid, bits)

    @cached_property
    def step(self) -> Triple:
        """Width of one lattice step along x, y and z, in the length unit of the grid."""
        dx, dy, dz = (width / 2**self.bits for width in self.grid.spacing)
        return dx, dy, dz

    def snap(self, points: ArrayLike) -> NDArray[np.int32]:
        """Return the lattice positions nearest to *points*, (n, 3) float64.

        A point moves by at most half a step along each axis (and by the rounding of float64,
        some 2**-52 of its distance from the origin of coordinates).

        Returns
        -------
        (n, 3) int32
        """
        where = np.ascontiguousarray(points, dtype=np.float64)
        # A number more, so that the array may be sent as it lies (`clvox.ops.facets.pad`).
        flat, flat_steps = where.reshape(-1), np.zeros(where.size + 1, dtype=np.int32)
        origins, spacings = _repeated(len(where), self.grid.origin, self.grid.spacing)

        def part(start: int, stop: int) -> None:
            # In this order of operations, which is part of what docs/algorithms promises.
            span, size = slice(3 * start, 3 * stop), 3 * (stop - start)
            buffer = flat[span] - origins[:size]
            buffer /= spacings[:size]
            buffer -= 0.5
            buffer *= 2.0**self.bits
            np.rint(buffer, out=buffer)
            flat_steps[span] = buffer

        in_blocks(part, len(where))
        return flat_steps[:-1].reshape(where.shape)


def _repeated(rows: int, *triples: ArrayLike) -> list[NDArray[np.float64]]:
    """Each triple again and again, for as many rows as are worked on at a time.

    Then one loop runs over a block of rows; one over three numbers for each row costs thrice.
    """
    return [np.tile(np.asarray(each, np.float64), min(rows, BLOCK)) for each in triples]


def _plain(value: object) -> object:
    return value.tolist() if isinstance(value, np.ndarray) else value


def _floats(name: str, value: Any, *, spread: bool = False) -> Triple:
    """Three finite floats; one number stands for three if *spread*."""
    try:
        numbers = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise GridError(f"{name} must be three numbers, got {value!r}") from None
    if spread and numbers.shape == ():
        numbers = np.full(3, numbers)
    if numbers.shape != (3,) or not np.isfinite(numbers).all():
        raise GridError(f"{name} must be three finite numbers, got {_plain(value)}")
    x, y, z = numbers.tolist()
    return x, y, z


def _integers(name: str, value: Any, *, size: int = 3) -> Any:
    """As many integers; whole floats will do."""
    try:
        numbers = np.asarray(value)
        whole = numbers.astype(np.int64)
        same = bool((whole == numbers).all()) and numbers.dtype.kind in "iuf"
    except (TypeError, ValueError, OverflowError):
        same = False
    if not same or whole.shape != (size,):
        count = "three integers" if size == 3 else "an integer"
        raise GridError(f"{name} must be {count}, got {_plain(value)}")
    return tuple(whole.tolist())


def _bounds(mesh: Any) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lowest and highest corner of a mesh-like object."""
    if isinstance(mesh, tuple | list) and len(mesh) == 2:
        vertices = np.asarray(mesh[0], dtype=np.float64)
        bounds = np.stack([vertices.min(axis=0), vertices.max(axis=0)]) if len(vertices) else None
    else:
        bounds = getattr(mesh, "bounds", None)
    if bounds is None:
        raise GridError("a grid is fitted to a mesh with vertices; load a file with clvox.load")
    low, high = np.asarray(bounds, dtype=np.float64)
    if not (np.isfinite(low).all() and np.isfinite(high).all()):
        raise GridError(f"the mesh is not finite: its bounds are {low.tolist()}, {high.tolist()}")
    with np.errstate(over="ignore"):
        extent = high - low
    if not np.isfinite(extent).all():
        raise GridError(f"the extent of the mesh overflows: from {low.tolist()} to {high.tolist()}")
    return low, high
