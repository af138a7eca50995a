"""A dexel model as plain arrays: for pickling, and for `.npz` files."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from clvox.device import Session
from clvox.errors import FormatError, GridError
from clvox.grid import MAX_BITS, MIN_BITS, Grid
from clvox.models.dexel_sources import Source, Sources
from clvox.ops.crossings import fraction_bits
from clvox.ops.dexels import CAP, Frame, Rule
from clvox.ops.lists import CrossingLists

VERSION = 1
"""Version of the arrays' layout: docs/layouts."""

RULES = ("", *(rule.name.lower() for rule in Rule))
"""What is inside, by the number in a file; 0 if the rows hold pieces."""

_GRID = {"version", "origin", "spacing", "shape"}
_RAYS = {"axis", "lattice_bits", "fraction_bits", "rule", "offsets", "depth", "side", "meshes"}


class Rays(NamedTuple):
    """Crossings along one axis, as they are kept.

    fill: the rule, or "" if they are pieces; meshes: triangles of each mesh they come from.
    """

    axis: int
    lattice_bits: int
    fill: str
    crossings: CrossingLists
    meshes: Sequence[int]


def sources_of(rays: Rays) -> Sources:
    """Return the meshes of which no more is known."""
    return Sources(tuple(Source(count) for count in rays.meshes))


def holds_dexels(record: dict[str, NDArray[Any]]) -> bool:
    """Whether a record is meant to be a dexel model, of one axis or of three."""
    return "offsets" in record or "x_offsets" in record


def pack(grid: Grid, *bundles: Rays) -> dict[str, NDArray[Any]]:
    """Return the grid and the arrays of a model on the host; with three bundles, of a triple."""
    record: dict[str, NDArray[Any]] = {
        "version": np.array(VERSION),
        "origin": np.array(grid.origin),
        "spacing": np.array(grid.spacing),
        "shape": np.array(grid.shape),
    }
    for rays in bundles:
        prefix = _prefix(rays.axis) if len(bundles) > 1 else ""
        lists = rays.crossings
        arrays: dict[str, NDArray[Any]] = {
            "axis": np.array(rays.axis),
            "lattice_bits": np.array(rays.lattice_bits),
            "fraction_bits": np.array(lists.fraction_bits),
            "rule": np.array(RULES.index(rays.fill)),
            "offsets": lists.offsets.get(),
            "depth": lists.depth.get(),
            "side": lists.side.get().view(np.uint32),
            "meshes": np.array(rays.meshes, np.int64),
        }
        record |= {prefix + name: array for name, array in arrays.items()}
    return record


def unpack(session: Session, record: dict[str, NDArray[Any]]) -> tuple[Grid, Rays]:
    """Return the model of *record*, its arrays on the device.

    Raises
    ------
    FormatError
        An array is missing, or has not the shape, the type or the content that it must have.
    """
    if set(record) != _GRID | _RAYS:
        raise FormatError(f"not a clvox dexel model: its arrays are {', '.join(sorted(record))}")
    grid = _grid(record)
    return grid, _rays(session, grid, record, "")


def unpack_triple(
    session: Session, record: dict[str, NDArray[Any]]
) -> tuple[Grid, tuple[Rays, Rays, Rays]]:
    """Return the three bundles of *record*; raises as `unpack` does."""
    names = {_prefix(axis) + name for axis in range(3) for name in _RAYS}
    if set(record) != _GRID | names:
        raise FormatError(f"not a clvox dexel model: its arrays are {', '.join(sorted(record))}")
    grid = _grid(record)
    x, y, z = (_rays(session, grid, record, _prefix(axis)) for axis in range(3))
    if (x.axis, y.axis, z.axis) != (0, 1, 2):
        raise FormatError("the model's bundles must be along x, y and z")
    if not x.lattice_bits == y.lattice_bits == z.lattice_bits:
        raise FormatError("the model's bundles must have one lattice")
    return grid, (x, y, z)


def _prefix(axis: int) -> str:
    return f"{'xyz'[axis]}_"


def _grid(record: dict[str, NDArray[Any]]) -> Grid:
    if record["version"].shape != () or record["version"] != VERSION:
        raise FormatError(
            f"the model has layout version {record['version']}; this clvox reads {VERSION}"
        )
    try:
        return Grid(record["origin"], record["spacing"], record["shape"])
    except GridError as error:
        raise FormatError(f"the model's grid makes no sense: {error}") from error


def _rays(session: Session, grid: Grid, record: dict[str, NDArray[Any]], prefix: str) -> Rays:
    own = {name: record[prefix + name] for name in _RAYS}
    axis = _number(own, "axis", 0, 2)
    rule = _number(own, "rule", 0, len(RULES) - 1)
    lattice_bits = _number(own, "lattice_bits", MIN_BITS, MAX_BITS)
    places = fraction_bits(lattice_bits)
    frame = Frame(grid.shape, axis, _number(own, "fraction_bits", places, places))
    if frame.shape[axis] << frame.fraction_bits > 1 << 31:
        raise FormatError("the model's depths do not fit 32 bits on this grid")
    offsets, depth, side, meshes = (own[name] for name in ("offsets", "depth", "side", "meshes"))
    count = len(depth) if depth.ndim == 1 else -1
    _expect("offsets", offsets, (frame.rays + 1,), np.uint64)
    _expect("depth", depth, (count,), np.int32)
    _expect("side", side, (count,), np.uint32)
    _expect("meshes", meshes, (meshes.size,), np.int64)
    if offsets[0] != 0 or offsets[-1] != count or (offsets[1:] < offsets[:-1]).any():
        raise FormatError("the model's offsets must rise from 0 to the number of its crossings")
    triangles = side >> np.uint32(1)
    if (meshes < 0).any() or meshes.sum(dtype=object) >= CAP:
        raise FormatError("the model's meshes must have a number of triangles each")
    known = triangles < meshes.sum()
    if not (known | (triangles == CAP)).all() or (rule and not known.all()):
        raise FormatError("the model's crossings name triangles that its meshes do not have")
    _check_rows(frame, offsets.astype(np.int64), depth, side & np.uint32(1), pieces=rule == 0)
    held = [session.upload(array) for array in (offsets, depth, side.view(np.int32))]
    lists = CrossingLists(held[0], held[1], held[2], frame.fraction_bits)
    return Rays(axis, lattice_bits, RULES[rule], lists, meshes.tolist())


def _check_rows(
    frame: Frame,
    offsets: NDArray[np.int64],
    depth: NDArray[np.int32],
    inwards: NDArray[np.uint32],
    *,
    pieces: bool,
) -> None:
    """Rows must be in order; those of pieces alternate, within the box."""
    new = np.zeros(len(depth) + 1, np.bool_)
    new[offsets] = True
    follows = ~new[1:-1]
    least = 1 if pieces else 0
    if ((depth[1:].astype(np.int64) - depth[:-1])[follows] < least).any():
        raise FormatError("the model's depths must rise along each ray")
    if not pieces or not len(depth):
        return
    if (offsets % 2).any() or (inwards != 1 - np.arange(len(depth)) % 2).any():
        raise FormatError("the model's ends must go in and out by turns")
    low, high = frame.box
    if depth.min() < low or depth.max() > high:
        raise FormatError("the model's pieces must lie in its grid")


def _number(record: dict[str, NDArray[Any]], name: str, low: int, high: int) -> int:
    value = record[name]
    if value.shape != () or value.dtype.kind not in "iu" or not low <= value <= high:
        raise FormatError(f"the model's {name} must be from {low} to {high}, got {value}")
    return int(value)


def _expect(name: str, array: NDArray[Any], shape: tuple[int, ...], dtype: type) -> None:
    if array.shape != shape or array.dtype != dtype:
        raise FormatError(
            f"the model's array {name} must be {np.dtype(dtype)} of the shape {shape}, got "
            f"{array.dtype} of {array.shape}"
        )
