"""Caps over the holes of a mesh, and the tree in which kernels find them: `winding/caps.h`."""

from __future__ import annotations

from typing import NamedTuple, cast

import numpy as np
import pyopencl.array as cla
from numpy.typing import NDArray
from pyopencl import cltypes

from clvox.device import Session
from clvox.device.session import Argument
from clvox.grid import Triple

_MORTON_BITS = 10


class Caps(NamedTuple):
    """The caps of a mesh on the device, in a tree.

    nodes: their number; scale: a kernel's argument, the widths of a lattice step; the arrays are
    those of `winding/caps.h`.
    """

    nodes: int
    scale: np.generic
    places: cla.Array
    moments: cla.Array
    corners: cla.Array

    @property
    def arguments(self) -> tuple[Argument, ...]:
        """CAPS_PARAMETERS of `winding/caps.h`."""
        return np.int32(self.nodes), self.scale, self.places, self.moments, self.corners


def close_rim(rim: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return triangles that close a mesh.

    Each closed line of the rim is halved again and again: every two edges that follow each other
    get a triangle, whose third edge takes their place.  So there are about as many triangles as
    edges, small ones along the rim and large ones amidst the hole.

    Parameters
    ----------
    rim : (n, 2) int32
        Edges that begin and end equally often at each vertex, as the triangles run along them.

    Returns
    -------
    (m, 3) int32
        They use the vertices of the rim, and run along it the other way.
    """
    line, counts = _closed_lines(rim)
    found = [np.empty((0, 3), np.int32)]
    while len(counts):
        # A line of three vertices is one triangle; longer ones keep every other vertex.
        starts = np.cumsum(counts) - counts
        place = np.arange(len(line)) - np.repeat(starts, counts)
        count = np.repeat(counts, counts)
        odd = np.flatnonzero((place % 2 == 1) & ((place < count - 1) | (count > 3)))
        # The one after the last is the first.
        after = np.where(place[odd] + 1 < count[odd], odd + 1, odd + 1 - count[odd])
        found.append(np.stack([line[odd - 1], line[after], line[odd]], axis=1))
        kept = np.ones(len(line), np.bool_)
        kept[odd] = False
        counts = counts - np.bincount(
            np.searchsorted(starts, odd, side="right") - 1, minlength=len(counts)
        )
        going = counts > 2
        line = line[kept & np.repeat(going, np.diff([*starts, len(kept)]))]
        counts = counts[going]
    return np.concatenate(found)


def _closed_lines(rim: NDArray[np.int32]) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Closed lines that use each edge once and no vertex twice: their vertices, and counts."""
    after: dict[int, list[int]] = {}
    for start, end in rim.tolist():
        after.setdefault(start, []).append(end)
    vertices: list[int] = []
    counts: list[int] = []
    for start in after:
        path, places = [start], {start: 0}
        while ends := after[path[-1]]:
            end = ends.pop()
            if end in places:
                first = places[end]
                vertices += path[first:]
                counts.append(len(path) - first)
                for vertex in path[first + 1 :]:
                    del places[vertex]
                del path[first + 1 :]
            else:
                places[end] = len(path)
                path.append(end)
    return np.array(vertices, dtype=np.int32), np.array(counts, dtype=np.int64)


def upload_caps(
    session: Session, vertices: NDArray[np.int32], faces: NDArray[np.int32], step: Triple
) -> Caps:
    """Return triangles of lattice positions in a tree on the device; step: widths of a step."""
    widths = np.array(step) / max(step)
    scale = cast("np.generic", np.array((*widths, 0.0), cltypes.float4)[()])
    corners = vertices[faces]
    a, b, c = (corners[:, corner].astype(np.int64) for corner in range(3))
    # Differences are below 2**25, so this is exact; triangles without area wind around nothing.
    corners = corners[np.cross(b - a, c - a).any(axis=1)]
    if not len(corners):
        # A buffer is not empty.
        empty = np.zeros((1, 5), np.int32), np.zeros((1, 5), np.float32)
        places, moments, corners = *empty, np.zeros((1, 3, 3), np.int32)
        return Caps(0, scale, *map(session.upload, (places, moments, corners)))
    corners = corners[_along_a_curve(corners)]
    places, moments = _plant(corners, widths)
    return Caps(len(places), scale, *map(session.upload, (places, moments, corners)))


def _along_a_curve(corners: NDArray[np.int32]) -> NDArray[np.intp]:
    """An order in which triangles that follow each other are near each other: Morton's."""
    centres = corners.astype(np.int64).sum(axis=1)
    low = centres.min(axis=0)
    width = int((centres.max(axis=0) - low).max()) + 1
    cells = ((centres - low) << _MORTON_BITS) // width
    keys = np.zeros(len(cells), np.int64)
    for bit in range(_MORTON_BITS):
        for axis in range(3):
            keys |= (cells[:, axis] >> bit & 1) << (3 * bit + axis)
    return np.argsort(keys, kind="stable")


def _plant(
    corners: NDArray[np.int32], widths: NDArray[np.float64]
) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """The tree over triangles, neighbours of which are joined; arrays of `winding/caps.h`."""
    levels = [_leaves(corners, widths)]
    while len(levels[-1].sizes) > 1:
        levels.append(_join(levels[-1], widths))
    nodes = int(levels[-1].sizes[0])
    places, moments = np.empty((nodes, 5), np.int32), np.empty((nodes, 5), np.float32)
    at = np.zeros(1, np.int64)
    for below, level in zip([*levels[-2::-1], None], levels[::-1], strict=True):
        places[at, :3] = level.centres
        places[at, 3] = at + level.sizes
        places[at, 4] = level.triangles
        moments[at, :3] = level.vectors
        # Rounded up, since they are bounds.
        moments[at, 3:] = np.nextafter(level.bounds.astype(np.float32), np.float32(np.inf))
        if below is not None:
            at = _children(at, below)
    return places, moments


class _Level(NamedTuple):
    """Nodes of a tree: centres (n, 3) on the lattice, what is below them, and what they hold.

    sizes: nodes from each one down; triangles: of leaves, else -1; vectors, bounds: the sums of
    vector areas, and of areas, and the radius.
    """

    centres: NDArray[np.int64]
    sizes: NDArray[np.int64]
    triangles: NDArray[np.int64]
    vectors: NDArray[np.float64]
    bounds: NDArray[np.float64]


def _leaves(corners: NDArray[np.int32], widths: NDArray[np.float64]) -> _Level:
    count = len(corners)
    whole = corners.astype(np.int64)
    centres = (whole.min(axis=1) + whole.max(axis=1)) // 2
    a, b, c = (corners[:, corner] * widths for corner in range(3))
    vectors = np.cross(b - a, c - a) / 2
    reach = np.linalg.norm((whole - centres[:, None]) * widths, axis=2).max(axis=1)
    bounds = np.stack([np.linalg.norm(vectors, axis=1), reach], axis=1)
    return _Level(centres, np.ones(count, np.int64), np.arange(count), vectors, bounds)


def _join(level: _Level, widths: NDArray[np.float64]) -> _Level:
    """The nodes above: two by two, and the last one alone, itself, if their number is odd."""
    count = len(level.sizes)
    first, second = np.arange(0, count - 1, 2), np.arange(1, count, 2)
    centres = (level.centres[first] + level.centres[second]) // 2
    reach = [
        np.linalg.norm((level.centres[some] - centres) * widths, axis=1) + level.bounds[some, 1]
        for some in (first, second)
    ]
    areas = level.bounds[first, 0] + level.bounds[second, 0]
    joined = _Level(
        centres,
        1 + level.sizes[first] + level.sizes[second],
        np.full(len(first), -1),
        level.vectors[first] + level.vectors[second],
        np.stack([areas, np.maximum(*reach)], axis=1),
    )
    left = slice(count - count % 2, None)
    return _Level(
        *(np.concatenate([own, old[left]]) for own, old in zip(joined, level, strict=True))
    )


def _children(at: NDArray[np.int64], below: _Level) -> NDArray[np.int64]:
    """Where the nodes *below* are, in preorder, those above being *at*."""
    places = np.empty(len(below.sizes), np.int64)
    pairs = len(places) // 2
    places[0 : 2 * pairs : 2] = at[:pairs] + 1
    places[1 : 2 * pairs : 2] = at[:pairs] + 1 + below.sizes[0 : 2 * pairs : 2]
    places[2 * pairs :] = at[pairs:]
    return places
