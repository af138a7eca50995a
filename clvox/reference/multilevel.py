"""Multi-level models, and the packing of bits that they stand on: twin of the multilevel kernels.

Cells are numbered ``(k * Ny + j) * Nx + i``; the bits of a row, of the cells and of a brick are
packed into 32-bit words, element i of a row as bit ``i % 32`` of word ``i // 32``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clvox.errors import GridError
from clvox.grid import Shape
from clvox.reference.boundary import cells_of, touched
from clvox.reference.crossings import fill_parity

OUTSIDE, INSIDE, BOUNDARY = 0, 1, 2
"""States of a cell or a voxel, as uint8."""

RANK_BITS = 256
"""Bits of `boundary` per entry of `rank`."""


@dataclass(frozen=True)
class Model:
    """A voxel model of two levels as plain arrays.

    A model of three is held against two of these: its coarse cells are those of two levels with
    the larger bricks, its level between and its voxels those of two levels with the smaller.

    Attributes
    ----------
    shape, size : (3,) int
        Voxels of the grid, and of one cell, along x, y and z.
    boundary : (Nz, Ny, Nx) bool
        The cells that some triangle touches.
    inside : (Nz, Ny, Nx) bool
        The cells that none touches and whose voxels are all in.
    bricks : (bricks, n1z, n1y, n1x) bool
        The voxels of each boundary cell, in the order of the cells' numbers.  Voxels beyond
        *shape* are False.
    """

    shape: Shape
    size: Shape
    boundary: NDArray[np.bool_]
    inside: NDArray[np.bool_]
    bricks: NDArray[np.bool_]

    @property
    def states(self) -> NDArray[np.uint8]:
        """OUTSIDE, INSIDE or BOUNDARY of each cell; (Nz, Ny, Nx)."""
        return np.where(self.boundary, BOUNDARY, np.where(self.inside, INSIDE, OUTSIDE)).astype(
            np.uint8
        )

    def to_array(self) -> NDArray[np.bool_]:
        """Return the voxels, (nz, ny, nx)."""
        nx, ny, nz = self.shape
        n1x, n1y, n1z = self.size
        cells = np.repeat(self.inside, n1z, axis=0).repeat(n1y, axis=1).repeat(n1x, axis=2)
        for (k, j, i), brick in zip(np.argwhere(self.boundary), self.bricks, strict=True):
            z, y, x = k * n1z, j * n1y, i * n1x
            cells[z : z + n1z, y : y + n1y, x : x + n1x] = brick
        return cells[:nz, :ny, :nx]


def build(
    vertices: ArrayLike,
    faces: ArrayLike,
    bits: int,
    shape: Shape,
    levels: tuple[Shape, Shape],
) -> Model:
    """Return the two-level model of a closed mesh, filled by parity.

    Parameters
    ----------
    vertices : (n, 3) int
        Lattice positions.
    faces : (m, 3) int
    bits : int
        A voxel is ``2**bits`` steps wide.
    shape : (3,) int
        Voxels along x, y and z.
    levels : ((N0x, N0y, N0z), (n1x, n1y, n1z))
        Cells of the grid, and voxels of a cell; the first is ceil(shape / the second).

    Raises
    ------
    GridError
        The cells do not just cover the grid.
    AssertionError
        The samples of an untouched cell disagree, which no closed mesh can bring about.
    """
    counts, size = levels
    if counts != cells_of(shape, size):
        raise GridError(
            f"levels {levels} do not just cover {shape} voxels: "
            f"the first must be {cells_of(shape, size)}"
        )
    boundary = touched(vertices, faces, bits, shape, size)
    padded = (counts[0] * size[0], counts[1] * size[1], counts[2] * size[2])
    voxels = fill_parity(vertices, faces, bits, padded, "y")
    blocks = _blocks(voxels, counts, size)
    some, every = blocks.any(axis=(3, 4, 5)), blocks.all(axis=(3, 4, 5))
    mixed = ~boundary & some & ~every
    if mixed.any():
        raise AssertionError(f"{mixed.sum()} untouched cells are neither in nor out")

    voxels[shape[2] :] = False
    voxels[:, shape[1] :] = False
    voxels[:, :, shape[0] :] = False
    bricks = _blocks(voxels, counts, size)[boundary]
    return Model(shape, size, boundary, ~boundary & every, bricks)


def from_voxels(voxels: NDArray[np.bool_], size: Shape) -> Model:
    """Return the two-level model of voxels, (nz, ny, nx), in cells of *size* voxels.

    Those cells have a brick whose voxels, as far as the grid reaches, are not all alike.
    """
    nz, ny, nx = voxels.shape
    shape = (nx, ny, nz)
    counts = cells_of(shape, size)
    missing = [
        (0, count * side - have)
        for count, side, have in zip(counts[::-1], size[::-1], voxels.shape, strict=True)
    ]
    padded, real = np.pad(voxels, missing), np.pad(np.ones_like(voxels), missing)
    blocks, parts = _blocks(padded, counts, size), _blocks(real, counts, size)
    some, every = blocks.any(axis=(3, 4, 5)), (blocks == parts).all(axis=(3, 4, 5))
    boundary = some & ~every
    return Model(shape, size, boundary, every, blocks[boundary])


def contains(model: Model, indices: ArrayLike) -> NDArray[np.bool_]:
    """Return whether each voxel (i, j, k) is in; False for one outside of the grid; (n,) bool."""
    numbers = np.cumsum(model.boundary).reshape(model.boundary.shape) - 1
    n1x, n1y, n1z = model.size
    found = []
    for i, j, k in np.asarray(indices).tolist():
        if not all(0 <= at < n for at, n in zip((i, j, k), model.shape, strict=True)):
            found.append(False)
            continue
        cell = k // n1z, j // n1y, i // n1x
        if model.boundary[cell]:
            found.append(bool(model.bricks[numbers[cell], k % n1z, j % n1y, i % n1x]))
        else:
            found.append(bool(model.inside[cell]))
    return np.array(found, dtype=np.bool_)


def classify(model: Model, edge: NDArray[np.bool_], indices: ArrayLike) -> NDArray[np.uint8]:
    """Return OUTSIDE, INSIDE or BOUNDARY of each voxel (i, j, k); (n,) uint8.

    *edge* tells which voxels some triangle touches, (nz, ny, nx): `touched` for cells of 1 x 1 x 1.
    Voxels outside of the grid are OUTSIDE.
    """
    found = []
    for (i, j, k), inside in zip(
        np.asarray(indices).tolist(), contains(model, indices), strict=True
    ):
        held = all(0 <= at < n for at, n in zip((i, j, k), model.shape, strict=True))
        if held and edge[k, j, i]:
            found.append(BOUNDARY)
        else:
            found.append(INSIDE if inside else OUTSIDE)
    return np.array(found, dtype=np.uint8)


def pack_bits(bits: ArrayLike) -> NDArray[np.uint32]:
    """Return booleans packed along the last axis, (..., ceil(n / 32)); missing bits are 0."""
    rows = np.asarray(bits, dtype=np.bool_)
    count = rows.shape[-1]
    words = np.zeros((*rows.shape[:-1], -(-count // 32)), dtype=np.uint32)
    for i in range(count):
        words[..., i // 32] |= rows[..., i].astype(np.uint32) << np.uint32(i % 32)
    return words


def pack_bricks(bricks: NDArray[np.bool_]) -> NDArray[np.uint32]:
    """Return bricks as words, (bricks, ceil(voxels of one / 32)).

    Voxel (x, y, z) of a brick is its element ``(z * n1y + y) * n1x + x``.
    """
    return pack_bits(bricks.reshape(len(bricks), int(np.prod(bricks.shape[1:]))))


def rank(words: ArrayLike) -> NDArray[np.uint32]:
    """Return how many bits are set before each block of `RANK_BITS`; (ceil(words / 8),) uint32."""
    counts = [word.bit_count() for word in np.asarray(words).ravel().tolist()]
    per_block = RANK_BITS // 32
    blocks = [sum(counts[start : start + per_block]) for start in range(0, len(counts), per_block)]
    return prefix_sum(np.array(blocks, dtype=np.uint32))[0].astype(np.uint32)


def prefix_sum(values: ArrayLike) -> tuple[NDArray[np.uint64], int]:
    """Return the sum of all values before each one (uint64), and the sum of all."""
    sums = []
    total = 0
    for value in np.asarray(values).ravel().tolist():
        sums.append(total)
        total += value
    return np.array(sums, dtype=np.uint64), total


def _blocks(voxels: NDArray[np.bool_], counts: Shape, size: Shape) -> NDArray[np.bool_]:
    """View of whole cells: (Nz, Ny, Nx, n1z, n1y, n1x)."""
    (nx, ny, nz), (n1x, n1y, n1z) = counts, size
    return voxels.reshape(nz, n1z, ny, n1y, nx, n1x).transpose(0, 2, 4, 1, 3, 5)
