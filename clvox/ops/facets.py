"""Work over the triangles of a mesh, balanced: what marking and casting share.

Triangles with few candidates are done where they are met.  The others are listed, their tiles
counted and the counts scanned; then each (triangle, tile) pair is one work-item.  Launches are
cut so that none takes long.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
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

TRIANGLES_PER_LAUNCH = 1 << 19
TILES_PER_LAUNCH = 1 << 16


class Facets(NamedTuple):
    """A mesh on the device, on the lattice.

    vertices: (n, 3) int32, lattice steps; faces: (m, 3) int32.
    """

    vertices: cla.Array
    faces: cla.Array


def upload_facets(
    session: Session, vertices: NDArray[np.int32], faces: NDArray[np.int32]
) -> Facets:
    """Return the mesh on the device."""
    return Facets(session.upload(vertices), session.upload(faces))


def visit_facets(
    session: Session,
    file: str,
    verb: str,
    facets: Facets,
    space: np.generic,
    sink: tuple[Argument, ...],
    defines: dict[str, int],
    progress: Progress | None = None,
) -> None:
    """Run the kernels `verb`_direct, count_tiles and `verb`_tiles of *file* over all triangles.

    Parameters
    ----------
    space : int2 or int4
        The number of rays, or of cells, along each axis.
    sink : tuple
        What the kernels take after the mesh: their outputs, above all.
    defines : dict
        What they are built with.
    progress : callable, optional
        Told of triangles done; with it, each launch is waited for.
    """
    vertices, faces = facets
    count = faces.shape[0]
    if count == 0:
        return
    defines = defines | {"RUN": RUN}
    listed = session.zeros(1, np.uint32)
    entries = session.empty(count, np.uint32)
    direct = session.kernel(file, f"{verb}_direct", **defines, EDGE_BITS=32)
    for first, last in _launches(count, TRIANGLES_PER_LAUNCH):
        session.run(
            direct,
            -(-(last - first) // RUN),
            *(np.uint64(first), np.uint64(last), space, faces, vertices, listed, entries),
            *sink,
        )
        if progress is not None:
            session.finish()
            progress(last, count)
    large = listed.get()[0]
    if large == 0:
        return
    tiles = session.empty(int(large), np.uint32)
    count_tiles = session.kernel(file, "count_tiles", **defines, EDGE_BITS=64)
    session.run(count_tiles, int(large), large, space, faces, vertices, entries, tiles)
    offsets, pairs = prefix_sum(session, tiles, bits=64)
    tiled = session.kernel(file, f"{verb}_tiles", **defines, EDGE_BITS=64)
    for first, last in _launches(pairs, TILES_PER_LAUNCH):
        span = np.uint64(first), np.uint64(last)
        session.run(
            tiled, last - first, *span, large, space, faces, vertices, entries, offsets, *sink
        )
        if progress is not None:
            session.finish()
            progress(count, count)


def _launches(count: int, most: int) -> Iterator[tuple[int, int]]:
    """Cut [0, count) into spans of at most *most*."""
    for first in range(0, count, most):
        yield first, min(first + most, count)
