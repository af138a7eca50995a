"""Which cells, or voxels, some triangle touches: `cl_kernels/boundary`."""

from __future__ import annotations

import numpy as np
import pyopencl.array as cla

from clvox.device import Session
from clvox.grid import Shape
from clvox.ops.facets import Facets, Mesh, Progress, visit_facets
from clvox.ops.layout import Cells, cell_shape, int4, words_for

_FILE = "boundary/mark_cells.cl"
_CELLS, _VOXELS = 0, 1
_FLAT_RUN = 256

DIRECT = 64
"""Most columns of cells of a triangle that one work-item does alone, within one layer of cells; as
many as a block has, and with fewer there are no blocks."""

TILE = 16
"""A tile has about as many touched columns as a square of that side."""


def mark_cells(
    session: Session,
    facets: Mesh,
    bits: int,
    shape: Shape,
    brick: Shape,
    marks: cla.Array | None = None,
    *,
    progress: Progress | None = None,
    direct: int = DIRECT,
    tile: int = TILE,
) -> cla.Array:
    """Return a bit for each cell of *brick* voxels that says whether a triangle touches it.

    The result is (Nz, Ny, words) uint32, bits along x: *marks*, if given, added to.
    """
    space = session, facets, bits, shape, brick
    return mark_and_count(*space, marks, progress=progress, direct=direct, tile=tile)[0]


def mark_and_count(
    session: Session,
    facets: Mesh,
    bits: int,
    shape: Shape,
    brick: Shape,
    marks: cla.Array | None = None,
    *,
    progress: Progress | None = None,
    direct: int = DIRECT,
    tile: int = TILE,
) -> tuple[cla.Array, int]:
    """Return what `mark_cells` does, and the number of triangles without area on the lattice."""
    cells = cell_shape(shape, brick)
    if marks is None:
        marks = session.zeros((cells[2], cells[1], words_for(cells[0])), np.uint32)
    defines = _defines(bits, brick, _CELLS, direct, tile)
    if session.device.atomic_loads:
        defines["ATOMIC_LOADS"] = 1
    flat = visit_facets(session, _FILE, "mark", facets, int4(cells), (marks,), defines, progress)
    return marks, flat


def mark_voxels(
    session: Session,
    facets: Mesh,
    bits: int,
    shape: Shape,
    cells: Cells,
    marks: cla.Array | None = None,
    *,
    side: Shape = (1, 1, 1),
    progress: Progress | None = None,
    direct: int = DIRECT,
    tile: int = TILE,
) -> cla.Array:
    """Return a bit for each voxel of each brick that says whether a triangle touches it.

    The result is laid out like the bricks below the tree *cells*; bits of the padding are zero.
    It is *marks*, if given, added to.  With *side*, the bricks hold cells of so many voxels
    instead of voxels, and *shape* is the number of those cells.
    """
    last = cells.last
    if marks is None:
        marks = session.zeros((last.count, last.brick_words), np.uint32)
    defines = _defines(bits, side, _VOXELS, direct, tile) | cells.defines
    sink = *cells.tree, marks
    visit_facets(session, _FILE, "mark", facets, int4(shape), sink, defines, progress)
    return marks


def _defines(bits: int, cell: Shape, sink: int, direct: int, tile: int) -> dict[str, int]:
    sides = dict(zip(("CELL_X", "CELL_Y", "CELL_Z"), cell, strict=True))
    return {"STEP_BITS": bits, "SINK": sink, "DIRECT": direct, "TILE": tile, **sides}


def count_flat(session: Session, facets: Mesh) -> int:
    """Return the number of triangles without area on the lattice."""
    return sum(_count_flat(session, facets.part(session, n)) for n in range(facets.parts))


def _count_flat(session: Session, facets: Facets) -> int:
    count = facets.triangles
    if count == 0:
        return 0
    parts = -(-count // _FLAT_RUN)
    counts = session.empty(parts, np.uint32)
    kernel = session.kernel("boundary/count_flat.cl", "count_flat", RUN=_FLAT_RUN)
    mesh = facets.faces, facets.vertices
    session.run(kernel, parts, np.uint64(count), *mesh, counts, steps=_FLAT_RUN)
    return int(counts.get().sum(dtype=np.uint64))
