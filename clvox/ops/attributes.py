"""What the mesh says about voxels that it touches: `cl_kernels/attributes`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pyopencl.array as cla
from numpy.typing import NDArray

from clvox.device import Session
from clvox.device.session import Argument
from clvox.grid import Shape
from clvox.ops.boundary import DIRECT, TILE
from clvox.ops.facets import Facets, visit_facets
from clvox.ops.layout import VoxelArrays, int4
from clvox.ops.multilevel import rank_cells
from clvox.ops.scan import prefix_sum
from clvox.ops.sorting import sort_rows
from clvox.reference.attributes import NO_NORMAL

_SUMS, _LINKS, _LOOK_UP = (
    "attributes/sum_normals.cl",
    "attributes/link_faces.cl",
    "attributes/look_up.cl",
)

VOXELS_PER_PASS = 1 << 24
"""Touched voxels whose sums are on the device at once; each pass visits all triangles."""


@dataclass(frozen=True)
class Touched:
    """The touched voxels of a model, numbered in the order of their bits.

    edge: uint32 bits, laid out like the model's voxels; rank: uint32, one per 256 of them.
    """

    arrays: VoxelArrays
    edge: cla.Array
    rank: cla.Array
    count: int

    @property
    def cells(self) -> Shape:
        """Cells of the last level above the voxels; of a dense grid its voxels."""
        return self.arrays.columns

    @property
    def cell_count(self) -> int:
        """Boundary cells; in a dense grid the touched voxels."""
        return self.count if self.arrays.cells is None else self.arrays.cells.last.count

    @property
    def side(self) -> Shape:
        """Voxels along the sides of a cell."""
        return (1, 1, 1) if self.arrays.cells is None else self.arrays.levels[-1]

    @property
    def tree(self) -> tuple[Argument, ...]:
        """TREE_PARAMETERS, in which a touched voxel of a dense grid is a cell."""
        if self.arrays.cells is None:
            return int4(self.arrays.shape), self.edge, self.rank
        return self.arrays.cells.tree

    @property
    def arguments(self) -> tuple[Argument, ...]:
        """TOUCHED_PARAMETERS of `attributes/touched.h`."""
        return *self.tree, self.edge, self.rank


def number_touched(session: Session, arrays: VoxelArrays, edge: cla.Array) -> Touched:
    """Return the touched voxels with their ranks."""
    ranked = rank_cells(session, edge, arrays.shape, (1, 1, 1))
    return Touched(arrays, edge, ranked.rank, ranked.count)


def sum_normals(
    session: Session,
    facets: Facets,
    bits: int,
    touched: Touched,
    normals: NDArray[np.int32],
    *,
    direct: int = DIRECT,
    tile: int = TILE,
    most: int = VOXELS_PER_PASS,
) -> cla.Array:
    """Return the packed normal of each touched voxel, (touched voxels,) uint32.

    normals: (m, 3) int32, of each triangle; the sum of all of them is below 2**46.  most: voxels in
    a pass.
    """
    packed = session.empty(touched.count, np.uint32)
    given = session.upload(normals)
    largest = int(np.abs(normals.astype(np.int64)).max(initial=0))
    limbs = 1 if largest * len(normals) < 2**31 else 2
    defines = _defines(bits, (1, 1, 1), touched, direct, tile) | {"LIMBS": limbs, "RANK_WORDS": 1}

    if session.device.atomic_loads:
        defines["ATOMIC_LOADS"] = 1

    def rank_words(words: cla.Array) -> cla.Array:
        counts = session.empty(words.size, np.uint32)
        kernel = session.kernel(_SUMS, "count_words", **defines, RUN=1)
        session.run(kernel, words.size, np.uint64(words.size), words, counts)
        return prefix_sum(session, counts)[0]

    where = _finely_ranked(touched, rank_words)
    for first in range(0, touched.count, most):
        last = min(first + most, touched.count)
        sums = session.zeros((last - first, 3 * limbs), np.uint32)
        lowest = session.zeros(last - first, np.uint32)
        span = np.uint32(first), np.uint32(last)
        sink = *where, given, *span, sums, lowest
        visit_facets(session, _SUMS, "mark", facets, int4(touched.arrays.shape), sink, defines)
        kernel = session.kernel(_SUMS, "pack_normals", **defines, RUN=1)
        count = last - first
        begin = np.uint64(count), np.uint32(first)
        session.run(kernel, count, *begin, given, sums, lowest, packed)
    return packed


def link_faces(
    session: Session,
    facets: Facets,
    bits: int,
    touched: Touched,
    *,
    direct: int = DIRECT,
    tile: int = TILE,
) -> tuple[cla.Array, cla.Array]:
    """Return the triangles that touch each boundary cell, as compressed rows in rising order.

    Returns
    -------
    offsets : (cells + 1,) uint64, on the device
    faces : (n,) int32, on the device
    """
    # One count more than there are cells, so that the last offset is the end of the last row.
    counts = session.zeros(touched.cell_count + 1, np.uint32)
    none = session.empty(1, np.int64)
    grid = int4(touched.cells)
    defines = _defines(bits, touched.side, touched, direct, tile)
    sink: tuple[Argument, ...] = (*touched.tree, counts, none, none)
    visit_facets(session, _LINKS, "mark", facets, grid, sink, defines | {"EMIT": 0})
    offsets, total = prefix_sum(session, counts, bits=64)
    faces = session.empty(total, np.int32)
    if total:
        rows = session.empty(total, np.int64)
        found = session.zeros(touched.cell_count + 1, np.uint32)
        sink = *touched.tree, found, offsets, rows
        visit_facets(session, _LINKS, "mark", facets, grid, sink, defines | {"EMIT": 1})
        sort_rows(session, offsets, rows)
        kernel = session.kernel(_LINKS, "take_low", **defines, EMIT=1, RUN=1)
        session.run(kernel, total, np.uint64(total), rows, faces)
    return offsets, faces


def normals_of(
    session: Session, touched: Touched, packed: cla.Array, voxels: NDArray[np.int32]
) -> NDArray[np.uint32]:
    """Return the packed normals of *voxels*, (n, 3) int32 (i, j, k); NO_NORMAL for others."""
    count = len(voxels)
    if count == 0 or touched.count == 0:
        return np.full(count, NO_NORMAL, np.uint32)
    found = session.empty(count, np.uint32)
    kernel = session.kernel(_LOOK_UP, "find_normals", **_tree_defines(touched))
    given = np.uint64(count), session.upload(voxels)
    session.run(kernel, count, *given, *touched.arguments, packed, found)
    answers: NDArray[np.uint32] = found.get()
    return answers


def faces_of(
    session: Session,
    touched: Touched,
    offsets: cla.Array,
    faces: cla.Array,
    voxels: NDArray[np.int32],
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Return the triangles in the cells of *voxels*, (n, 3) int32 (i, j, k), as compressed rows.

    Returns
    -------
    offsets : (n + 1,) int64
    faces : (offsets[-1],) int32
    """
    count = len(voxels)
    if count == 0 or touched.count == 0:
        return np.zeros(count + 1, np.int64), np.zeros(0, np.int32)
    defines = _tree_defines(touched)
    cells_of, counts = session.empty(count, np.uint32), session.empty(count, np.uint32)
    kernel = session.kernel(_LOOK_UP, "count_faces", **defines)
    given = np.uint64(count), session.upload(voxels)
    session.run(kernel, count, *given, *touched.arguments, offsets, cells_of, counts)
    starts, total = prefix_sum(session, counts, bits=64)
    found = session.empty(total, np.int32)
    if total:
        kernel = session.kernel(_LOOK_UP, "copy_faces", **defines)
        session.run(
            kernel, count, np.uint64(count), cells_of, counts, offsets, faces, starts, found
        )
    ends = np.append(starts.get().astype(np.int64), total)
    return ends, found.get()


def _finely_ranked(
    touched: Touched, rank_words: Callable[[cla.Array], cla.Array]
) -> tuple[Argument, ...]:
    """TOUCHED_PARAMETERS with ranks of single words, which *rank_words* makes."""
    rank = rank_words(touched.edge)
    cells = touched.arrays.cells
    if cells is None:
        return int4(touched.arrays.shape), touched.edge, rank, touched.edge, rank
    finer = cells.finer and replace(cells.finer, rank=rank_words(cells.finer.boundary))
    fine = replace(cells, rank=rank_words(cells.boundary), finer=finer)
    return *fine.tree, touched.edge, rank


def _tree_defines(touched: Touched) -> dict[str, int]:
    return touched.arrays.defines


def _defines(bits: int, cell: Shape, touched: Touched, direct: int, tile: int) -> dict[str, int]:
    sides = dict(zip(("CELL_X", "CELL_Y", "CELL_Z"), cell, strict=True))
    return {"STEP_BITS": bits, "DIRECT": direct, "TILE": tile, **sides, **_tree_defines(touched)}
