"""An open mesh to voxels by guessing, in slabs if memory is short.

A slab is a grid of its own: whole layers of coarse cells along z, with the mesh moved instead.  Its
arrays wait on the host until all are there; bricks are numbered along z last, so that the arrays of
the slabs, one after another, are those of the model.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from clvox.errors import OutOfMemoryError
from clvox.grid import Lattice, Shape
from clvox.mesh import Surface
from clvox.models.memory import Room, top_nbytes
from clvox.models.sending import SentMesh
from clvox.models.telling import Told
from clvox.ops import boundary, vote, winding
from clvox.ops.caps import close_rim
from clvox.ops.facets import Mesh
from clvox.ops.layout import VoxelArrays, cell_shape
from clvox.ops.multilevel import rank_cells

_BYTES_PER_RAY = 16
"""What counting the crossings of a ray takes, generously."""


class _Span(NamedTuple):
    """Layers of coarse cells from `first` up to but not including `stop`."""

    first: int
    stop: int


class Pieces:
    """The work of one guess."""

    def __init__(self, room: Room, lattice: Lattice, fill: str, told: Told) -> None:
        self._room = room
        self._bits = lattice.bits
        self._step = lattice.step
        self._fill = fill
        self._told = told
        self._vertices = lattice.snap(room.surface.vertices)
        if fill == "winding":
            self._rim = directed_rim(room.surface)
            self._caps = close_rim(self._rim)
        levels = room.levels
        self._depth = winding.BRICK[2] if len(levels) == 1 else math.prod(b[2] for b in levels[1:])
        self._layers = -(-room.grid.shape[2] // self._depth)

    def count_flat(self) -> int:
        """Return the number of triangles without area on the lattice."""
        return boundary.count_flat(self._room.session, self._send(self._vertices))

    def odd_rays(self) -> list[NDArray[np.int64]]:
        """Return the rays along each axis that cross the mesh an odd number of times."""
        session = self._room.session
        most = max(min(self._room.job.left // 2 // _BYTES_PER_RAY, vote.MOST_RAYS), 1)
        mesh = self._send(self._vertices)
        return vote.odd_rays(session, mesh, self._bits, self._room.grid.shape, most)

    def run(self) -> VoxelArrays:
        """Return the model.

        Raises
        ------
        OutOfMemoryError
            The model, or one layer of coarse cells and what deciding it takes, does not fit.
        """
        room = self._room
        room.require(top_nbytes(room.grid.shape, room.levels))
        whole = _Span(0, self._layers)
        found = self._try(whole)
        if found is not None:
            return found
        kept = [_to_host(arrays) for arrays in self._slabs(whole)]
        return self._join([np.concatenate(parts) for parts in zip(*kept, strict=True)])

    def _slabs(self, whole: _Span) -> Iterator[VoxelArrays]:
        waiting = list(reversed(_halves(whole)))
        while waiting:
            span = waiting.pop()
            arrays = self._try(span)
            if arrays is None:
                waiting += reversed(_halves(span))
            else:
                yield arrays
                del arrays

    def _try(self, span: _Span) -> VoxelArrays | None:
        """The voxels of some layers, or None if there is no room for so many."""
        session, job = self._room.session, self._room.job
        arrays = None
        with suppress(_TooMuchError), session.job(job.left, self._told.again) as own:
            try:
                arrays = self._decide(span)
            except OutOfMemoryError as error:
                # What a driver says has a cause, and is no question of a budget.
                if error.__cause__ is not None:
                    raise
                if span.stop - span.first == 1:
                    if own.refused:
                        self._room.refuse_work(job.nbytes + own.nbytes + own.refused)
                    raise
                raise _TooMuchError from None
        job.peak_nbytes = max(job.peak_nbytes, job.nbytes + own.peak_nbytes)
        if arrays is not None:
            for array in arrays.arrays:
                job.hold(array, session.size_of(array.nbytes))
        return arrays

    def _decide(self, span: _Span) -> VoxelArrays:
        room, bits = self._room, self._bits
        nx, ny, nz = room.grid.shape
        first, stop = span.first * self._depth, min(span.stop * self._depth, nz)
        shape = nx, ny, stop - first
        levels: tuple[Shape, ...] = (shape,)
        if len(room.levels) > 1:
            levels = (*room.levels[0][:2], span.stop - span.first), *room.levels[1:]
        vertices = self._vertices - np.array([0, 0, first << bits], np.int32)
        part = self._told.part(span.first / self._layers, span.stop / self._layers)
        frame = bits, shape, levels
        if self._fill == "vote":
            given = vertices, room.surface.faces, room.surface.odd_edges
            return vote.fill_vote(room.session, *given, *frame, send=self._send, progress=part)
        rim = winding.upload_rim(room.session, vertices, self._rim, self._caps, self._step)
        mesh = self._send(vertices)
        return winding.fill_winding(room.session, mesh, rim, *frame, progress=part)

    def _send(self, vertices: NDArray[np.int32], faces: NDArray[np.int32] | None = None) -> Mesh:
        """The mesh, in a quarter of what is left, part by part if need be."""
        session = self._room.session
        sent = SentMesh(session, vertices, self._room.surface.faces if faces is None else faces)
        job = session.current_job
        assert job is not None
        sent.fit(job.left // 4)
        return sent.facets

    def _join(self, host: list[NDArray[np.uint32]]) -> VoxelArrays:
        """The model, from its arrays on the host."""
        room, session, shape = self._room, self._room.session, self._room.grid.shape
        levels = room.levels
        result = top_nbytes(shape, levels)
        if len(levels) > 1:
            result["bricks"] = host[-1].nbytes
        if len(levels) == 3:
            result |= {"middle_boundary": host[2].nbytes, "middle_inside": host[3].nbytes}
        room.require(result)
        if len(levels) == 1:
            return VoxelArrays(shape, session.upload(host[0]))
        cells = rank_cells(session, session.upload(host[0]), levels[0], levels[1])
        inside, middle = session.upload(host[1]), None
        if len(levels) == 3:
            counts = cell_shape(shape, levels[2])
            finer = rank_cells(session, session.upload(host[2]), counts, levels[2])
            cells, middle = replace(cells, finer=finer), session.upload(host[3])
        return VoxelArrays(shape, session.upload(host[-1]), cells, inside, middle)


class _TooMuchError(OutOfMemoryError):
    """A slab has to be cut."""


def _halves(span: _Span) -> list[_Span]:
    middle = (span.first + span.stop) // 2
    return [_Span(span.first, middle), _Span(middle, span.stop)]


def _to_host(arrays: VoxelArrays) -> list[NDArray[np.uint32]]:
    """Boundary and inside, level by level, and the voxels; of a dense grid those alone."""
    kept = [arrays.inside, arrays.middle_inside, arrays.voxels]
    if arrays.cells is not None:
        finer = arrays.cells.finer
        kept = [arrays.cells.boundary, kept[0], finer.boundary if finer else None, *kept[1:]]
    return [array.get() for array in kept if array is not None]


def directed_rim(surface: Surface) -> NDArray[np.int32]:
    """Return the edges that are used more often one way than the other, the way they are.

    Returns
    -------
    (n, 2) int32
        Rows of `surface.vertices`; an edge comes as often as it is used more one way.
    """
    count = len(surface.vertices)
    on_rim = np.zeros(count, np.bool_)
    on_rim[surface.uneven_edges] = True
    faces = surface.faces[on_rim[surface.faces].sum(axis=1) >= 2].astype(np.int64)
    ends = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2)
    # Both ends on the rim: then all triangles of the edge are here.
    ends = ends[on_rim[ends].all(axis=1)]
    keys, edge = np.unique(ends.min(axis=1) * count + ends.max(axis=1), return_inverse=True)
    forward = np.where(ends[:, 0] < ends[:, 1], 1, -1)
    net = np.bincount(edge, weights=forward, minlength=len(keys)).astype(np.int64)
    pairs = np.stack(np.divmod(keys, count), axis=1)
    pairs[net < 0] = pairs[net < 0, ::-1]
    return np.repeat(pairs, np.abs(net), axis=0).astype(np.int32)
