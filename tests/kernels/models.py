"""Two-level models at random, on the host and on the device, for the kernels that read them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pyopencl.array as cla
from numpy.typing import NDArray

from clvox.grid import Shape
from clvox.ops.layout import VoxelArrays, cell_shape
from clvox.ops.multilevel import rank_cells
from clvox.ops.query import Rule
from clvox.reference.multilevel import Model, pack_bits, pack_bricks
from tests.kernels.cases import bricks_at

if TYPE_CHECKING:
    from clvox.device import Session

MODELS: list[tuple[Shape, Shape | None]] = [
    ((9, 8, 7), None),
    ((70, 5, 6), None),
    ((17, 9, 10), (8, 8, 8)),
    ((10, 11, 9), (3, 5, 2)),
    ((37, 4, 5), (1, 1, 1)),
    ((70, 8, 5), (33, 7, 2)),
    ((300, 9, 9), (8, 8, 8)),
]
"""Shapes and bricks; None for a dense grid.  The last has more cells in a row than a word bits."""


class Sample(NamedTuple):
    """A model: `voxels` and `edge`, (nz, ny, nx) bool, say which are in and which are touched.

    `states` are those of its cells, and `arrays` and `marks` the same on the device.
    """

    voxels: NDArray[np.bool_]
    edge: NDArray[np.bool_]
    model: Model | None
    arrays: VoxelArrays
    marks: cla.Array

    def by_rule(self, rule: Rule) -> NDArray[np.uint8]:
        """What the rule says of each voxel, (nz, ny, nx)."""
        answers = {
            Rule.CENTRE: self.voxels,
            Rule.TOUCH: self.voxels | self.edge,
            Rule.WITHIN: self.voxels & ~self.edge,
            Rule.CLASS: np.where(self.edge, 2, self.voxels),
        }
        return answers[rule].astype(np.uint8)


def sample(session: Session, seed: int, shape: Shape, brick: Shape | None) -> Sample:
    """Return a model whose bits are random: no mesh gives it, and any could be right."""
    rng = np.random.default_rng(seed)
    voxels, edge = rng.random((2, *shape[::-1])) < 0.5
    if brick is None:
        words, marks = (session.upload(pack_bits(bits)) for bits in (voxels, edge))
        return Sample(voxels, edge, None, VoxelArrays(shape, words), marks)
    counts = cell_shape(shape, brick)
    boundary = rng.random(counts[::-1]) < 0.6
    inside = ~boundary & (rng.random(boundary.shape) < 0.5)
    bricks = bricks_at(voxels, boundary, brick)
    model = Model(shape, brick, boundary, inside, bricks)
    edges = replace(model, inside=np.zeros_like(inside), bricks=bricks_at(edge, boundary, brick))
    cells = rank_cells(session, session.upload(pack_bits(boundary)), counts, brick)
    arrays = VoxelArrays(
        shape,
        session.upload(pack_bricks(bricks)),
        cells,
        session.upload(pack_bits(inside)),
    )
    marks = session.upload(pack_bricks(edges.bricks))
    return Sample(model.to_array(), edges.to_array(), model, arrays, marks)


def assert_same_arrays(one: VoxelArrays, other: VoxelArrays) -> None:
    """Bit for bit, down to which cells have bricks."""
    assert one.levels == other.levels
    for a, b in zip(_arrays_of(one), _arrays_of(other), strict=True):
        np.testing.assert_array_equal(a.get(), b.get())


def _arrays_of(arrays: VoxelArrays) -> list[cla.Array]:
    """All that is kept on the device."""
    return [each for each in arrays.arguments() if isinstance(each, cla.Array)]
