"""From a closed mesh to the voxels inside it in one call, and models with a given boundary.

What `voxelize` does stage by stage, timed and told of, for those who need a model on the way to
another one.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from clvox.device import Session
from clvox.grid import Shape
from clvox.ops import crossings, dense
from clvox.ops.boundary import mark_cells, mark_voxels
from clvox.ops.combine import Operation, combine, rebrick
from clvox.ops.facets import Mesh
from clvox.ops.layout import Bricks, Cells, VoxelArrays, cell_shape, words_for
from clvox.ops.multilevel import carry, rank_cells


def fill_parity(
    session: Session, facets: Mesh, bits: int, shape: Shape, levels: tuple[Shape, ...]
) -> VoxelArrays:
    """Return the voxels of a grid of *shape* that lie inside a closed mesh, on *levels*."""
    if len(levels) == 1:
        nx, ny, nz = shape
        voxels = session.zeros((nz, ny, words_for(nx)), np.uint32)
        beyond = session.zeros((nz, words_for(nx)), np.uint32)
        crossings.flip_dense(session, facets, bits, shape, voxels, beyond)
        dense.fill(session, voxels, beyond)
        return VoxelArrays(shape, voxels)
    cells = mark_tree(session, facets, bits, shape, levels)
    bricks = Bricks.cleared(session, cells)
    crossings.flip_bricks(session, facets, bits, cells, bricks)
    solid = carry(session, cells, bricks, shape)
    return VoxelArrays(shape, bricks.voxels, cells, solid.inside, solid.middle_inside)


def mark_tree(
    session: Session, facets: Mesh, bits: int, shape: Shape, levels: tuple[Shape, ...]
) -> Cells:
    """Return the cells that some triangle touches, on each of two or three *levels*."""
    marks = mark_cells(session, facets, bits, shape, coarse_sides(levels))
    cells = rank_cells(session, marks, levels[0], levels[1])
    if len(levels) == 2:
        return cells
    counts = cell_shape(shape, levels[2])
    marks = mark_voxels(session, facets, bits, counts, cells, side=levels[2])
    return replace(cells, finer=rank_cells(session, marks, counts, levels[2]))


def coarse_sides(levels: tuple[Shape, ...]) -> Shape:
    """Voxels along the sides of a cell of the coarse grid."""
    x, y, z = np.prod(levels[1:], axis=0).tolist()
    return x, y, z


def with_boundary(session: Session, arrays: VoxelArrays, cells: Cells | None) -> VoxelArrays:
    """Return the same voxels with bricks where *cells* has them, or where voxels differ.

    *cells* has the levels of *arrays*; None for a dense grid, which has no bricks.
    """
    if cells is None:
        return arrays
    pruned = rebrick(session, arrays, arrays.levels, prune=True)
    return combine(session, pruned, _empty(session, arrays.shape, cells), Operation.XOR)


def _empty(session: Session, shape: Shape, cells: Cells) -> VoxelArrays:
    """The model without a voxel inside, but with the bricks of *cells*."""
    last = cells.last
    return VoxelArrays(
        shape,
        session.zeros((last.count, last.brick_words), np.uint32),
        cells,
        session.zeros(cells.boundary.shape, np.uint32),
        session.zeros(cells.finer.boundary.shape, np.uint32) if cells.finer else None,
    )
