"""Voxels of an open mesh by generalised winding number: `cl_kernels/winding`."""

from __future__ import annotations

import math
from typing import NamedTuple, cast

import numpy as np
import pyopencl.array as cla
from numpy.typing import NDArray

from clvox.device import Session
from clvox.grid import Shape, Triple
from clvox.ops.boundary import mark_cells
from clvox.ops.caps import Caps, upload_caps
from clvox.ops.combine import rebrick
from clvox.ops.crossings import Window, fraction_bits
from clvox.ops.facets import Facets, Mesh, Progress, upload_facets
from clvox.ops.layout import Cells, VoxelArrays, cell_shape, int4, words_for
from clvox.ops.multilevel import BITS, list_bricks, rank_cells
from clvox.ops.parity import mark_tree, with_boundary
from clvox.ops.sorting import LIST_BYTES, sort_crossings, sorted_windows

BRICK = (8, 8, 8)
"""Cells in which a dense grid is decided."""

MIXED = -32768
"""The threshold of a cell whose samples have none in common."""

STEPS_PER_LOOK = 2000
"""What it costs to ask the caps, in steps as `Session.run` counts them."""

STEPS_PER_ANGLE = 10
"""What an angle costs."""


class Rim(NamedTuple):
    """The edges of an open mesh that are not used equally often both ways, and caps, on the device.

    ends: (edges, 2, 3) int32, lattice positions, each edge as the triangles run along it more
    often.  caps: what closes the mesh, in a tree; facets: the same, as a mesh.
    """

    ends: cla.Array
    edges: int
    caps: Caps
    facets: Facets


def upload_rim(
    session: Session,
    vertices: NDArray[np.int32],
    rim: NDArray[np.int32],
    caps: NDArray[np.int32],
    step: Triple,
) -> Rim:
    """Return the rim and its caps on the device.

    vertices: (n, 3) int32, lattice positions; rim: (m, 2) int32, edges; caps: (k, 3) int32, from
    `clvox.ops.caps.close_rim`; step: widths of a lattice step.
    """
    used, rows = np.unique(caps, return_inverse=True)
    faces = rows.reshape(-1, 3).astype(np.int32)
    # A buffer is not empty.
    ends = vertices[rim] if len(rim) else np.zeros((1, 2, 3), np.int32)
    return Rim(
        session.upload(ends),
        len(rim),
        upload_caps(session, vertices, caps, step),
        upload_facets(session, vertices[used], faces),
    )


def fill_winding(
    session: Session,
    facets: Mesh,
    rim: Rim,
    bits: int,
    shape: Shape,
    levels: tuple[Shape, ...],
    *,
    progress: Progress | None = None,
    list_bytes: int = LIST_BYTES,
) -> VoxelArrays:
    """Return the voxels whose generalised winding number is above a half, on *levels*.

    They have bricks where a triangle touches a cell or its voxels differ.  Lists take half of what
    the job of this thread has left, and at most *list_bytes*, unless one layer of cells takes more.
    """
    brick = BRICK if len(levels) == 1 else levels[-1]
    cells, thresholds = classify_cells(session, facets, rim, bits, shape, brick)
    arrays = _fill(session, facets, rim, bits, shape, cells, thresholds, progress, list_bytes)
    if len(levels) != 2:
        arrays = rebrick(session, arrays, levels)
    touched = mark_tree(session, facets, bits, shape, levels) if len(levels) > 1 else None
    return with_boundary(session, arrays, touched)


def classify_cells(
    session: Session, facets: Mesh, rim: Rim, bits: int, shape: Shape, brick: Shape
) -> tuple[Cells, cla.Array]:
    """Return which cells need a brick, and the threshold of each cell.

    They need one if a triangle touches them, or if they have no threshold: int16 per cell, the
    least sum of signs of crossings, with mesh and caps, that is inside, or `MIXED` if it is not the
    same throughout.
    """
    counts = cell_shape(shape, brick)
    above = None
    for power in range(max(counts).bit_length() - 1, 0, -1):
        large = cast("Shape", tuple(side << power for side in brick))
        blocks = cell_shape(shape, large)
        # The marks of blocks are of no use; those of cells are added to the touched ones.
        spare = session.zeros((blocks[2], blocks[1], words_for(blocks[0])), np.uint32)
        above = _classify(session, rim, bits, shape, large, above, spare)
    marks = mark_cells(session, facets, bits, shape, brick)
    thresholds = _classify(session, rim, bits, shape, brick, above, marks)
    return rank_cells(session, marks, counts, brick), thresholds


def _classify(
    session: Session,
    rim: Rim,
    bits: int,
    shape: Shape,
    side: Shape,
    above: cla.Array | None,
    marks: cla.Array,
) -> cla.Array:
    counts = cell_shape(shape, side)
    thresholds = session.empty(counts[::-1], np.int16)
    defines = {"STEP_BITS": bits, "MIXED": MIXED}
    kernel = session.kernel("winding/classify_cells.cl", "classify_cells", **defines)
    if above is None:
        blocks, factor, above = (1, 1, 1), 0, thresholds
    else:
        blocks, factor = cast("Shape", above.shape[::-1]), 2
    frame = int4(shape), int4(counts), int4(side), int4(blocks), np.int32(factor)
    cells = math.prod(counts)
    target = above, thresholds, marks
    steps = 1 + STEPS_PER_LOOK * (rim.edges > 0)
    session.run(kernel, cells, np.uint64(cells), *frame, *rim.caps.arguments, *target, steps=steps)
    return thresholds


def _fill(
    session: Session,
    facets: Mesh,
    rim: Rim,
    bits: int,
    shape: Shape,
    cells: Cells,
    thresholds: cla.Array,
    progress: Progress | None,
    list_bytes: int,
) -> VoxelArrays:
    file = "winding/fill_cells.cl"
    sides = dict(zip(("BRICK_X", "BRICK_Y", "BRICK_Z"), cells.brick, strict=True))
    defines = {"STEP_BITS": bits, "FRACTION_BITS": fraction_bits(bits), "MIXED": MIXED, **sides}
    owners = list_bricks(session, cells)
    inside = session.empty(cells.boundary.shape, np.uint32)
    bricks = session.empty((cells.count, cells.brick_words), np.uint32)
    counts, side = int4(cells.shape), cells.brick[2]
    curtain = np.uint32(rim.edges), rim.ends, *rim.caps.arguments
    triangles, job = facets.triangles, session.current_job
    if job is not None:
        # As much again is for the pool, which rounds, and for what sorting takes beside lists.
        list_bytes = min(list_bytes, job.left // 2)
    for rows in sorted_windows(session, facets, bits, Window.whole(shape, 1), list_bytes, side):
        caps = sort_crossings(session, rim.facets, bits, 1, rows.window)
        assert caps is not None
        first, stop = rows.window.first_u // side, -(-rows.window.stop_u // side)
        words = (stop - first) * cells.boundary.size // cells.shape[2]
        listed = rows.offsets, rows.crossings, caps.offsets, caps.crossings
        kernel = session.kernel(file, "fill_cells", **defines)
        where = np.uint64(words), np.int32(first), counts, rows.window.box
        target = thresholds, cells.boundary, inside
        session.run(kernel, words, *where, *listed, *target, steps=BITS)
        if bricks.size:
            kernel = session.kernel(file, "fill_bricks", **defines)
            items = np.uint64(bricks.size), int4(shape), counts, rows.window.box
            # Of the voxels of a word, few are so much in doubt that they look at all edges.
            work = BITS + (rim.edges > 0) * STEPS_PER_LOOK + STEPS_PER_ANGLE * rim.edges
            level = *listed, thresholds, owners
            session.run(kernel, bricks.size, *items, *curtain, *level, bricks, steps=work)
        if progress is not None:
            session.finish()
            progress(triangles * stop // cells.shape[2], triangles)
    return VoxelArrays(shape, bricks, cells, inside)
