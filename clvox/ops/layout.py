"""The arrays of a two-level model on the device; docs/layouts draws them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import cast

import numpy as np
import pyopencl.array as cla
from pyopencl import cltypes

from clvox.device import Session
from clvox.device.session import Argument
from clvox.grid import Shape


def words_for(bits: int) -> int:
    """32-bit words that hold so many bits."""
    return -(-bits // 32)


def int4(triple: Shape) -> np.generic:
    """A kernel's argument for three integers."""
    return cast("np.generic", np.array((*triple, 0), cltypes.int4)[()])


@dataclass(frozen=True)
class Cells:
    """The coarse grid: which of its cells are touched, and the rank that numbers their bricks.

    shape: cells (x, y, z); brick: voxels (x, y, z) in a cell.
    boundary: (Nz, Ny, words) uint32 bits; rank: uint32, one per 256 bits; count: boundary cells.
    """

    shape: Shape
    brick: Shape
    boundary: cla.Array
    rank: cla.Array
    count: int

    @property
    def padded(self) -> Shape:
        """Voxels along each axis, those of the padding included."""
        x, y, z = (count * side for count, side in zip(self.shape, self.brick, strict=True))
        return x, y, z

    @property
    def shape4(self) -> np.generic:
        """The shape, as a kernel takes it."""
        return int4(self.shape)

    @property
    def defines(self) -> dict[str, int]:
        """The bricks' sides, as kernels are built with."""
        return brick_defines(self.brick)

    @property
    def brick_words(self) -> int:
        """Words of one brick."""
        return words_for(math.prod(self.brick))

    @property
    def face_words(self) -> int:
        """Words of one face: a bit for each ray along y through a cell."""
        return words_for(self.brick[0] * self.brick[2])


@dataclass(frozen=True)
class Bricks:
    """What crossings are flipped into.

    voxels: (count, brick words) uint32.
    exits: (count, face words): crossings behind the last sample of a brick's cell.
    entry, beyond: (Nz, Nx, face words): crossings before the first and past the last sample.
    """

    voxels: cla.Array
    exits: cla.Array
    entry: cla.Array
    beyond: cla.Array

    @classmethod
    def cleared(cls, session: Session, cells: Cells) -> Bricks:
        """Return bricks for *cells* without a flipped bit."""
        columns = cells.shape[2], cells.shape[0], cells.face_words
        return cls(
            voxels=session.zeros((cells.count, cells.brick_words), np.uint32),
            exits=session.zeros((cells.count, cells.face_words), np.uint32),
            entry=session.zeros(columns, np.uint32),
            beyond=session.zeros(columns, np.uint32),
        )


def brick_defines(brick: Shape) -> dict[str, int]:
    """A brick's sides, as kernels are built with."""
    return dict(zip(("BRICK_X", "BRICK_Y", "BRICK_Z"), brick, strict=True))


def cell_shape(shape: Shape, brick: Shape) -> Shape:
    """Cells along each axis that hold *shape* voxels."""
    x, y, z = (-(-count // side) for count, side in zip(shape, brick, strict=True))
    return x, y, z


@dataclass(frozen=True)
class VoxelArrays:
    """A model's arrays on the device.

    shape: voxels (x, y, z).  With two levels, `cells` and `inside` (bits like `cells.boundary`)
    are there and `voxels` are bricks, (count, brick words); with one level `voxels` is the dense
    grid of bits, (nz, ny, words).
    """

    shape: Shape
    voxels: cla.Array
    cells: Cells | None = None
    inside: cla.Array | None = None

    @property
    def levels(self) -> tuple[Shape, ...]:
        """Shape of the coarse grid and of the bricks; of the dense grid alone if there are none."""
        return (self.shape,) if self.cells is None else (self.cells.shape, self.cells.brick)

    @property
    def nbytes(self) -> int:
        """Bytes on the device."""
        arrays = [self.voxels]
        if self.cells is not None and self.inside is not None:
            arrays += [self.cells.boundary, self.cells.rank, self.inside]
        return sum(array.nbytes for array in arrays)

    @property
    def defines(self) -> dict[str, int]:
        """What kernels that read a model (`common/model.h`) are built with."""
        if self.cells is None:
            return {"LEVELS": 1}
        return {"LEVELS": 2, **self.cells.defines}

    def arguments(self, edge: cla.Array | None = None) -> tuple[Argument, ...]:
        """What kernels that read a model take: MODEL_PARAMETERS of `common/model.h`."""
        none = self.voxels if edge is None else edge
        if self.cells is None or self.inside is None:
            return int4(self.shape), none, none, none, self.voxels, none
        cells = self.cells
        return cells.shape4, cells.boundary, self.inside, cells.rank, self.voxels, none
