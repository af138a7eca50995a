"""Solids as arrays of voxels, and models of them on the device, read back bit by bit."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from clvox.device import Session
from clvox.grid import Shape
from clvox.ops.layout import Cells, VoxelArrays, cell_shape
from clvox.reference.multilevel import pack_bits, rank

Voxels = NDArray[np.bool_]

Sides = tuple[Shape, ...]
"""Of the bricks of a model, level by level: of voxels; or of cells, and of voxels; or none."""

SIZES: list[tuple[Shape, Sides]] = [
    ((1, 1, 1), ()),
    ((1, 1, 1), ((1, 1, 1),)),
    ((33, 5, 3), ()),
    ((70, 4, 6), ((2, 3, 1),)),
    ((33, 9, 8), ((1, 2, 3),)),
    ((17, 16, 9), ((8, 8, 8),)),
    ((66, 6, 9), ((47, 3, 2),)),
    ((65, 6, 5), ((64, 3, 2),)),
    ((13, 20, 11), ((5, 7, 3),)),
    ((9, 4, 7), ((10, 20, 10),)),
    ((37, 11, 9), ((2, 2, 2), (4, 4, 4))),
    ((71, 5, 7), ((33, 1, 2), (1, 2, 3))),
    ((7, 9, 8), ((1, 3, 1), (5, 1, 2))),
    ((130, 3, 4), ((3, 2, 3), (20, 2, 1))),
]
"""Shapes of grids and bricks: divisible or not, more than a word, of one, larger than the grid."""


def levels_of(shape: Shape, sides: Sides) -> tuple[Shape, ...]:
    """The levels of a model of *shape* voxels in bricks of *sides*."""
    x, y, z = np.prod(np.array(sides or [(1, 1, 1)]), axis=0).tolist()
    return (cell_shape(shape, (x, y, z)), *sides)


def solid(seed: int, shape: Shape, sides: Sides) -> Voxels:
    """Voxels at random, in cells of each level that are all in, all out or mixed; [z, y, x]."""
    rng = np.random.default_rng(seed)
    nx, ny, nz = shape
    found = rng.random((nz, ny, nx)) < 0.5
    for level in range(len(sides) or 1, 0, -1):
        width = np.prod(np.array(sides[level - 1 :] or [(4, 4, 4)]), axis=0).tolist()
        states = rng.integers(0, 3, cell_shape(shape, (width[0], width[1], width[2]))[::-1])
        for axis in range(3):
            states = states.repeat(width[2 - axis], axis=axis)
        states = states[:nz, :ny, :nx]
        found = (states == 1) | ((states == 2) & found)
    return found


@dataclass(frozen=True)
class Level:
    """The cells of one level of an array of voxels, [z, y, x]."""

    mixed: Voxels
    full: Voxels


def cells_of(voxels: Voxels, width: NDArray[np.int64]) -> Level:
    """Which cells of *width* voxels (x, y, z) are mixed, and which are in."""
    nx, ny, nz = -(-np.array(voxels.shape[::-1]) // width)
    some, every = (np.zeros((nz, ny, nx), np.bool_) for _ in range(2))
    for cell in np.ndindex(some.shape):
        part = voxels[_box(cell, width)]
        some[cell], every[cell] = part.any(), part.all()
    return Level(some & ~every, every)


def pack(session: Session, voxels: Voxels, sides: Sides) -> VoxelArrays:
    """The model of an array, made by no kernel."""
    nz, ny, nx = voxels.shape
    shape = nx, ny, nz
    if not sides:
        return VoxelArrays(shape, session.upload(pack_bits(voxels)))
    levels = levels_of(shape, sides)
    top = cells_of(voxels, np.prod(np.array(sides), axis=0))
    cells = _level(session, levels[0], sides[0], pack_bits(top.mixed))
    inside = session.upload(pack_bits(top.full))
    if len(sides) == 1:
        bricks = session.upload(_bricks(voxels, top.mixed, sides[0]))
        return VoxelArrays(shape, bricks, cells, inside)
    below = cells_of(voxels, np.array(sides[1]))
    marks = _bricks(below.mixed, top.mixed, sides[0])
    finer = _level(session, cell_shape(shape, sides[1]), sides[1], marks)
    # Bricks of voxels follow the order of the bits above them.
    owners = _places(marks, np.argwhere(top.mixed), sides[0])
    bricks = session.upload(_at(voxels, owners, sides[1]))
    middle = session.upload(_bricks(below.full, top.mixed, sides[0]))
    return VoxelArrays(shape, bricks, replace(cells, finer=finer), inside, middle)


def unpack(arrays: VoxelArrays) -> Voxels:
    """The voxels of a model, read without any kernel; checks all that its layout promises."""
    nx, ny, nz = arrays.shape
    if arrays.cells is None or arrays.inside is None:
        return bits_of(arrays.voxels.get(), nx).reshape(nz, ny, nx)
    cells = arrays.cells
    boundary = _marks(cells)
    mixed = bits_of(boundary, cells.shape[0])
    full = bits_of(arrays.inside.get(), cells.shape[0])
    assert not (mixed & full).any()
    owners = np.argwhere(mixed)
    size = np.array(cells.brick)
    if cells.finer is not None and arrays.middle_inside is not None:
        finer = cells.finer
        marks = _marks(finer)
        parts = arrays.middle_inside.get()
        assert not (marks & parts).any()
        whole = _spread(full, size, finer.shape)
        _paste(whole, bits_of(parts, int(size.prod())), owners, size)
        _paste(np.zeros_like(whole), bits_of(marks, int(size.prod())), owners, size)
        owners = _places(marks, owners, cells.brick)
        full, size = whole, np.array(finer.brick)
    voxels = _spread(full, size, arrays.shape)
    _paste(voxels, bits_of(arrays.voxels.get(), int(size.prod())), owners, size)
    return voxels


def uniform_bricks(arrays: VoxelArrays) -> int:
    """How many cells that have a brick hold voxels that are all alike, as far as the grid goes."""
    assert arrays.cells is not None
    voxels = unpack(arrays)
    sides = arrays.levels[1:]
    mixed = bits_of(arrays.cells.boundary.get(), arrays.levels[0][0])
    owners = np.argwhere(mixed)
    width = np.prod(np.array(sides), axis=0)
    count = 0
    for _ in sides:
        parts = [voxels[_box(tuple(cell), width)] for cell in owners.tolist()]
        count += sum(int(part.all() or not part.any()) for part in parts)
        if arrays.cells.finer is not None:
            owners = _places(arrays.cells.finer.boundary.get(), owners, arrays.cells.brick)
        width = np.array(sides[-1])
    return count


def bits_of(words: NDArray[np.uint32], count: int) -> Voxels:
    """Words as booleans, (..., count); the bits beyond must be zero."""
    octets = words.astype("<u4").view(np.uint8)
    shape = (*words.shape[:-1], words.shape[-1] * 32)
    bits = np.unpackbits(octets, bitorder="little").reshape(shape).astype(np.bool_)
    assert not bits[..., count:].any()
    return bits[..., :count]


def _level(session: Session, shape: Shape, brick: Shape, marks: NDArray[np.uint32]) -> Cells:
    count = int(np.bitwise_count(marks).sum())
    return Cells(shape, brick, session.upload(marks), session.upload(rank(marks)), count)


def _marks(cells: Cells) -> NDArray[np.uint32]:
    """The bits of a level, whose ranks must be right."""
    marks: NDArray[np.uint32] = cells.boundary.get()
    assert cells.rank.get().tolist() == rank(marks).tolist()
    assert cells.count == np.bitwise_count(marks).sum()
    return marks


def _box(cell: tuple[int, ...], width: NDArray[np.int64]) -> tuple[slice, ...]:
    """The voxels of cell (k, j, i)."""
    return tuple(
        slice(at * side, (at + 1) * side)
        for at, side in zip(cell, width[::-1].tolist(), strict=True)
    )


def _bricks(array: Voxels, mixed: Voxels, brick: Shape) -> NDArray[np.uint32]:
    return _at(array, np.argwhere(mixed), brick)


def _at(array: Voxels, owners: NDArray[np.intp], brick: Shape) -> NDArray[np.uint32]:
    """The bricks of the cells *owners*, (k, j, i), packed; zero beyond the array."""
    found = np.zeros((len(owners), *brick[::-1]), np.bool_)
    for one, cell in zip(found, owners.tolist(), strict=True):
        part = array[_box(tuple(cell), np.array(brick))]
        one[tuple(map(slice, part.shape))] = part
    return pack_bits(found.reshape(len(owners), int(np.prod(brick))))


def _places(marks: NDArray[np.uint32], owners: NDArray[np.intp], brick: Shape) -> NDArray[np.intp]:
    """Cells (k, j, i) of the bits of bricks whose cells are *owners*."""
    number, at = np.nonzero(bits_of(marks, int(np.prod(brick))))
    within = np.stack(np.unravel_index(at, brick[::-1]), axis=1)
    return np.asarray(owners[number] * np.array(brick[::-1]) + within)


def _spread(cells: Voxels, width: NDArray[np.int64], shape: Shape) -> Voxels:
    """Cells as the cells or voxels in them, cut to *shape*."""
    for axis in range(3):
        cells = cells.repeat(int(width[2 - axis]), axis=axis)
    return cells[: shape[2], : shape[1], : shape[0]].copy()


def _paste(
    array: Voxels, bricks: Voxels, owners: NDArray[np.intp], size: NDArray[np.int64]
) -> None:
    """Put bricks where their cells are; what is beyond the array must be zero."""
    for bits, cell in zip(bricks, owners.tolist(), strict=True):
        brick = bits.reshape(size[::-1])
        part = array[_box(tuple(cell), size)]
        kept = tuple(map(slice, part.shape))
        assert not part.any()
        part[...] = brick[kept]
        assert brick.sum() == part.sum()
