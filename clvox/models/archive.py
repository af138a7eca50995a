"""A model as plain arrays: for pickling, and for `.npz` files."""

from __future__ import annotations

import math
import os
import zipfile
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clvox._files import whole
from clvox.device import Session
from clvox.errors import FormatError, GridError
from clvox.grid import MAX_SHAPE, Grid, Shape
from clvox.models.levels import MOST_SIDE
from clvox.ops.layout import Cells, VoxelArrays, cell_shape, words_for
from clvox.ops.multilevel import RANK_WORDS

VERSION = 1
"""Version of the arrays' layout: docs/layouts."""

_GRID = {"version", "origin", "spacing", "shape", "levels"}
_DENSE = {"voxels"}
_TWO = {"boundary", "inside", "rank", "bricks"}
_THREE = _TWO | {"middle_boundary", "middle_inside", "middle_rank"}

_DAMAGE = (
    EOFError,
    KeyError,
    OSError,
    RuntimeError,
    ValueError,
    zipfile.BadZipFile,
    zlib.error,
)
"""What NumPy raises where a byte of an open ``.npz`` file is wrong; OSError for a wrong offset."""


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
    shape, levels = grid.shape, record["levels"]
    count = 1 if "voxels" in names else 3 if "middle_rank" in names else 2
    if levels.shape != (count, 3) or levels.dtype.kind not in "iu" or levels.min() < 1:
        raise FormatError(
            f"the model's levels are {levels.tolist()}; {count} positive triples are expected"
        )
    if levels.max() > MAX_SHAPE:
        raise FormatError(f"levels {levels.tolist()} are larger than any grid")
    counts, *bricks = (_triple(level) for level in levels)
    if any(max(brick) > MOST_SIDE for brick in bricks):
        raise FormatError(
            f"levels {levels.tolist()}: a brick has 1 to {MOST_SIDE} cells or voxels a side"
        )
    needed = shape
    for brick in reversed(bricks):
        needed = cell_shape(needed, brick)
    if counts != needed:
        raise FormatError(f"levels {levels.tolist()} do not hold a grid of {shape} voxels")
    rows = counts[2], counts[1], words_for(counts[0])
    if count == 1:
        dense = _expect(record, "voxels", rows, counts[0])
        return grid, VoxelArrays(shape, session.upload(dense))
    cells, inside = _level(session, record, "", rows, counts[0], counts, bricks[0])
    z, y, x = np.nonzero(_bits(record["boundary"])[..., : counts[0]])
    owners = np.stack([x, y, z], axis=1)
    middle_inside = None
    if count == 3:
        fine, size = cell_shape(shape, bricks[1]), math.prod(bricks[0])
        words = cells.count, cells.brick_words
        finer, middle_inside = _level(session, record, "middle_", words, size, fine, bricks[1])
        for name in "middle_boundary", "middle_inside":
            _refuse_beyond(name, fine, bricks[0], owners, record[name])
        above, at = np.nonzero(_bits(record["middle_boundary"])[:, :size])
        within = np.stack(np.unravel_index(at, bricks[0][::-1])[::-1], axis=1)
        owners = owners[above] * bricks[0] + within
        cells = replace(cells, finer=finer)
    last = cells.last
    words = last.count, last.brick_words
    voxels = _expect(record, "bricks", words, math.prod(bricks[-1]))
    _refuse_beyond("bricks", shape, bricks[-1], owners, voxels)
    return grid, VoxelArrays(shape, session.upload(voxels), cells, inside, middle_inside)


def _level(
    session: Session,
    record: dict[str, NDArray[Any]],
    prefix: str,
    rows: tuple[int, ...],
    bits: int,
    shape: Shape,
    brick: Shape,
) -> tuple[Cells, Any]:
    """One level of the record, checked, and which of its cells are inside."""
    boundary = _expect(record, f"{prefix}boundary", rows, bits)
    inside = _expect(record, f"{prefix}inside", rows, bits)
    if (boundary & inside).any():
        raise FormatError("the model has cells that are boundary and inside at once")
    counts = np.bitwise_count(boundary.ravel()).astype(np.uint64)
    starts = np.arange(0, counts.size, RANK_WORDS)
    blocks = np.add.reduceat(counts, starts) if counts.size else counts
    rank = np.cumsum(blocks) - blocks
    if not np.array_equal(_expect(record, f"{prefix}rank", rank.shape), rank):
        raise FormatError(f"the model's {prefix}rank does not count its boundary cells")
    arrays = session.upload(boundary), session.upload(record[f"{prefix}rank"])
    return Cells(shape, brick, *arrays, int(blocks.sum())), session.upload(inside)


def write(path: str | os.PathLike[str], record: dict[str, NDArray[Any]]) -> None:
    """Write *record* to an ``.npz`` file; whole, or not at all."""
    target = Path(path)
    if target.suffix != ".npz":
        raise FormatError(f"a model is saved as .npz, got {target}")
    with whole(target) as partial, partial.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **record)


def read(path: str | os.PathLike[str]) -> dict[str, NDArray[Any]]:
    """Return the arrays of an ``.npz`` file.

    Raises
    ------
    FormatError
        It is not such a file, or is damaged.
    """
    name = Path(path)
    with name.open("rb") as stream:
        try:
            file = np.load(stream, allow_pickle=False)
            if not isinstance(file, np.lib.npyio.NpzFile):
                raise FormatError(f"{name} is one array, not a model")
            with file:
                return dict(file)
        except _DAMAGE as error:
            raise FormatError(f"{name} is not a clvox model: {error}") from error


def _expect(
    record: dict[str, NDArray[Any]], name: str, shape: tuple[int, ...], bits: int = 0
) -> NDArray[np.uint32]:
    """An array of the record, of that shape, with no bit set beyond the first *bits* of a row."""
    array = record[name]
    if array.shape != shape or array.dtype != np.uint32:
        raise FormatError(
            f"the model's array {name} must be uint32 of the shape {shape}, got {array.dtype} of "
            f"{array.shape}"
        )
    # Each row ends with a whole word, whose last bits must be zero: they would be counted.
    if bits % 32 and (array[..., -1] >> np.uint32(bits % 32)).any():
        raise FormatError(f"the model's array {name} has bits set beyond the {bits} of a row")
    return array


def _refuse_beyond(
    name: str,
    shape: Shape,
    brick: Shape,
    owners: NDArray[np.int64],
    bricks: NDArray[np.uint32],
) -> None:
    """Bricks at the far ends may reach beyond the grid, where their bits must be zero.

    shape: of the grid of what the bricks hold; owners: the cell (x, y, z) of each brick.
    """
    for axis in range(3):
        last = -(-shape[axis] // brick[axis]) - 1
        ends = bricks[owners[:, axis] == last]
        held = _bits(ends)[:, : math.prod(brick)].reshape(-1, *brick[::-1])
        if np.moveaxis(held, 3 - axis, 0)[shape[axis] - last * brick[axis] :].any():
            raise FormatError(f"the model's array {name} has bits beyond its grid of {shape}")


def _bits(words: NDArray[np.uint32]) -> NDArray[np.uint8]:
    """The bits of the last axis, the lowest first."""
    octets = np.ascontiguousarray(words, dtype="<u4").view(np.uint8)
    return np.unpackbits(octets, axis=-1, bitorder="little")


def _triple(values: NDArray[Any]) -> Shape:
    x, y, z = values.tolist()
    return x, y, z
