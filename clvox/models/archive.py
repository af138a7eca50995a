"""A model as plain arrays: for pickling, and for `.npz` files."""

from __future__ import annotations

import os
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clvox.device import Session
from clvox.errors import FormatError, GridError
from clvox.grid import MAX_SHAPE, Grid, Shape
from clvox.ops.layout import Cells, VoxelArrays, cell_shape, words_for
from clvox.ops.multilevel import RANK_WORDS

VERSION = 1
"""Version of the arrays' layout: docs/layouts."""

_GRID = {"version", "origin", "spacing", "shape", "levels"}
_DENSE = {"voxels"}
_TWO = {"boundary", "inside", "rank", "bricks"}
_THREE = _TWO | {"middle_boundary", "middle_inside", "middle_rank"}


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
    record |= {
        "boundary": arrays.cells.boundary.get(),
        "inside": arrays.inside.get(),
        "rank": arrays.cells.rank.get(),
        "bricks": arrays.voxels.get(),
    }
    finer, middle_inside = arrays.cells.finer, arrays.middle_inside
    if finer is None or middle_inside is None:
        return record
    return record | {
        "middle_boundary": finer.boundary.get(),
        "middle_inside": middle_inside.get(),
        "middle_rank": finer.rank.get(),
    }


def unpack(session: Session, record: dict[str, NDArray[Any]]) -> tuple[Grid, VoxelArrays]:
    """Return the model of *record*, its arrays on the device.

    Raises
    ------
    FormatError
        An array is missing, or has not the shape, the type or the content that it must have.
    """
    names = set(record)
    if names not in (_GRID | _DENSE, _GRID | _TWO, _GRID | _THREE):
        raise FormatError(f"not a clvox model: its arrays are {', '.join(sorted(names))}")
    if record["version"].shape != () or record["version"] != VERSION:
        raise FormatError(
            f"the model has layout version {record['version']}; this clvox reads {VERSION}"
        )
    try:
        grid = Grid(record["origin"], record["spacing"], record["shape"])
    except GridError as error:
        raise FormatError(f"the model's grid makes no sense: {error}") from error
    nx, ny, nz = grid.shape
    shape = grid.shape
    if names == _GRID | _DENSE:
        dense = _expect(record, "voxels", (nz, ny, words_for(nx)))
        return grid, VoxelArrays(shape, session.upload(dense))
    count = 2 if names == _GRID | _TWO else 3
    levels = record["levels"]
    if levels.shape != (count, 3) or levels.dtype.kind not in "iu" or levels.min() < 1:
        raise FormatError(
            f"the model's levels are {levels.tolist()}; {count} positive triples are expected"
        )
    if levels.max() > MAX_SHAPE:
        raise FormatError(f"levels {levels.tolist()} are larger than any grid")
    counts, *bricks = (_triple(level) for level in levels)
    fine = cell_shape(shape, bricks[-1])
    if counts != (fine if count == 2 else cell_shape(fine, bricks[0])):
        raise FormatError(f"levels {levels.tolist()} do not hold a grid of {shape} voxels")
    rows = counts[2], counts[1], words_for(counts[0])
    cells = _ranked(session, record, "", rows, counts, bricks[0])
    inside = session.upload(_expect(record, "inside", rows))
    middle_inside = None
    if count == 3:
        words = cells.count, cells.brick_words
        finer = _ranked(session, record, "middle_", words, fine, bricks[1])
        middle_inside = session.upload(_expect(record, "middle_inside", words))
        cells = replace(cells, finer=finer)
    last = cells.last
    voxels = session.upload(_expect(record, "bricks", (last.count, last.brick_words)))
    return grid, VoxelArrays(shape, voxels, cells, inside, middle_inside)


def _ranked(
    session: Session,
    record: dict[str, NDArray[Any]],
    prefix: str,
    rows: tuple[int, ...],
    shape: Shape,
    brick: Shape,
) -> Cells:
    """One level of the record, its rank checked."""
    boundary = _expect(record, f"{prefix}boundary", rows)
    counts = np.bitwise_count(boundary.ravel()).astype(np.uint64)
    starts = np.arange(0, counts.size, RANK_WORDS)
    blocks = np.add.reduceat(counts, starts) if counts.size else counts
    rank = np.cumsum(blocks) - blocks
    if not np.array_equal(_expect(record, f"{prefix}rank", rank.shape), rank):
        raise FormatError(f"the model's {prefix}rank does not count its boundary cells")
    arrays = session.upload(boundary), session.upload(record[f"{prefix}rank"])
    return Cells(shape, brick, *arrays, int(blocks.sum()))


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
