"""A model as plain arrays: for pickling, and for `.npz` files."""

from __future__ import annotations

import os
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clvox.device import Session
from clvox.errors import FormatError, GridError
from clvox.grid import Grid, Shape
from clvox.ops.layout import Cells, VoxelArrays, cell_shape, words_for
from clvox.ops.multilevel import RANK_WORDS

VERSION = 1
"""Version of the arrays' layout: docs/layouts."""

_GRID = {"version", "origin", "spacing", "shape", "levels"}
_DENSE = {"voxels"}
_TWO = {"boundary", "inside", "rank", "bricks"}


def pack(grid: Grid, arrays: VoxelArrays) -> dict[str, NDArray[Any]]:
    """Return the grid and the arrays of a model on the host."""
    record: dict[str, NDArray[Any]] = {
        "version": np.array(VERSION),
        "origin": np.array(grid.origin),
        "spacing": np.array(grid.spacing),
        "shape": np.array(grid.shape),
        "levels": np.array(arrays.levels),
    }
    if arrays.cells is None or arrays.inside is None:
        return record | {"voxels": arrays.voxels.get()}
    return record | {
        "boundary": arrays.cells.boundary.get(),
        "inside": arrays.inside.get(),
        "rank": arrays.cells.rank.get(),
        "bricks": arrays.voxels.get(),
    }


def unpack(session: Session, record: dict[str, NDArray[Any]]) -> tuple[Grid, VoxelArrays]:
    """Return the model of *record*, its arrays on the device.

    Raises
    ------
    FormatError
        An array is missing, or has not the shape, the type or the content that it must have.
    """
    dense = set(record) == _GRID | _DENSE
    if not dense and set(record) != _GRID | _TWO:
        raise FormatError(f"not a clvox model: its arrays are {', '.join(sorted(record))}")
    if record["version"].shape != () or record["version"] != VERSION:
        raise FormatError(
            f"the model has layout version {record['version']}; this clvox reads {VERSION}"
        )
    try:
        grid = Grid(record["origin"], record["spacing"], record["shape"])
    except GridError as error:
        raise FormatError(f"the model's grid makes no sense: {error}") from error
    nx, ny, nz = grid.shape
    if dense:
        _expect(record, "voxels", (nz, ny, words_for(nx)))
        return grid, VoxelArrays(grid.shape, session.upload(record["voxels"]))
    levels = record["levels"]
    if levels.shape != (2, 3) or levels.dtype.kind not in "iu" or levels.min() < 1:
        raise FormatError(f"the model's levels are {levels.tolist()}; two triples are expected")
    cell_counts, brick = _triple(levels[0]), _triple(levels[1])
    if cell_counts != cell_shape(grid.shape, brick):
        raise FormatError(f"levels {levels.tolist()} do not hold a grid of {grid.shape} voxels")
    rows = cell_counts[2], cell_counts[1], words_for(cell_counts[0])
    boundary = _expect(record, "boundary", rows)
    _expect(record, "inside", rows)
    counts = np.bitwise_count(boundary.ravel()).astype(np.uint64)
    starts = np.arange(0, counts.size, RANK_WORDS)
    blocks = np.add.reduceat(counts, starts)
    rank = np.cumsum(blocks) - blocks
    count = int(blocks.sum())
    if not np.array_equal(_expect(record, "rank", rank.shape), rank):
        raise FormatError("the model's rank does not count its boundary cells")
    _expect(record, "bricks", (count, words_for(int(np.prod(levels[1])))))
    cells = Cells(
        cell_counts,
        brick,
        session.upload(boundary),
        session.upload(record["rank"]),
        count,
    )
    inside = session.upload(record["inside"])
    return grid, VoxelArrays(grid.shape, session.upload(record["bricks"]), cells, inside)


def write(path: str | os.PathLike[str], record: dict[str, NDArray[Any]]) -> None:
    """Write *record* to an ``.npz`` file; whole, or not at all."""
    target = Path(path)
    if target.suffix != ".npz":
        raise FormatError(f"a model is saved as .npz, got {target}")
    partial = target.with_name(f"{target.name}.partial")
    try:
        with partial.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, **record)
        partial.replace(target)
    finally:
        partial.unlink(missing_ok=True)


def read(path: str | os.PathLike[str]) -> dict[str, NDArray[Any]]:
    """Return the arrays of an ``.npz`` file.

    Raises
    ------
    FormatError
        It is not such a file, or is damaged.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            if not isinstance(file, np.lib.npyio.NpzFile):
                raise FormatError(f"{os.fspath(path)} is one array, not a model")
            return dict(file)
    except (ValueError, zipfile.BadZipFile, EOFError) as error:
        raise FormatError(f"{os.fspath(path)} is not a clvox model: {error}") from error


def _expect(
    record: dict[str, NDArray[Any]], name: str, shape: tuple[int, ...]
) -> NDArray[np.uint32]:
    array = record[name]
    if array.shape != shape or array.dtype != np.uint32:
        raise FormatError(
            f"the model's array {name} must be uint32 of the shape {shape}, got {array.dtype} of "
            f"{array.shape}"
        )
    return array


def _triple(values: NDArray[Any]) -> Shape:
    x, y, z = values.tolist()
    return x, y, z
