"""The arrays of a model, on one level, two or three, on the device; docs/layouts draws them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, cast

import numpy as np
import pyopencl.array as cla
from numpy.typing import NDArray
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


def int2(first: int, second: int) -> np.generic:
    """A kernel's argument for two integers."""
    return cast("np.generic", np.array((first, second), cltypes.int2)[()])


def float4(values: Sequence[float] | NDArray[np.float64]) -> np.generic:
    """A kernel's argument for three or four numbers."""
    numbers = [*map(float, values), 0.0]
    return np.void(tuple(numbers[:4]), cltypes.float4)


@dataclass(frozen=True)
class Cells:
    """A level above the voxels: which of its cells are touched, and the rank of those.

    The coarse grid, or, as `finer` of it, the cells between it and the voxels.

    shape: cells (x, y, z) of the whole grid; brick: cells of the next level, or voxels, in each.
    boundary: uint32 bits, (Nz, Ny, words) for the coarse grid, (bricks, words) below it.
    rank: uint32, one per 256 bits; count: boundary cells.
    """

    shape: Shape
    brick: Shape
    boundary: cla.Array
    rank: cla.Array
    count: int
    finer: Cells | None = None

    @property
    def last(self) -> Cells:
        """The level whose bricks hold voxels."""
        return self.finer or self

    @property
    def levels(self) -> tuple[Shape, ...]:
        """Shape of the coarse grid, and of the bricks level by level."""
        return (self.shape, self.brick, *([self.finer.brick] if self.finer else []))

    @property
    def padded(self) -> Shape:
        """Cells of the next level, or voxels, along each axis, those of the padding included."""
        x, y, z = (count * side for count, side in zip(self.shape, self.brick, strict=True))
        return x, y, z

    @property
    def tree(self) -> tuple[Argument, ...]:
        """TREE_PARAMETERS of `common/bricks.h`."""
        finer = (self.finer.boundary, self.finer.rank) if self.finer else ()
        return int4(self.shape), self.boundary, self.rank, *finer

    @property
    def defines(self) -> dict[str, int]:
        """What kernels that look for bricks are built with."""
        if self.finer is None:
            return brick_defines(self.brick)
        middle = dict(zip(("MIDDLE_X", "MIDDLE_Y", "MIDDLE_Z"), self.brick, strict=True))
        return brick_defines(self.finer.brick) | middle | {"LEVELS": 3}

    @property
    def brick_words(self) -> int:
        """Words of a brick of this level."""
        return words_for(math.prod(self.brick))

    @property
    def face_words(self) -> int:
        """Words of one face: a bit for each ray along y through a cell of this level."""
        return words_for(self.brick[0] * self.brick[2])


class Slab(NamedTuple):
    """Whole layers of coarse cells: as many layers of cells of voxels, and their bricks.

    Rows along y are cut nowhere, so slabs are independent of each other; and since bricks are
    numbered along z last, those of a slab follow each other.
    """

    first_layer: int
    layers: int
    first_brick: int
    bricks: int

    @classmethod
    def whole(cls, cells: Cells) -> Slab:
        """All there is below the tree *cells*."""
        return cls(0, cells.last.shape[2], 0, cells.last.count)


@dataclass(frozen=True)
class Bricks:
    """What crossings are flipped into.

    voxels: (count, brick words) uint32.
    And of a slab, whose rays alone are cast:
    exits: (bricks, face words): crossings behind the last sample of a brick's cell.
    entry, beyond: (layers, Nx, face words): crossings before the first and past the last sample.
    """

    voxels: cla.Array
    exits: cla.Array
    entry: cla.Array
    beyond: cla.Array
    slab: Slab

    @classmethod
    def cleared(
        cls,
        session: Session,
        cells: Cells,
        voxels: cla.Array | None = None,
        slab: Slab | None = None,
    ) -> Bricks:
        """Return bricks of voxels for the tree *cells* without a flipped bit.

        voxels: those of the whole model, if they are there already; slab: by default, all of it.
        """
        last = cells.last
        slab = slab or Slab.whole(cells)
        columns = slab.layers, last.shape[0], last.face_words
        if voxels is None:
            voxels = session.zeros((last.count, last.brick_words), np.uint32)
        return cls(
            voxels=voxels,
            exits=session.zeros((slab.bricks, last.face_words), np.uint32),
            entry=session.zeros(columns, np.uint32),
            beyond=session.zeros(columns, np.uint32),
            slab=slab,
        )

    def sink(self, cells: Cells) -> tuple[Argument, ...]:
        """SINK_PARAMETERS of `crossings/sinks.h` for the sink BRICKS."""
        start = np.int32(self.slab.first_layer), np.uint32(self.slab.first_brick)
        flips = self.voxels, self.exits, self.entry, self.beyond
        return int4(cells.last.shape), *cells.tree, *start, *flips


def brick_defines(brick: Shape) -> dict[str, int]:
    """What kernels that look for bricks below a coarse grid are built with."""
    return {"LEVELS": 2, **dict(zip(("BRICK_X", "BRICK_Y", "BRICK_Z"), brick, strict=True))}


def cell_shape(shape: Shape, brick: Shape) -> Shape:
    """Cells along each axis that hold *shape* voxels."""
    x, y, z = (-(-count // side) for count, side in zip(shape, brick, strict=True))
    return x, y, z


@dataclass(frozen=True)
class VoxelArrays:
    """A model's arrays on the device.

    shape: voxels (x, y, z).  With two levels or three, `cells` and `inside` (bits like
    `cells.boundary`) are there and `voxels` are bricks, (count, brick words); with three,
    `middle_inside` too (bits like `cells.finer.boundary`).  With one level `voxels` is the dense
    grid of bits, (nz, ny, words).
    """

    shape: Shape
    voxels: cla.Array
    cells: Cells | None = None
    inside: cla.Array | None = None
    middle_inside: cla.Array | None = None

    @property
    def levels(self) -> tuple[Shape, ...]:
        """Shape of the coarse grid and of the bricks; of the dense grid alone if there are none."""
        return (self.shape,) if self.cells is None else self.cells.levels

    @property
    def columns(self) -> Shape:
        """Cells of voxels along each axis; the voxels themselves in a dense grid."""
        return self.shape if self.cells is None else self.cells.last.shape

    @property
    def cell(self) -> Shape:
        """Voxels along the sides of a cell of voxels; (1, 1, 1) in a dense grid."""
        return (1, 1, 1) if self.cells is None else self.levels[-1]

    @property
    def nbytes(self) -> int:
        """Bytes on the device."""
        return sum(array.nbytes for array in self.arrays)

    @property
    def arrays(self) -> tuple[cla.Array, ...]:
        """All that is on the device."""
        arguments = self.arguments()[:-1]
        return tuple(argument for argument in arguments if isinstance(argument, cla.Array))

    @property
    def defines(self) -> dict[str, int]:
        """What kernels that read a model (`common/model.h`) are built with."""
        return {"LEVELS": 1} if self.cells is None else self.cells.defines

    def arguments(self, edge: cla.Array | None = None) -> tuple[Argument, ...]:
        """What kernels that read a model take: MODEL_PARAMETERS of `common/model.h`."""
        above: tuple[Argument, ...] = (int4(self.shape),)
        if self.cells is not None and self.inside is not None:
            above = *self.cells.tree, self.inside
            if self.middle_inside is not None:
                above = *above, self.middle_inside
        return *above, self.voxels, self.voxels if edge is None else edge
