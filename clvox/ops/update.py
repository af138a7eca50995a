"""From the model of a mesh to that of the mesh after an edit: `cl_kernels/update`.

The triangles as they were and as they are now bound what the edit changed: both meshes are closed,
and the triangles that stayed cancel.  So the voxels inside of those few triangles, by parity, are
the ones to flip.
"""

from __future__ import annotations

from typing import NamedTuple, cast

import numpy as np
import pyopencl.array as cla
from numpy.typing import NDArray

from clvox.device import Session
from clvox.grid import Shape
from clvox.ops.boundary import mark_cells
from clvox.ops.combine import Operation, combine
from clvox.ops.facets import Facets, upload_facets
from clvox.ops.layout import Cells, VoxelArrays, int4
from clvox.ops.multilevel import BITS, list_bricks, rank_cells
from clvox.ops.parity import fill_parity, mark_tree, with_boundary
from clvox.ops.query import Rule

MOST = 64
"""Cells of a triangle's box that are looked at before it counts as near."""

_TRIANGLE_STEPS = 16
"""What looking at a triangle costs, more or less."""


class Edit(NamedTuple):
    """The triangles that changed: corners, (n, 3, 3) int32, as they were and as they are."""

    before: NDArray[np.int32]
    after: NDArray[np.int32]


def update(
    session: Session, arrays: VoxelArrays, mesh: Facets | None, edit: Edit, bits: int
) -> VoxelArrays:
    """Return the arrays of the mesh after *edit*, those that it has when it is built anew.

    Parameters
    ----------
    arrays : VoxelArrays
        Of the mesh before, by parity, with bricks where it touches cells and nowhere else.
    mesh : Facets
        All of it, after; not looked at for a dense grid.
    edit : Edit
    bits : int
        Steps in a voxel, as a power of two.
    """
    levels, shape = arrays.levels, arrays.shape
    before, after = (upload_corners(session, corners) for corners in edit)
    both = upload_corners(session, np.concatenate(edit))
    flips = fill_parity(session, both, bits, shape, levels)
    if arrays.cells is None or mesh is None:
        return combine(session, arrays, flips, Operation.XOR)
    if len(levels) == 2:
        box = _box(edit.before, arrays.cells.brick, bits)
        cells = _mark_again(session, arrays.cells, mesh, before, after, box, bits, shape)
        return _flip(session, arrays, flips, cells)
    cells = mark_tree(session, mesh, bits, shape, levels)
    return with_boundary(session, combine(session, arrays, flips, Operation.XOR), cells)


def _flip(session: Session, arrays: VoxelArrays, flips: VoxelArrays, cells: Cells) -> VoxelArrays:
    """The voxels that differ between two models of two levels, in bricks where *cells* has them."""
    operands = *arrays.arguments()[1:-1], *flips.arguments()[1:-1]
    defines = arrays.defines
    inside = session.empty(cells.boundary.shape, np.uint32)
    kernel = session.kernel("update/decide_cells.cl", "decide_cells", **defines)
    words = np.uint64(inside.size)
    session.run(kernel, inside.size, words, *operands, cells.boundary, inside, steps=BITS)
    bricks = session.empty((cells.count, cells.brick_words), np.uint32)
    if bricks.size:
        owners = list_bricks(session, cells)
        defines |= {"RULE": int(Rule.CENTRE), "OP": int(Operation.XOR)}
        kernel = session.kernel("combine/combine.cl", "combine_bricks", **defines)
        frame = np.uint64(bricks.size), int4(arrays.shape), int4(cells.shape), owners
        session.run(kernel, bricks.size, *frame, *operands, bricks)
    return VoxelArrays(arrays.shape, bricks, cells, inside)


def _mark_again(
    session: Session,
    cells: Cells,
    mesh: Facets,
    before: Facets,
    after: Facets,
    box: NDArray[np.int64],
    bits: int,
    shape: Shape,
) -> Cells:
    """The touched cells after an edit, from those before; looked at closely where it took place."""
    brick = cells.brick

    def without(marks: cla.Array, others: cla.Array) -> cla.Array:
        one, other = (VoxelArrays(cells.shape, each) for each in (marks, others))
        return combine(session, one, other, Operation.DIFFERENCE).voxels

    left = mark_cells(session, before, bits, shape, brick)
    kept = without(cells.boundary, left)
    mark_cells(session, after, bits, shape, brick, kept)
    # Where the edit has come back no other triangle need be asked: that is most cells.
    doubtful = without(left, kept)
    near = list_near(session, mesh, bits, cells.shape, brick, doubtful, box)
    mark_cells(session, near, bits, shape, brick, kept)
    return rank_cells(session, kept, cells.shape, brick)


def list_near(
    session: Session,
    mesh: Facets,
    bits: int,
    counts: Shape,
    side: Shape,
    marks: cla.Array,
    box: NDArray[np.int64],
) -> Facets:
    """Return the triangles that may touch one of the cells set in *marks*; some do not.

    counts: cells along each axis; side: voxels in one; marks: as from `mark_cells`;
    box: (2, 3), on the lattice, around all cells that are set.
    """
    triangles = mesh.faces.shape[0]
    listed = session.zeros(1, np.uint32)
    near = session.empty((triangles, 3), np.int32)
    sides = dict(zip(("CELL_X", "CELL_Y", "CELL_Z"), side, strict=True))
    kernel = session.kernel("update/list_near.cl", "list_near", STEP_BITS=bits, MOST=MOST, **sides)
    first, last = (int4(cast("Shape", tuple(corner))) for corner in box.tolist())
    frame = np.uint64(triangles), first, last, int4(counts)
    arrays = mesh.faces, mesh.vertices, marks, listed, near
    session.run(kernel, triangles, *frame, *arrays, steps=_TRIANGLE_STEPS)
    return Facets(mesh.vertices, near[: int(listed.get()[0])])


def _box(corners: NDArray[np.int32], brick: Shape, bits: int) -> NDArray[np.int64]:
    """A box, (2, 3), around all cells that triangles touch."""
    points = corners.reshape(-1, 3).astype(np.int64)
    if not len(points):
        return np.array([[1, 1, 1], [0, 0, 0]])
    width = np.array(brick) << bits
    return np.stack([points.min(axis=0) - width, points.max(axis=0) + width])


def upload_corners(session: Session, corners: NDArray[np.int32]) -> Facets:
    """Return triangles that share no vertex on the device; corners: (n, 3, 3) int32."""
    faces = np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3)
    return upload_facets(session, np.ascontiguousarray(corners.reshape(-1, 3)), faces)
