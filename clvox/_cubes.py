"""Cubes of eight samples -> vertices and triangles: what scikit-image makes of each, copied.

A *cube* is eight neighbouring samples; on samples of 0 and 1 its triangles depend on those eight
bits alone.  So scikit-image is asked once about each of the 256 cubes, and the answers are copied
to wherever such a cube occurs.  Only cubes that are not all in or all out are listed.  Each edge
between two samples belongs to the cube at whose lowest corner it starts: a vertex is made once,
and no two have to be joined.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray
from skimage.measure import marching_cubes

from clvox._blocks import in_halves
from clvox.grid import Grid, Shape

Mesh: TypeAlias = tuple[NDArray[np.float64], NDArray[np.int64]]
"""Vertices, (n, 3), and triangles, (m, 3)."""

Box: TypeAlias = tuple[tuple[int, int], tuple[int, int], tuple[int, int]]
"""From and to of cubes along x, y and z.  Cube c lies between voxels c - 1 and c."""

LEVEL = 0.55
"""Where scikit-image cuts samples of 0 and 1.

A square of samples that is in on one diagonal and out on the other has one half in its middle.
Above one half the middle is out, whichever cube looks at it: the solid is 6-connected, and
neighbours agree.  At one half the tests tie.  Any level between 0.5 and 1 gives these triangles.
"""

CASE_BITS = 8
"""Bits of a key that are the cube's samples: 4 dz + 2 dy + dx is that at (z + dz, y + dy, x + dx).
"""

_CASE = np.int64((1 << CASE_BITS) - 1)

_CUBES = 1 << 14
"""Cubes worked on at a time: what is made of them stays in the cache."""

_PLACES = 1 << 20
"""Places of cubes, listed or not, among which they are looked up at a time: so many, or as many as
all cubes that are listed, or those of one plane."""


class Region(NamedTuple):
    """A box of cubes: the first, and how many, along x, y and z.  Keys count its places."""

    low: Shape
    sides: Shape

    @classmethod
    def of(cls, box: Box) -> Region:
        """The region of all cubes of *box*."""
        (x, x_stop), (y, y_stop), (z, z_stop) = box
        return cls((x, y, z), (x_stop - x, y_stop - y, z_stop - z))

    def keys(
        self,
        z: NDArray[np.int64],
        y: NDArray[np.int64],
        x: NDArray[np.int64],
        cases: NDArray[np.uint8],
    ) -> NDArray[np.int64]:
        """One integer for each cube, by z, y and x, with its samples in the lowest bits."""
        rows = (z - self.low[2]) * self.sides[1] + (y - self.low[1])
        places = rows * self.sides[0] + (x - self.low[0])
        return (places << CASE_BITS) | cases


@dataclass(frozen=True)
class Table:
    """What scikit-image makes of each of the 256 cubes."""

    edges: NDArray[np.intp]
    """(12, 4), the axis of an edge (0 is x) and the z, y, x of the lower of its two samples."""
    triangles: NDArray[np.intp]
    """(t, 3), edge numbers, counter-clockwise seen from outside."""
    start: NDArray[np.intp]
    """(256,), the first triangle of a cube."""
    count: NDArray[np.intp]
    """(256,), how many it has."""
    crossed: NDArray[np.intp]
    """(3, 256), 1 if the edge along x, y or z from the cube's lowest sample has a vertex."""


@cache
def table() -> Table:
    """Return the table, made by 254 calls of scikit-image."""
    edges = np.array(
        [
            (axis, *corner)
            for axis in range(3)
            for corner in itertools.product((0, 1), repeat=3)
            if not corner[2 - axis]
        ]
    )
    middles = 2 * edges[:, 1:]
    middles[np.arange(12), 2 - edges[:, 0]] += 1
    numbers = {tuple(place): number for number, place in enumerate(middles.tolist())}
    triangles: list[NDArray[np.intp]] = []
    for case in range(256):
        faces = np.empty((0, 3), dtype=np.intp)
        if case not in (0, 255):
            samples = np.array([case >> bit & 1 for bit in range(8)], dtype=np.float32)
            vertices, faces, _, _ = marching_cubes(  # type: ignore[no-untyped-call]
                samples.reshape(2, 2, 2), LEVEL
            )
            # Back to the middle of the edge: twice 0.45 or 0.55 is 1.
            twice = np.rint(2 * vertices).astype(np.intp)
            # Its triangles are inside out in (z, y, x), so the right way round in (x, y, z).
            faces = np.array([numbers[tuple(place)] for place in twice.tolist()])[faces]
        triangles.append(faces)
    count = np.array([len(faces) for faces in triangles])
    cases = np.arange(256)
    return Table(
        edges=edges,
        triangles=np.concatenate(triangles),
        start=np.cumsum(count) - count,
        count=count,
        crossed=np.array([(cases ^ (cases >> (1 << axis))) & 1 for axis in range(3)]),
    )


def march(grid: Grid, region: Region, keys: NDArray[np.int64]) -> Mesh:
    """Return the vertices and triangles of the cubes *keys*, which are sorted.

    Vertices come by the cube that they belong to, those of one cube along x, y and z; triangles by
    the cube that they lie in.
    """
    width, height, depth = region.sides
    plane = width * height
    if not len(keys):
        return np.empty((0, 3)), np.empty((0, 3), np.int64)
    planes = np.searchsorted(keys, np.arange(depth + 1) * plane << CASE_BITS)
    cuts = _cut(planes, max(1, max(_PLACES, len(keys)) // plane))
    parts = [slice(*part) for part in itertools.pairwise(planes[cuts].tolist())]
    ends = np.zeros((len(cuts), 2), np.int64)
    np.cumsum([_made(keys[part]) for part in parts], axis=0, out=ends[1:])
    # Made once and of the right size: memory costs more when it is touched for the first time than
    # what is done there.
    vertices = np.empty((ends[-1, 0], 3))
    faces = np.empty((ends[-1, 1], 3), np.int64)

    def work(start: int, stop: int) -> None:
        # Written and read only where cubes are: a look-up without a search.
        index = np.empty((max(np.diff(cuts)) + 1) * plane, np.int32)
        for part, first, last, at, end in zip(parts, cuts, cuts[1:], ends, ends[1:], strict=False):
            if not start <= part.start < stop:
                continue
            # Triangles have vertices that belong to cubes of the plane above.
            above = keys[part.start : planes[min(last + 1, depth)]]
            cubes = _Cubes.of(above, part.stop - part.start, first * plane, at[0])
            cubes.place(grid, region, first, vertices[at[0] : end[0]])
            cubes.connect(plane, width, index, faces[at[1] : end[1]])

    in_halves(work, len(keys))
    return vertices, faces


def _cut(planes: NDArray[np.intp], most: int) -> list[int]:
    """Cut planes, at most so many together, where they hold about as many cubes as fit the cache.

    planes: where the cubes of each begin, and the end of the last.
    """
    cuts, last = [0], len(planes) - 1
    for stop in range(1, last):
        if stop + 1 - cuts[-1] > most or planes[stop + 1] - planes[cuts[-1]] > _CUBES:
            cuts.append(stop)
    return [*cuts, last]


def _made(keys: NDArray[np.int64]) -> tuple[int, int]:
    """How many vertices and triangles cubes make."""
    uses = np.bincount(keys & _CASE, minlength=256)
    return int(uses @ table().crossed.sum(axis=0)), int(uses @ table().count)


class _Cubes(NamedTuple):
    """Cubes of whole planes, *own* of them, and those of one plane more.

    places: in the region, counted from the first plane.  numbers: (3, n), those of the vertices
    along x, y and z, whether they are there or not.
    """

    own: int
    places: NDArray[np.int64]
    cases: NDArray[np.uint8]
    numbers: NDArray[np.int64]

    @classmethod
    def of(cls, keys: NDArray[np.int64], own: int, start: int, first: int) -> _Cubes:
        """From *keys*; *start* is the place, and *first* the vertex, with which counting starts."""
        cases = keys.astype(np.uint8)
        x, y, z = (crossed.take(cases) for crossed in table().crossed)
        numbers = np.empty((3, len(keys)), np.int64)
        np.cumsum(x + y + z, out=numbers[2])
        numbers[2] += first
        numbers[2] -= z
        np.subtract(numbers[2], y, out=numbers[1])
        np.subtract(numbers[1], x, out=numbers[0])
        return cls(own, (keys >> CASE_BITS) - start, cases, numbers)

    def place(self, grid: Grid, region: Region, plane: int, vertices: NDArray[np.float64]) -> None:
        """Write where the vertices of the own cubes are; *plane* is the first one."""
        width, height, _ = region.sides
        # `//` is several times faster than divmod.
        rows = self.places[: self.own] // width
        layers = rows // height
        corner = self.places[: self.own] - rows * width, rows - layers * height, layers + plane
        first = self.numbers[0, 0]
        crossed = [some.take(self.cases[: self.own]) for some in table().crossed]
        owner = np.repeat(np.arange(self.own), sum(crossed))
        for axis in range(3):
            # Sample p stands at voxel p - 1, whose centre is at p - 1/2.
            twice = (2 * (corner[axis] + region.low[axis]) - 1).take(owner)
            (moved,) = np.nonzero(crossed[axis])
            twice[self.numbers[axis].take(moved) - first] += 1
            vertices[:, axis] = twice * 0.5 * grid.spacing[axis] + grid.origin[axis]

    def connect(
        self, plane: int, width: int, index: NDArray[np.int32], faces: NDArray[np.int64]
    ) -> None:
        """Write the triangles of the own cubes; *index* is room for a number at each place."""
        known, own = table(), self.own
        index[self.places] = np.arange(len(self.places), dtype=np.int32)
        cases, places = self.cases[:own], self.places[:own]
        owners = {}
        corners = np.empty((len(known.edges), own), np.int64)
        for edge, (axis, *corner) in enumerate(known.edges.tolist()):
            if tuple(corner) not in owners:
                # Of cubes that are not there, numbers are nonsense, and no triangle's.
                step = corner[0] * plane + corner[1] * width + corner[2]
                owners[tuple(corner)] = index.take(places + step, mode="clip")
            self.numbers[axis].take(owners[tuple(corner)], out=corners[edge], mode="clip")
        count = known.count.take(cases)
        # Per triangle, its row in the table: the first of its cube's, and counting on.
        row = np.repeat(known.start.take(cases) - (np.cumsum(count) - count), count)
        row += np.arange(len(row))
        at = known.triangles.take(row, axis=0)
        at *= own
        at += np.repeat(np.arange(own), count)[:, None]
        corners.reshape(-1).take(at, out=faces, mode="clip")
