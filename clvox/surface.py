"""Blocks of samples -> watertight mesh, by scikit-image's marching cubes.

Samples stand at the voxel centres, with one layer of "outside" around the grid, so that a solid
which the grid cuts is capped.  The cubes between them that are neither all in nor all out are
listed block by block; `clvox._cubes` makes the mesh of the list.  docs/algorithms/surface.md shows
why it is closed.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clvox._cubes import Box, Mesh, Region, march
from clvox.errors import GridError
from clvox.grid import Grid, Shape

Read: TypeAlias = Callable[[Shape, Shape], NDArray[Any]]
"""``read(start, stop)``: the samples of the voxels from *start* to before *stop*, (i, j, k)."""

BLOCK = 96
"""Cubes along the side of a block: smaller ones cost more calls, larger ones more empty cubes."""


def extract(
    grid: Grid,
    read: Read,
    uniform: NDArray[np.uint8] | None = None,
    cell: Shape = (1, 1, 1),
    *,
    block: int = BLOCK,
    progress: Callable[[int, int], object] | None = None,
) -> Mesh:
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
        In the length unit of *grid*, x, y and z; sorted by z, y and x of the lower of the two
        voxels, then by the axis between them.  Empty for an empty solid.
    faces : (m, 3) int64
        Vertex numbers, counter-clockwise seen from outside, so that the signed volume is
        positive; sorted by z, y and x of the cubes that they lie in.

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
    x, y, z = ((0, count + 1) for count in grid.shape)
    whole = (x, y, z) if work is None else work.within((x, y, z))
    region = Region.of(whole or ((0, 0), (0, 0), (0, 0)))
    total = len(spans[0]) * len(spans[1]) * len(spans[2])
    done = 0
    found = [np.empty(0, np.int64)]
    for layer in spans[2]:
        listed = []
        for row, column in itertools.product(spans[1], spans[0]):
            box = (column, row, layer)
            needed = box if work is None else work.within(box)
            if needed is not None:
                listed.append(_list_cubes(region, needed, _samples(grid, read, needed)))
            done += 1
            if progress is not None:
                progress(done, total)
        if listed:
            found.append(np.concatenate(listed))
            found[-1].sort()
    keys = np.concatenate(found)
    found.clear()
    return march(grid, region, keys)


def _spans(count: int, block: int) -> list[tuple[int, int]]:
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

    def within(self, box: Box) -> Box | None:
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


def _samples(grid: Grid, read: Read, box: Box) -> NDArray[np.uint8]:
    """The samples that the cubes of *box* lie between, 0 or 1, [z, y, x]."""
    starts = [max(start - 1, 0) for start, _ in box]
    stops = [min(stop, count) for (_, stop), count in zip(box, grid.shape, strict=True)]
    voxels = read((starts[0], starts[1], starts[2]), (stops[0], stops[1], stops[2]))
    shape = tuple(stop - start for start, stop in zip(starts[::-1], stops[::-1], strict=True))
    if voxels.shape != shape:
        raise GridError(
            f"read({starts}, {stops}) must return the shape {shape}, got {voxels.shape}"
        )
    # One layer more on the low sides than cubes, and what of it is beyond the grid is outside.
    beyond = [
        (first - (start - 1), last - stop)
        for (start, last), first, stop in zip(box, starts, stops, strict=True)
    ]
    samples = voxels != 0
    if np.any(beyond):
        samples = np.pad(samples, beyond[::-1])
    result: NDArray[np.uint8] = samples.view(np.uint8)
    return result


def _list_cubes(region: Region, box: Box, samples: NDArray[np.uint8]) -> NDArray[np.int64]:
    """The keys of the cubes of *box* that are neither all in nor all out."""
    _, ny, nx = samples.shape
    # In one piece each, whatever the rows: several times faster than row by row.  So the last
    # sample of a row makes cubes with the next row's first ones, which are dropped.
    flat = samples.reshape(-1)
    one, two, four = np.uint8(1), np.uint8(2), np.uint8(4)
    pairs = flat[:-1] | (flat[1:] << one)
    squares = pairs[:-nx] | (pairs[nx:] << two)
    cubes = squares[: -nx * ny] | (squares[nx * ny :] << four)
    # Neither 0 nor 255, which wraps to 0.
    (where,) = np.nonzero((cubes + one) > one)
    rows = where // nx
    layers = rows // ny
    x, y = where - rows * nx, rows - layers * ny
    (low_x, _), (low_y, _), (low_z, _) = box
    within = (x < nx - 1) & (y < ny - 1)
    keys = region.keys(layers + low_z, y + low_y, x + low_x, cubes.take(where))
    return keys.compress(within)
