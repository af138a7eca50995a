"""Crossings of parallel rays with a mesh, into one of several sinks: `cl_kernels/crossings`."""

from __future__ import annotations

from typing import NamedTuple, cast

import numpy as np
import pyopencl.array as cla
from pyopencl import cltypes

from clvox.device import Session
from clvox.device.session import Argument
from clvox.grid import Shape
from clvox.ops.facets import Facets, Mesh, Progress, visit_facets
from clvox.ops.layout import Bricks, Cells, Slab, words_for

_FILE = "crossings/cast_rays.cl"
_COUNT, _DENSE, _BRICKS, _EMIT = 0, 1, 2, 3

DIRECT = 256
"""Most candidate rays of a triangle that one work-item does alone."""

FEW = 32
"""Most candidate rays of a sliver that one work-item does alone."""

WIDE = 8
"""From so many rays a triangle on, one work-item solves for rays, and does four times as many."""

WIDE_RUN = 4
"""Triangles in a row that one work-item does then."""

MOST_DIRECT = 1 << 14
"""More candidate rays no triangle may have that one work-item does alone, in 32 bits."""

TILE = 32
"""A tile has about as many crossings as a square of that side."""


def fraction_bits(bits: int) -> int:
    """Binary places of a stored depth on a lattice of 2**bits steps in a voxel.

    A mesh spans at most 2**(24 - bits) voxels, so that depths fit 32 bits.
    """
    return min(18, bits + 7)


class Window(NamedTuple):
    """The rays (u, v) with first <= u < stop, and v alike; (y, z), (z, x), (x, y) along x, y, z."""

    first_u: int
    first_v: int
    stop_u: int
    stop_v: int

    @classmethod
    def whole(cls, shape: Shape, axis: int) -> Window:
        """All rays along *axis* of a grid of *shape* voxels."""
        return cls(0, 0, shape[(axis + 1) % 3], shape[(axis + 2) % 3])

    @classmethod
    def of_slab(cls, cells: Cells, slab: Slab) -> Window:
        """All rays along y of a slab of the tree *cells*, those of the padding included."""
        last = cells.last
        side = last.brick[2]
        stop = (slab.first_layer + slab.layers) * side
        return cls(slab.first_layer * side, 0, stop, last.padded[0])

    @property
    def sides(self) -> tuple[int, int]:
        """Rays along u and v."""
        return self.stop_u - self.first_u, self.stop_v - self.first_v

    @property
    def rays(self) -> int:
        """Number of rays."""
        along_u, along_v = self.sides
        return along_u * along_v

    @property
    def box(self) -> np.generic:
        """The first and the last ray, as a kernel takes them."""
        corners = self.first_u, self.first_v, self.stop_u - 1, self.stop_v - 1
        return cast("np.generic", np.array(corners, cltypes.int4)[()])

    def halves(self) -> tuple[Window, ...]:
        """Two parts, cut across u, or across v if the window is one ray wide; of one ray none."""
        if self.rays == 1:
            return ()
        if self.sides[0] > 1:
            middle = (self.first_u + self.stop_u) // 2
            return self._replace(stop_u=middle), self._replace(first_u=middle)
        middle = (self.first_v + self.stop_v) // 2
        return self._replace(stop_v=middle), self._replace(first_v=middle)

    def layers(self, depth: int) -> tuple[Window, ...]:
        """The window cut in two across u, where *depth* divides it; nothing if that is nowhere."""
        count = -(-self.sides[0] // depth)
        if count == 1:
            return ()
        middle = self.first_u + count // 2 * depth
        return self._replace(stop_u=middle), self._replace(first_u=middle)


def near(facets: Mesh, bits: int, axis: int, window: Window) -> Mesh:
    """The triangles that the rays of *window* may cross: all, if they are on the device anyway."""
    if isinstance(facets, Facets):
        return facets
    corners = np.array([window[:2], np.subtract(window[2:], 1)], dtype=np.int64) << bits
    return facets.within([(axis + 1) % 3, (axis + 2) % 3], corners[0], corners[1])


def count_crossings(
    session: Session,
    facets: Mesh,
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
    window = Window.whole(shape, axis)
    rays_u, rays_v = window.sides
    counts = session.zeros((rays_u, rays_v) if axis == 1 else (rays_v, rays_u), np.uint32)
    add_counts(session, facets, bits, axis, window, counts, direct=direct, tile=tile)
    return counts


def add_counts(
    session: Session,
    facets: Mesh,
    bits: int,
    axis: int,
    window: Window,
    counts: cla.Array,
    *,
    direct: int = DIRECT,
    tile: int = TILE,
) -> None:
    """Add to *counts*, uint32, how many triangles each ray of *window* crosses.

    Rays are numbered along x before y before z.
    """
    defines = _defines(axis, bits, _COUNT, direct, tile)
    _cast(session, facets, window, (counts,), defines)


def emit_crossings(
    session: Session,
    facets: Mesh,
    bits: int,
    axis: int,
    window: Window,
    offsets: cla.Array,
    counts: cla.Array,
    rows: cla.Array,
    *,
    direct: int = DIRECT,
    tile: int = TILE,
) -> None:
    """Write the crossings of each ray of *window* to its row, in no particular order.

    offsets: (rays + 1,) uint64, where the rows begin; counts: as from `add_counts`, zero on return;
    rows: int64, crossings as `clvox.ops.lists.Rows` describes them.
    """
    defines = _defines(axis, bits, _EMIT, direct, tile)
    defines["FRACTION_BITS"] = fraction_bits(bits)
    _cast(session, facets, window, (offsets, counts, rows), defines)


def flip_dense(
    session: Session,
    facets: Mesh,
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
    nx, ny, _ = shape
    defines = _defines(1, bits, _DENSE, direct, tile)
    sink = np.int32(ny), np.int32(words_for(nx)), voxels, beyond
    window = Window.whole(shape, 1)
    _cast(session, facets, window, sink, defines, progress)


def flip_bricks(
    session: Session,
    facets: Mesh,
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
    defines = _defines(1, bits, _BRICKS, direct, tile)
    window = Window.of_slab(cells, bricks.slab)
    facets, sink = near(facets, bits, 1, window), bricks.sink(cells)
    defines |= cells.defines
    _cast(session, facets, window, sink, defines, progress)


def _defines(axis: int, bits: int, sink: int, direct: int, tile: int) -> dict[str, int]:
    rays = {"AXIS": axis, "STEP_BITS": bits, "SINK": sink}
    return rays | {"DIRECT": direct, "FEW": FEW, "TILE": tile, "EDGE_BITS": 32}


def _cast(
    session: Session,
    facets: Mesh,
    window: Window,
    sink: tuple[Argument, ...],
    defines: dict[str, int],
    progress: Progress | None = None,
) -> None:
    """Triangles done directly have edge functions of 32 bits, those in tiles of 64."""
    wide = window.rays >= WIDE * facets.triangles
    defines["WIDE"] = int(wide)
    if wide:
        defines["DIRECT"] = min(4 * defines["DIRECT"], MOST_DIRECT)
        defines["RUN"] = WIDE_RUN
    tiled = {"EDGE_BITS": 64, "WIDE": 1}
    visit_facets(session, _FILE, "cast", facets, window.box, sink, defines, progress, tiled=tiled)
