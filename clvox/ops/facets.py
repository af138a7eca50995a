"""Work over the triangles of a mesh, balanced: what marking and casting share.

Triangles with few candidates are done where they are met.  The others are listed, their tiles
counted and the counts scanned; then each (triangle, tile) pair is one work-item.  Launches are
cut so that none takes long.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cached_property, partial
from typing import NamedTuple, TypeAlias

import numpy as np
import pyopencl.array as cla
from numpy.typing import NDArray

from clvox.device import Session
from clvox.device.session import Argument
from clvox.ops.scan import prefix_sum

Progress: TypeAlias = Callable[[int, int], object]
"""Called with the work done and the whole work; may raise, to cancel."""

RUN = 16
"""Triangles in a row that one work-item does, if they are small: neighbours share cells."""

TRIANGLES_PER_LAUNCH = 1 << 20
TILES_PER_LAUNCH = 1 << 16

_TILE_STEPS = 32
"""What counting the tiles of a triangle costs, more or less."""


class Facets(NamedTuple):
    """A mesh on the device, on the lattice.

    vertices: (3 n + 1,) int32, lattice steps, as `pad` leaves them; faces: (m, 3) int32.
    """

    vertices: cla.Array
    faces: cla.Array

    @property
    def triangles(self) -> int:
        """Number of triangles."""
        return int(self.faces.shape[0])

    @property
    def parts(self) -> int:
        """In how many parts it is visited: in one."""
        return 1

    def part(self, _: Session, number: int) -> Facets:
        """Return part *number*, which is all of it."""
        assert number == 0
        return self


class FacetChunks:
    """A mesh on the lattice that stays on the host and is sent to the device part by part.

    vertices: (n, 3) int32, lattice steps; faces: (m, 3) int32; most: triangles in a part;
    numbers: those of the triangles, (m,) uint32, if they are a part of a mesh.
    """

    def __init__(
        self,
        vertices: NDArray[np.int32],
        faces: NDArray[np.int32],
        most: int,
        numbers: NDArray[np.uint32] | None = None,
    ) -> None:
        self.vertices = vertices
        self.faces = faces
        self.most = most
        self._numbers = numbers

    @property
    def triangles(self) -> int:
        """Number of triangles."""
        return len(self.faces)

    @property
    def parts(self) -> int:
        """Number of parts."""
        return -(-self.triangles // self.most)

    def part(self, session: Session, number: int) -> Facets:
        """Return part *number*, on the device; its triangles share no vertices."""
        faces = self.faces[number * self.most : (number + 1) * self.most]
        corners = self.vertices[faces].reshape(-1, 3)
        return upload_facets(
            session, corners, np.arange(len(corners), dtype=np.int32).reshape(-1, 3)
        )

    def numbers_in(self, number: int) -> NDArray[np.uint32]:
        """Return the numbers of the triangles of part *number*, uint32."""
        first, last = number * self.most, min((number + 1) * self.most, self.triangles)
        if self._numbers is None:
            return np.arange(first, last, dtype=np.uint32)
        return self._numbers[first:last]

    def within(
        self, axes: list[int], low: NDArray[np.int64], high: NDArray[np.int64]
    ) -> FacetChunks:
        """The triangles whose boxes reach between *low* and *high*, both included, along *axes*."""
        lowest, highest = self.boxes
        reach = ((lowest[:, axes] <= high) & (highest[:, axes] >= low)).all(axis=1)
        numbers = np.flatnonzero(reach).astype(np.uint32)
        if self._numbers is not None:
            numbers = self._numbers[numbers]
        return FacetChunks(self.vertices, self.faces[reach], self.most, numbers)

    @cached_property
    def boxes(self) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """Lowest and highest corner of each triangle's box; (m, 3) each."""
        a, b, c = (self.vertices[self.faces[:, corner]] for corner in range(3))
        return np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)


Mesh: TypeAlias = Facets | FacetChunks
"""What is visited: a mesh on the device, or one that is sent there part by part."""


def upload_facets(
    session: Session, vertices: NDArray[np.int32], faces: NDArray[np.int32]
) -> Facets:
    """Return the mesh on the device."""
    return Facets(session.upload(pad(vertices)), session.upload(faces))


def pad(vertices: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the coordinates of *vertices*, (n, 3), in a row and one number more, (3 n + 1,).

    So kernels load a corner as four numbers at once, whichever it is.  What `Lattice.snap` made
    is not copied.
    """
    row = vertices.base
    if (
        isinstance(row, np.ndarray)
        and row.shape == (vertices.size + 1,)
        and row.dtype == vertices.dtype
        and vertices.flags.c_contiguous
        and row.ctypes.data == vertices.ctypes.data
    ):
        return row
    return np.append(vertices, np.int32(0))


def visit_facets(
    session: Session,
    file: str,
    verb: str,
    facets: Mesh,
    space: np.generic,
    sink: tuple[Argument, ...],
    defines: dict[str, int],
    progress: Progress | None = None,
    *,
    tiled: dict[str, int] | None = None,
) -> int:
    """Run the kernels `verb`_direct, count_tiles and `verb`_tiles of *file* over all triangles.

    Parameters
    ----------
    space : int4
        The first and the last ray, or the number of cells along each axis.
    sink : tuple
        What the kernels take after the mesh: their outputs, above all.
    defines : dict
        What they are built with; RUN among it, if it is to be another.
    tiled : dict, optional
        What the kernels for tiles are built with instead, where that differs.
    progress : callable, optional
        Told of triangles done; with it, each launch is waited for.

    Returns
    -------
    int
        The triangles without area, if the kernel `verb`_direct counts them.
    """
    count, start, flat = facets.triangles, 0, 0
    for number in range(facets.parts):
        part = facets.part(session, number)
        size = part.triangles
        told = None if progress is None else partial(_tell_part, progress, start, count)
        flat += _visit_part(session, file, verb, part, space, sink, defines, tiled or {}, told)
        start += size
        # Before the next part takes memory.
        del part
    return flat


def _tell_part(progress: Progress, start: int, count: int, done: int, _: int) -> None:
    """Tell of the triangles of a part, which begin at *start*, as of the whole."""
    progress(start + done, count)


def _visit_part(
    session: Session,
    file: str,
    verb: str,
    facets: Facets,
    space: np.generic,
    sink: tuple[Argument, ...],
    defines: dict[str, int],
    tiled: dict[str, int],
    progress: Progress | None,
) -> int:
    vertices, faces = facets
    count = faces.shape[0]
    if count == 0:
        return 0
    defines = {"RUN": RUN} | defines
    listed = session.zeros(2, np.uint32)
    entries = session.empty(count, np.uint32)
    direct = session.kernel(file, f"{verb}_direct", **defines)
    for first, last in _launches(count, TRIANGLES_PER_LAUNCH):
        session.run(
            direct,
            -(-(last - first) // defines["RUN"]),
            *(np.uint64(first), np.uint64(last), space, faces, vertices, listed, entries),
            *sink,
        )
        if progress is not None:
            session.finish()
            progress(last, count)
    large, flat = listed.get()
    if large == 0:
        return int(flat)
    tiles = session.empty(int(large), np.uint32)
    defines = defines | tiled
    count_tiles = session.kernel(file, "count_tiles", **defines)
    mesh = faces, vertices, entries
    session.run(count_tiles, int(large), large, space, *mesh, tiles, steps=_TILE_STEPS)
    offsets, pairs = prefix_sum(session, tiles, bits=64)
    kernel = session.kernel(file, f"{verb}_tiles", **defines)
    for first, last in _launches(pairs, TILES_PER_LAUNCH):
        span = np.uint64(first), np.uint64(last)
        session.run(
            kernel, last - first, *span, large, space, faces, vertices, entries, offsets, *sink
        )
        if progress is not None:
            session.finish()
            progress(count, count)
    return int(flat)


def _launches(count: int, most: int) -> Iterator[tuple[int, int]]:
    """Cut [0, count) into spans of at most *most*."""
    for first in range(0, count, most):
        yield first, min(first + most, count)
