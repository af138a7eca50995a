"""Crossings of parallel rays with a mesh, into one of several sinks: `cl_kernels/crossings`."""

from __future__ import annotations

import numpy as np
import pyopencl.array as cla

from clvox.device import Session
from clvox.grid import Shape
from clvox.ops.facets import Facets, Progress, visit_facets
from clvox.ops.layout import Bricks, Cells, int2, int4

_FILE = "crossings/cast_rays.cl"
_COUNT, _DENSE, _BRICKS = 0, 1, 2

DIRECT = 256
"""Most candidate rays of a triangle that one work-item does alone."""

TILE = 32
"""Side of a tile of rays."""


def count_crossings(
    session: Session,
    facets: Facets,
    bits: int,
    shape: Shape,
    axis: int,
    *,
    direct: int = DIRECT,
    tile: int = TILE,
) -> cla.Array:
    """Return how many triangles each ray along *axis* crosses.

    shape: voxels (nx, ny, nz).  The result is uint32, of the grid's array shape without *axis*.
    """
    rays_u, rays_v = shape[(axis + 1) % 3], shape[(axis + 2) % 3]
    counts = session.zeros((rays_u, rays_v) if axis == 1 else (rays_v, rays_u), np.uint32)
    defines = {"AXIS": axis, "STEP_BITS": bits, "SINK": _COUNT, "DIRECT": direct, "TILE": tile}
    rays = int2(rays_u, rays_v)
    visit_facets(session, _FILE, "cast", facets, rays, (counts,), defines)
    return counts


def flip_dense(
    session: Session,
    facets: Facets,
    bits: int,
    shape: Shape,
    voxels: cla.Array,
    beyond: cla.Array,
    *,
    progress: Progress | None = None,
    direct: int = DIRECT,
    tile: int = TILE,
) -> None:
    """Flip, for each crossing of a ray along y, the bit of the first voxel after it.

    voxels: (nz, ny, words) uint32, rows of bits.
    beyond: (nz, words) uint32, flipped for crossings past the last sample.
    """
    nx, ny, nz = shape
    defines = {"AXIS": 1, "STEP_BITS": bits, "SINK": _DENSE, "DIRECT": direct, "TILE": tile}
    sink = np.int32(ny), voxels, beyond
    rays = int2(nz, nx)
    visit_facets(session, _FILE, "cast", facets, rays, sink, defines, progress)


def flip_bricks(
    session: Session,
    facets: Facets,
    bits: int,
    cells: Cells,
    bricks: Bricks,
    *,
    progress: Progress | None = None,
    direct: int = DIRECT,
    tile: int = TILE,
) -> None:
    """Flip, for each crossing of a ray along y, the bit of the first voxel after it, in a brick.

    Crossings that no brick can hold go to `bricks.entry`, `bricks.beyond` and `bricks.exits`.
    Rays of the padding are cast like all others.
    """
    last = cells.last
    defines = {"AXIS": 1, "STEP_BITS": bits, "SINK": _BRICKS, "DIRECT": direct, "TILE": tile}
    columns = int4(last.shape), *cells.tree
    sink = *columns, bricks.voxels, bricks.exits, bricks.entry, bricks.beyond
    rays = int2(last.shape[2] * last.brick[2], last.shape[0] * last.brick[0])
    visit_facets(session, _FILE, "cast", facets, rays, sink, defines | cells.defines, progress)
