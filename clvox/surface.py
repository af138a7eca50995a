"""Blocks of samples -> watertight mesh, by scikit-image's marching cubes.

Samples stand at the voxel centres, with one layer of "outside" around the grid, so that a solid
which the grid cuts is capped.  A *cube* is eight neighbouring samples; on samples of 0 and 1 its
triangles depend on those eight bits alone.  So scikit-image is asked once about each of the 256
cubes, and the answers are copied to wherever such a cube occurs.  docs/algorithms/surface.md
shows why the copies fit together.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from skimage.measure import marching_cubes

from clvox.errors import GridError
from clvox.grid import Grid, Shape

Read: TypeAlias = Callable[[Shape, Shape], NDArray[Any]]
"""``read(start, stop)``: the samples of the voxels from *start* to before *stop*, (i, j, k)."""

LEVEL = 0.55
"""Where scikit-image cuts samples of 0 and 1.

A square of samples that is in on one diagonal and out on the other has one half in its middle.
Above one half the middle is out, whichever cube looks at it: the solid is 6-connected, and
neighbours agree.  At one half the tests tie.  Any level between 0.5 and 1 gives these triangles.
"""

BLOCK = 64
"""Cubes along the side of a block: smaller ones cost more calls, larger ones more empty cubes."""


def extract(
    grid: Grid,
    read: Read,
    uniform: NDArray[np.uint8] | None = None,
    cell: Shape = (1, 1, 1),
    *,
    block: int = BLOCK,
    progress: Callable[[int, int], object] | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.integer[Any]]]:
    """Return the surface of a solid given by its samples, as a closed and oriented mesh.

    Each edge belongs to two triangles that run along it in opposite directions, the triangles
    around a vertex form one disc, and voxels of the solid that share no face are not joined.
    A vertex lies half-way between the centres of two voxels, one in and one out.

    Parameters
    ----------
    grid : Grid
        Where the voxels are.  The solid is capped where the box of the grid cuts it.
    read : callable
        ``read(start, stop)`` returns the voxels from *start* = (i, j, k) to before *stop*, an
        array of bool or integers indexed [z, y, x]; what is not zero is inside.
    uniform : (ncz, ncy, ncx) uint8, optional
        Per cell: 0, all its voxels are outside; 1, inside; 2, they may differ.  Where cells make
        it plain that there is no surface, nothing is read.  What a cell says about voxels beyond
        the grid is ignored.
    cell : (3,) int
        Voxels along x, y and z of a cell of *uniform*; cells start at voxel 0.
    block : int
        Voxels along the side of the blocks that are read, one at a time.  The result does not
        depend on it.
    progress : callable, optional
        ``progress(done, total)`` is called after each block, skipped ones included.

    Returns
    -------
    vertices : (n, 3) float64
        In the length unit of *grid*, x, y and z; sorted by z, then y, then x.  Empty for an
        empty solid.
    faces : (m, 3) int32
        Vertex numbers, counter-clockwise seen from outside, so that the signed volume is
        positive; sorted by the cubes that they lie in.  int64 from 2**31 vertices on.

    Raises
    ------
    GridError
        *block* or *cell* is not positive, or *uniform* or what *read* returns has the wrong
        shape.
    """
    if block < 1 or min(cell) < 1:
        raise GridError(f"block and cell must be positive, got block={block} and cell={cell}")
    work = None if uniform is None else _Work.plan(grid, uniform, cell)
    spans = [_spans(count, block) for count in grid.shape]
    total = len(spans[0]) * len(spans[1]) * len(spans[2])
    done = 0
    weld = _Weld(grid)
    for layer in spans[2]:
        for row, column in itertools.product(spans[1], spans[0]):
            box = (column, row, layer)
            needed = box if work is None else work.within(box)
            if needed is not None:
                weld.add(needed, _samples(grid, read, needed))
            done += 1
            if progress is not None:
                progress(done, total)
        weld.close(layer[1])
    return weld.finish()


_Span: TypeAlias = tuple[int, int]
_Box: TypeAlias = tuple[_Span, _Span, _Span]
"""From and to of the cubes along x, y and z.  Cube c lies between voxels c - 1 and c."""


def _spans(count: int, block: int) -> list[_Span]:
    """Cut the count + 1 cubes of an axis into blocks; the last takes the cube of the cap."""
    starts = range(0, count, block)
    return [(start, min(start + block, count)) for start in starts[:-1]] + [(starts[-1], count + 1)]


@dataclass(frozen=True)
class _Work:
    """The cells whose cubes may hold a surface."""

    cells: NDArray[np.bool_]
    """Indexed [z, y, x], with a frame of one outside cell, so that cell w is entry w + 1."""
    cell: Shape

    @classmethod
    def plan(cls, grid: Grid, uniform: NDArray[np.uint8], cell: Shape) -> _Work:
        x, y, z = (-(-count // width) for count, width in zip(grid.shape, cell, strict=True))
        if uniform.shape != (z, y, x):
            raise GridError(
                f"uniform must have the shape {(z, y, x)}, one entry per cell of {cell} voxels, "
                f"got {uniform.shape}"
            )
        states = np.pad(uniform, 1)
        cells = states == 2
        # A cube that touches no such cell lies in cells that are all in or out.  They form a box,
        # so if they differ, then two that share a face do, and either leads to the cube.
        for axis in range(3):
            low = (slice(None),) * axis + (slice(None, -1),)
            high = (slice(None),) * axis + (slice(1, None),)
            cells[low] |= (states[low] ^ states[high]) == 1
        return cls(cells, cell)

    def within(self, box: _Box) -> _Box | None:
        """The part of *box* that must be looked at, or None."""
        # The cells of voxels start - 1 and stop - 1, the first and the last that cubes touch.
        lows = [(start - 1) // width + 1 for (start, _), width in zip(box, self.cell, strict=True)]
        highs = [(stop - 1) // width + 2 for (_, stop), width in zip(box, self.cell, strict=True)]
        x, y, z = (slice(low, high) for low, high in zip(lows, highs, strict=True))
        found = self.cells[z, y, x]
        if not found.any():
            return None
        spans = []
        for axis, (start, stop) in enumerate(box):
            others = tuple({0, 1, 2} - {2 - axis})
            (hits,) = np.nonzero(found.any(axis=others))
            first, last = (int(hit) + lows[axis] - 1 for hit in (hits[0], hits[-1]))
            width = self.cell[axis]
            # Voxels first * width to (last + 1) * width - 1 belong to one cube more.
            spans.append((max(start, first * width), min(stop, (last + 1) * width + 1)))
        return spans[0], spans[1], spans[2]


def _samples(grid: Grid, read: Read, box: _Box) -> NDArray[np.uint8]:
    """The samples that the cubes of *box* lie between, 0 or 1, [z, y, x]."""
    starts = [max(start - 1, 0) for start, _ in box]
    stops = [min(stop, count) for (_, stop), count in zip(box, grid.shape, strict=True)]
    voxels = read((starts[0], starts[1], starts[2]), (stops[0], stops[1], stops[2]))
    shape = tuple(stop - start for start, stop in zip(starts[::-1], stops[::-1], strict=True))
    if voxels.shape != shape:
        raise GridError(
            f"read({starts}, {stops}) must return the shape {shape}, got {voxels.shape}"
        )
    samples = np.zeros([stop - start + 1 for start, stop in box[::-1]], dtype=np.bool_)
    x, y, z = (
        slice(first - (start - 1), stop - (start - 1))
        for first, stop, (start, _) in zip(starts, stops, box, strict=True)
    )
    np.not_equal(voxels, 0, out=samples[z, y, x])
    return samples.view(np.uint8)


class _Weld:
    """Gathers triangles block by block; joins the blocks of a layer, and layer to layer.

    A vertex is known by twice its place in samples, counted from the layer before the grid:
    three integers, exactly one of them odd, which tells the axis of its edge.  They become one
    key below 2**54, ordered by z, then y, then x.
    """

    def __init__(self, grid: Grid) -> None:
        self.grid = grid
        self.sides = [2 * count + 3 for count in grid.shape]
        self.keys: list[NDArray[np.int64]] = []
        self.faces: list[NDArray[np.integer[Any]]] = []
        self.base = 0
        self.open()

    def open(self) -> None:
        """Start a layer of blocks."""
        self.layer_count = 0
        self.layer_keys: list[NDArray[np.int64]] = []
        self.layer_faces: list[NDArray[np.int32]] = []
        self.layer_cubes: list[NDArray[np.int64]] = []

    def add(self, box: _Box, samples: NDArray[np.uint8]) -> None:
        """Take the triangles of the cubes of *box*, given the samples they lie between."""
        cubes = _cases(samples)
        # Neither 0 nor 255, which wraps to 0.
        (where,) = np.nonzero((cubes.ravel() + np.uint8(1)) > 1)
        if not len(where):
            return
        crossed = np.zeros((3, *samples.shape), dtype=np.uint8)
        np.bitwise_xor(samples[:, :, 1:], samples[:, :, :-1], out=crossed[0, :, :, :-1])
        np.bitwise_xor(samples[:, 1:], samples[:, :-1], out=crossed[1, :, :-1])
        np.bitwise_xor(samples[1:], samples[:-1], out=crossed[2, :-1])
        (edges,) = np.nonzero(crossed.ravel().view(np.bool_))
        # Written and read only where a vertex is: a look-up without a search.
        numbers = np.empty(crossed.size, dtype=np.int32)
        first = self.layer_count
        numbers[edges] = np.arange(first, first + len(edges), dtype=np.int32)

        table = _table()
        places = np.unravel_index(where, cubes.shape)
        case = cubes.ravel()[where]
        count = table.count[case]
        owner = np.repeat(np.arange(len(where)), count)
        # Per triangle, its row in the table: the first of its cube's, and counting on.
        row = np.arange(len(owner)) + (table.start[case] - (np.cumsum(count) - count))[owner]
        corner = np.ravel_multi_index(places, samples.shape)
        strides = np.array([samples.size, samples[0].size, samples.shape[2], 1])
        offset = (table.edges @ strides)[table.triangles[row]]
        self.layer_faces.append(numbers[corner[owner][:, None] + offset])

        starts = [start for start, _ in box]
        self.layer_cubes.append(self._keys(places, starts)[owner])
        axis, z, y, x = np.unravel_index(edges, crossed.shape)
        self.layer_keys.append(self._keys((z, y, x), starts, axis))
        self.layer_count += len(edges)

    def _keys(
        self,
        places: Sequence[NDArray[np.intp]],
        starts: Sequence[int],
        axis: NDArray[np.intp] | int = -1,
    ) -> NDArray[np.int64]:
        """The keys of the samples at *places* (z, y, x) of a box, moved half-way along *axis*."""
        z, y, x = (
            2 * (places[2 - a].astype(np.int64) + starts[a]) + (axis == a) for a in (2, 1, 0)
        )
        keys: NDArray[np.int64] = (z * self.sides[1] + y) * self.sides[0] + x
        return keys

    def close(self, stop: int) -> None:
        """End a layer whose cubes reach to sample *stop*."""
        if self.layer_count:
            keys = np.concatenate(self.layer_keys)
            order = np.argsort(keys)
            keys = keys[order]
            new = np.ones(len(keys), dtype=np.bool_)
            np.not_equal(keys[1:], keys[:-1], out=new[1:])
            keys = keys[new]
            wide = self.base + len(keys) > np.iinfo(np.int32).max
            numbers: NDArray[np.integer[Any]]
            numbers = np.empty(len(order), dtype=np.int64 if wide else np.int32)
            numbers[order] = np.cumsum(new) + (self.base - 1)
            cubes = np.argsort(np.concatenate(self.layer_cubes), kind="stable")
            self.faces.append(numbers[np.concatenate(self.layer_faces)[cubes]])
            # Each edge within the plane of samples *stop* that a vertex sits on has cubes above
            # and below: the next layer finds the same ones, and puts them first.
            done = int(np.searchsorted(keys, 2 * stop * self.sides[1] * self.sides[0]))
            self.keys.append(keys[:done].copy())
            self.base += done
        self.open()

    def finish(self) -> tuple[NDArray[np.float64], NDArray[np.integer[Any]]]:
        """All vertices and faces."""
        faces = np.concatenate([np.empty((0, 3), dtype=np.int32), *self.faces])
        self.faces.clear()
        vertices = np.empty((self.base, 3))
        at = 0
        for keys in self.keys:
            # Layer by layer, in small temporaries; `//` is several times faster than divmod.
            rows = keys // self.sides[0]
            z = rows // self.sides[1]
            part = vertices[at : at + len(keys)]
            places = (keys - rows * self.sides[0], rows - z * self.sides[1], z)
            for axis, twice in enumerate(places):
                # Sample p stands at voxel p - 1, whose centre is at p - 1/2.
                centers = (twice - 1) * 0.5
                part[:, axis] = centers * self.grid.spacing[axis] + self.grid.origin[axis]
            at += len(keys)
        return vertices, faces


def _cases(samples: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The eight bits of each cube: bit 4 dz + 2 dy + dx is sample (z + dz, y + dy, x + dx)."""
    one, two, four = np.uint8(1), np.uint8(2), np.uint8(4)
    pairs = samples[:, :, :-1] | (samples[:, :, 1:] << one)
    squares = pairs[:, :-1] | (pairs[:, 1:] << two)
    cubes: NDArray[np.uint8] = squares[:-1] | (squares[1:] << four)
    return cubes


@dataclass(frozen=True)
class _Table:
    """What scikit-image makes of each of the 256 cubes."""

    triangles: NDArray[np.intp]
    """(t, 3), edge numbers, counter-clockwise seen from outside."""
    start: NDArray[np.intp]
    """(256,), the first triangle of a cube."""
    count: NDArray[np.intp]
    """(256,), how many it has."""
    edges: NDArray[np.intp]
    """(12, 4), the axis of an edge (0 is x) and the z, y, x of the lower of its two samples."""


@cache
def _table() -> _Table:
    places: dict[tuple[int, ...], int] = {}
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
            numbers = np.array([places.setdefault(tuple(at), len(places)) for at in twice.tolist()])
            # Its triangles are inside out in (z, y, x), so the right way round in (x, y, z).
            faces = numbers[faces]
        triangles.append(faces)
    count = np.array([len(faces) for faces in triangles])
    doubled = np.array(list(places))
    axis = 2 - np.argmax(doubled % 2, axis=1)
    return _Table(
        triangles=np.concatenate(triangles),
        start=np.cumsum(count) - count,
        count=count,
        edges=np.column_stack([axis, doubled // 2]),
    )
