"""Solids as arrays of voxels, and models of them on the device, read back bit by bit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from clvox.device import Session
from clvox.grid import Shape
from clvox.ops.layout import Cells, VoxelArrays, cell_shape
from clvox.reference.multilevel import Model, pack_bits, pack_bricks, rank

Voxels = NDArray[np.bool_]

SIZES: list[tuple[Shape, Shape | None]] = [
    ((1, 1, 1), None),
    ((1, 1, 1), (1, 1, 1)),
    ((33, 5, 3), None),
    ((70, 4, 6), (2, 3, 1)),
    ((33, 9, 8), (1, 2, 3)),
    ((17, 16, 9), (8, 8, 8)),
    ((66, 6, 9), (47, 3, 2)),
    ((65, 6, 5), (64, 3, 2)),
    ((13, 20, 11), (5, 7, 3)),
    ((9, 4, 7), (10, 20, 10)),
]
"""Shapes of grids and bricks, None for dense ones: divisible or not, more than a word, of one."""


def solid(seed: int, shape: Shape, brick: Shape | None) -> Voxels:
    """Voxels at random, in cells that are all in, all out or mixed; [z, y, x]."""
    rng = np.random.default_rng(seed)
    side = brick or (4, 4, 4)
    states = rng.integers(0, 3, cell_shape(shape, side)[::-1])
    for axis, width in enumerate(reversed(side)):
        states = states.repeat(width, axis=axis)
    nx, ny, nz = shape
    states = states[:nz, :ny, :nx]
    return (states == 1) | ((states == 2) & (rng.random(states.shape) < 0.5))


def pack(session: Session, voxels: Voxels, brick: Shape | None) -> VoxelArrays:
    """The model of an array, in bricks or dense, made by no kernel."""
    nz, ny, nx = voxels.shape
    shape = nx, ny, nz
    if brick is None:
        return VoxelArrays(shape, session.upload(pack_bits(voxels)))
    cells = cell_shape(shape, brick)
    boundary, inside = (np.zeros(cells[::-1], np.bool_) for _ in range(2))
    bricks = []
    for k, j, i in np.ndindex(boundary.shape):
        part = voxels[_box((k, j, i), brick)]
        inside[k, j, i] = part.all()
        boundary[k, j, i] = part.any() and not part.all()
        if boundary[k, j, i]:
            whole = np.zeros(brick[::-1], np.bool_)
            whole[tuple(map(slice, part.shape))] = part
            bricks.append(whole)
    marks = pack_bits(boundary)
    ranks = session.upload(rank(marks))
    found = np.array(bricks, np.bool_).reshape(len(bricks), *brick[::-1])
    words = session.upload(pack_bricks(found))
    return VoxelArrays(
        shape,
        words,
        Cells(cells, brick, session.upload(marks), ranks, len(bricks)),
        session.upload(pack_bits(inside)),
    )


def unpack(arrays: VoxelArrays) -> Voxels:
    """The voxels of a model, read without any other kernel; checks all that its layout promises."""
    nx, ny, nz = arrays.shape
    if arrays.cells is None or arrays.inside is None:
        return _bits(arrays.voxels.get(), nx).reshape(nz, ny, nx)
    cells = arrays.cells
    words = cells.boundary.get()
    boundary = _bits(words, cells.shape[0])
    inside = _bits(arrays.inside.get(), cells.shape[0])
    assert not (boundary & inside).any()
    assert cells.rank.get().tolist() == rank(words).tolist()
    assert cells.count == boundary.sum()
    size = cells.brick
    bricks = _bits(arrays.voxels.get(), size[0] * size[1] * size[2])
    bricks = bricks.reshape(cells.count, *size[::-1])
    for (k, j, i), brick in zip(np.argwhere(boundary), bricks, strict=True):
        x, y, z = nx - i * size[0], ny - j * size[1], nz - k * size[2]
        assert not brick[z:].any()
        assert not brick[:, y:].any()
        assert not brick[:, :, x:].any()
    return Model(arrays.shape, size, boundary, inside, bricks).to_array()


def uniform_bricks(arrays: VoxelArrays) -> int:
    """How many bricks have voxels that are all alike, as far as the grid reaches."""
    assert arrays.cells is not None
    voxels, size = unpack(arrays), arrays.cells.brick
    boundary = _bits(arrays.cells.boundary.get(), arrays.cells.shape[0])
    count = 0
    for k, j, i in np.argwhere(boundary):
        part = voxels[_box((k, j, i), size)]
        count += int(part.all() or not part.any())
    return count


def _box(cell: tuple[int, ...], size: Shape) -> tuple[slice, ...]:
    """The voxels of cell (k, j, i)."""
    return tuple(
        slice(at * width, (at + 1) * width) for at, width in zip(cell, reversed(size), strict=True)
    )


def _bits(words: NDArray[np.uint32], count: int) -> Voxels:
    """Words as booleans, (..., count); the bits beyond must be zero."""
    octets = words.astype("<u4").view(np.uint8)
    shape = (*words.shape[:-1], words.shape[-1] * 32)
    bits = np.unpackbits(octets, bitorder="little").reshape(shape).astype(np.bool_)
    assert not bits[..., count:].any()
    return bits[..., :count]
