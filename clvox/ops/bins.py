"""The triangles that each tile of rays may meet: `cl_kernels/lists/bin_triangles.cl`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pyopencl.array as cla

from clvox.device import Session
from clvox.ops.crossings import Window, near
from clvox.ops.facets import FacetChunks, Facets, Mesh, visit_facets
from clvox.ops.scan import prefix_sum

DIRECT = 16
"""Most tiles of a triangle that one work-item does alone."""

_FILE = "lists/bin_triangles.cl"

_BYTES_PER_TILE = 16
_BYTES_PER_PAIR = 5
"""Counts and starts, and numbers of triangles; and what the pool rounds."""


class Bins(NamedTuple):
    """Triangles of one part of a mesh, by the tiles of a window of rays.

    facets: the part.  numbers: uint32, of its triangles in the mesh, if not their places.
    starts: (tiles + 1,) uint64, where the triangles of each tile begin; tiles are numbered as rays
    are.  triangles: uint32, in no particular order within a tile.
    first, last: whether this is the first, and the last, part that the window's rays may meet.
    """

    window: Window
    facets: Facets
    numbers: cla.Array | None
    starts: cla.Array
    triangles: cla.Array
    first: bool
    last: bool


@dataclass(frozen=True)
class Binner:
    """How a mesh's triangles are binned by tiles of *tile* rays, along u and v.

    direct: most tiles of a triangle that one work-item does.  room: bytes that the bins of a
    window may take, if it has more than one tile.
    """

    session: Session
    mesh: Mesh
    bits: int
    axis: int
    tile: tuple[int, int]
    direct: int = DIRECT
    room: int | None = None

    def visit(self, window: Window, do: Callable[[Bins], None]) -> None:
        """Call *do* with the bins of windows that together are *window*.

        They are cut between tiles, so that there is room for their bins.  The parts of a mesh come
        one after the other; a window that no part is near has an empty one.
        """
        if self._has_room(window, 0) and self._visit_whole(window, do):
            return
        for half in _halves(window, self.tile):
            self.visit(half, do)

    def _visit_whole(self, window: Window, do: Callable[[Bins], None]) -> bool:
        """Visit the window in one piece, or return False if there is no room."""
        mesh = near(self.mesh, self.bits, self.axis, window)
        if isinstance(mesh, FacetChunks):
            return self._visit_parts(window, mesh, do)
        counts, starts, pairs = self._count(window, mesh)
        if not self._has_room(window, pairs):
            return False
        triangles = self._write(window, mesh, counts, starts, pairs)
        del counts
        do(Bins(window, mesh, None, starts, triangles, first=True, last=True))
        return True

    def _visit_parts(self, window: Window, mesh: FacetChunks, do: Callable[[Bins], None]) -> bool:
        pairs = self._most_pairs(window, mesh)
        if not self._has_room(window, pairs):
            return False
        parts = max(mesh.parts, 1)
        for number in range(parts):
            part = mesh.part(self.session, number)
            numbers = self.session.upload(mesh.numbers_in(number))
            counts, starts, pairs = self._count(window, part)
            triangles = self._write(window, part, counts, starts, pairs)
            del counts
            ends = number == 0, number == parts - 1
            do(Bins(window, part, numbers, starts, triangles, *ends))
            # Before the next part takes memory.
            del part, numbers, starts, triangles
        return True

    def _has_room(self, window: Window, pairs: int) -> bool:
        tiles = _tiles(window, self.tile)
        needed = _BYTES_PER_TILE * (tiles + 1) + _BYTES_PER_PAIR * pairs
        return self.room is None or tiles == 1 or needed <= self.room

    def _most_pairs(self, window: Window, mesh: FacetChunks) -> int:
        """Most triangles, each as often as it has tiles, that a part has."""
        low, high = (corners.astype(np.int64) for corners in mesh.boxes)
        counts = np.ones(mesh.triangles, np.int64)
        spans = zip((1, 2), window[:2], window[2:], self.tile, strict=True)
        for place, first, stop, side in spans:
            axis = (self.axis + place) % 3
            lowest = np.clip(-(-low[:, axis] >> self.bits), first, stop - 1)
            highest = np.clip(high[:, axis] >> self.bits, first, stop - 1)
            lowest, highest = (lowest - first) // side, (highest - first) // side
            counts *= np.maximum(highest - lowest + 1, 0)
        if not len(counts):
            return 0
        return int(np.add.reduceat(counts, np.arange(0, len(counts), mesh.most)).max())

    def _count(self, window: Window, facets: Facets) -> tuple[cla.Array, cla.Array, int]:
        """Triangles of each tile, where they begin, and how many there are in all."""
        counts = self.session.zeros(_tiles(window, self.tile) + 1, np.uint32)
        self._run(window, facets, 0, counts)
        starts, pairs = prefix_sum(self.session, counts, bits=64)
        return counts, starts, pairs

    def _write(
        self, window: Window, facets: Facets, counts: cla.Array, starts: cla.Array, pairs: int
    ) -> cla.Array:
        triangles = self.session.empty(pairs, np.uint32)
        if pairs:
            self._run(window, facets, 1, starts, counts, triangles)
        return triangles

    def _run(self, window: Window, facets: Facets, number: int, *sink: cla.Array) -> None:
        defines = {"AXIS": self.axis, "STEP_BITS": self.bits}
        defines |= dict(zip(("SIDE_U", "SIDE_V"), self.tile, strict=True))
        defines |= {"DIRECT": self.direct, "PASS": number}
        visit_facets(self.session, _FILE, "bin", facets, window.box, sink, defines)


def _tiles(window: Window, tile: tuple[int, int]) -> int:
    """How many tiles of *tile* rays a window has."""
    (along_u, along_v), (side_u, side_v) = window.sides, tile
    return -(-along_u // side_u) * -(-along_v // side_v)


def _halves(window: Window, tile: tuple[int, int]) -> tuple[Window, Window]:
    """The window cut in two between tiles, across the side that has more of them."""
    along_u, along_v = (-(-count // side) for count, side in zip(window.sides, tile, strict=True))
    if along_u >= along_v:
        middle = window.first_u + along_u // 2 * tile[0]
        return window._replace(stop_u=middle), window._replace(first_u=middle)
    middle = window.first_v + along_v // 2 * tile[1]
    return window._replace(stop_v=middle), window._replace(first_v=middle)
