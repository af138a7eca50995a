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

_PLACES = 1 << 19
"""Most places of cubes, listed or not, in a run of them; or as many as there are cubes."""


class Region(NamedTuple):
    """A box of cubes: the first, and how many, along x, y and z.  Keys count its places."""

    low: Shape
    sides: Shape

    @classmethod
    def of(cls, box: Box) -> Region:
        """The region of all cubes of *box*."""
        (x, x_stop), (y, y_stop), (z, z_stop) = box
        return cls((x, y, z), (x_stop - x, y_stop - y, z_stop - z))

    @property
    def plane(self) -> int:
        """Places from a cube to the one above it."""
        return self.sides[0] * self.sides[1]

    @property
    def reach(self) -> int:
        """Places from a cube to the farthest one that a vertex of its triangles belongs to."""
        return self.plane + self.sides[0]

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
    known = table()
    span = max(_PLACES, len(keys))
    cuts = _cut(keys, span)
    parts = list(itertools.pairwise(cuts))
    # Arrays are made once and of the right size: memory costs more when it is touched for the
    # first time than what is done there.
    ends = np.empty(len(keys), np.int64)
    corners = np.zeros(len(cuts), np.int64)
    for part, (a, b) in enumerate(parts):
        cases = keys[a:b].astype(np.uint8)
        known.crossed.sum(axis=0).take(cases, out=ends[a:b], mode="clip")
        corners[part + 1] = known.count.take(cases).sum()
    np.cumsum(ends, out=ends)
    np.cumsum(corners, out=corners)
    vertices = np.empty((ends[-1] if len(ends) else 0, 3))
    faces = np.empty((corners[-1], 3), np.int64)

    def work(start: int, stop: int) -> None:
        # Written and read only where cubes are: a look-up without a search.  A row of a layer, and
        # the same of the layer above, however far that is.
        index = np.empty((2, span + region.sides[0] + 1), np.int32)
        for part, (a, b) in enumerate(parts):
            if start <= a < stop:
                cubes = _Cubes.near(region, keys, ends, a, b)
                cubes.place(grid, region, vertices[cubes.numbers[0, 0] : ends[b - 1]])
                cubes.connect(region, index, faces[corners[part] : corners[part + 1]])

    in_halves(work, len(keys))
    return vertices, faces


def _cut(keys: NDArray[np.int64], span: int) -> list[int]:
    """Cut cubes into runs of `_CUBES` or fewer, over fewer places than *span*."""
    cuts = [0]
    while cuts[-1] < len(keys):
        start = cuts[-1]
        beyond = ((keys[start] >> CASE_BITS) + span) << CASE_BITS
        run = keys[start : start + _CUBES]
        cuts.append(start + int(np.searchsorted(run, beyond)))
    return cuts


class _Cubes(NamedTuple):
    """A run of cubes, *own* of them, and after it those that vertices of their triangles belong to.

    first: the place of the first one, from which *places* are counted.  numbers: (3, n), those of
    the vertices along x, y and z, whether they are there or not.
    """

    own: int
    first: int
    places: NDArray[np.int64]
    cases: NDArray[np.uint8]
    numbers: NDArray[np.int64]

    @classmethod
    def near(
        cls, region: Region, keys: NDArray[np.int64], ends: NDArray[np.int64], a: int, b: int
    ) -> _Cubes:
        """Cubes *a* to *b*; *ends* is how many vertices there are up to each cube."""
        first, last = int(keys[a] >> CASE_BITS), int(keys[b - 1] >> CASE_BITS)
        # Those in the same layer, and those in the layer above: often all up to the last of them.
        wanted = np.array(
            [last + region.sides[0] + 2, first + region.plane, last + region.reach + 1]
        )
        stop, above, end = np.searchsorted(keys, wanted << CASE_BITS).tolist()
        spans = slice(a, stop), slice(max(stop, above), end)
        near = np.concatenate([keys[some] for some in spans])
        cases = near.astype(np.uint8)
        numbers = np.empty((3, len(near)), np.int64)
        np.concatenate([ends[some] for some in spans], out=numbers[2])
        x, y, z = (crossed.take(cases) for crossed in table().crossed)
        numbers[2] -= z
        np.subtract(numbers[2], y, out=numbers[1])
        np.subtract(numbers[1], x, out=numbers[0])
        return cls(b - a, first, (near >> CASE_BITS) - first, cases, numbers)

    def place(self, grid: Grid, region: Region, vertices: NDArray[np.float64]) -> None:
        """Write where the vertices of the own cubes are."""
        width, height, _ = region.sides
        places = self.places[: self.own] + self.first
        # `//` is several times faster than divmod.
        rows = places // width
        layers = rows // height
        corner = places - rows * width, rows - layers * height, layers
        crossed = [some.take(self.cases[: self.own]) for some in table().crossed]
        owner = np.repeat(np.arange(self.own), sum(crossed))
        for axis in range(3):
            # Sample p stands at voxel p - 1, whose centre is at p - 1/2.
            twice = (2 * (corner[axis] + region.low[axis]) - 1).take(owner)
            (moved,) = np.nonzero(crossed[axis])
            twice[self.numbers[axis].take(moved) - self.numbers[0, 0]] += 1
            vertices[:, axis] = twice * 0.5 * grid.spacing[axis] + grid.origin[axis]

    def connect(self, region: Region, index: NDArray[np.int32], faces: NDArray[np.int64]) -> None:
        """Write the triangles of the own cubes; *index* is room for a number at each place."""
        known, own = table(), self.own
        everyone = np.arange(len(self.places), dtype=np.int32)
        stop, above = np.searchsorted(self.places, (index.shape[1], region.plane))
        index[0, self.places[:stop]] = everyone[:stop]
        index[1, self.places[above:] - region.plane] = everyone[above:]
        cases, places = self.cases[:own], self.places[:own]
        owners = {}
        corners = np.empty((len(known.edges), own), np.int64)
        for edge, (axis, *corner) in enumerate(known.edges.tolist()):
            z, y, x = corner
            if (z, y, x) not in owners:
                # Of cubes that are not there, numbers are nonsense, and no triangle's.
                step = y * region.sides[0] + x
                owners[z, y, x] = index[z].take(places + step, mode="clip")
            self.numbers[axis].take(owners[z, y, x], out=corners[edge], mode="clip")
        count = known.count.take(cases)
        # Per triangle, its row in the table: the first of its cube's, and counting on.
        row = np.repeat(known.start.take(cases) - (np.cumsum(count) - count), count)
        row += np.arange(len(row))
        at = known.triangles.take(row, axis=0)
        at *= own
        at += np.repeat(np.arange(own), count)[:, None]
        corners.reshape(-1).take(at, out=faces, mode="clip")
