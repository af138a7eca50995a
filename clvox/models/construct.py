"""The stages that make the voxels of a mesh: mark, rank, clear, flip, carry."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from clvox.device import Session
from clvox.grid import Lattice, Shape
from clvox.mesh import Surface
from clvox.models.memory import (
    LEAST_WORK,
    Room,
    cut_slabs,
    middle_nbytes,
    slab_nbytes,
    top_nbytes,
)
from clvox.models.report import Report
from clvox.models.sending import SentMesh
from clvox.models.telling import Told
from clvox.models.voxels import VoxelModel
from clvox.ops import boundary, crossings, dense
from clvox.ops import fill as fills
from clvox.ops.facets import Mesh
from clvox.ops.fill import Winding
from clvox.ops.layout import Bricks, Cells, Slab, VoxelArrays, cell_shape, words_for
from clvox.ops.multilevel import Solid, carry, empty_solid, rank_cells
from clvox.ops.sorting import LIST_BYTES

if TYPE_CHECKING:
    import pyopencl.array as cla

Fill: TypeAlias = Literal["parity", "nonzero", "positive", "vote", "winding", "surface"]
"""What is inside: see `voxelize`."""

WINDINGS = {"nonzero": Winding.NONZERO, "positive": Winding.POSITIVE}
"""The fills that go by winding numbers."""


def construct(
    session: Session,
    surface: Surface,
    lattice: Lattice,
    levels: tuple[Shape, ...],
    fill: Fill,
    budget: int,
    told: Told,
) -> VoxelModel:
    """Return the model of *surface* on the grid of *lattice*, with *levels*, filled by *fill*.

    budget: bytes of the device that may be taken at once, the model included.
    """
    seconds: dict[str, float] = {}
    with timed(session, seconds, "snap"):
        vertices = lattice.snap(surface.vertices)
    with session.job(budget, told.again) as job:
        room = Room(session, job, lattice.grid, surface, levels)
        sent = SentMesh(session, vertices, surface.faces)
        build = _Build(room, lattice, fill, sent, told, seconds)
        arrays = build.run()
    warnings = list(surface.warnings)
    if build.odd_rays or build.disagreements:
        warnings.append(
            f"{build.odd_rays} rays cross the mesh an odd number of times and "
            f"{build.disagreements} untouched cells are in and out at once: please report this mesh"
        )
    report = replace(
        Report.of_mesh(session.device, surface, lattice, fill),
        seconds=seconds,
        collapsed=build.collapsed,
        odd_rays=build.odd_rays,
        peak_nbytes=job.peak_nbytes,
        warnings=tuple(warnings),
    )
    return VoxelModel(session, lattice.grid, arrays, report, ((surface, lattice),))


@contextmanager
def timed(session: Session, seconds: dict[str, float], stage: str) -> Iterator[None]:
    """Add to *seconds* what a stage takes; it ends with the device idle."""
    start = time.perf_counter()
    yield
    session.finish()
    seconds[stage] = seconds.get(stage, 0.0) + time.perf_counter() - start


@dataclass
class _Build:
    """One model in the making: what its stages share, and what they find."""

    room: Room
    lattice: Lattice
    fill: Fill
    sent: SentMesh
    told: Told
    seconds: dict[str, float]
    collapsed: int = 0
    odd_rays: int = 0
    disagreements: int = 0

    def run(self) -> VoxelArrays:
        """Return the model."""
        result = top_nbytes(self.shape, self.levels)
        if len(self.levels) == 1:
            return self._mark_dense(result) if self.fill == "surface" else self._fill_dense(result)
        cells = self._mark_cells(result)
        result["bricks"] = 4 * cells.last.count * cells.last.brick_words
        if self.fill == "surface":
            return self._mark_bricks(cells, result)
        return self._fill_bricks(cells, result)

    @property
    def session(self) -> Session:
        """The device."""
        return self.room.session

    @property
    def levels(self) -> tuple[Shape, ...]:
        """Shape of the coarse grid, and of the bricks level by level."""
        return self.room.levels

    @property
    def shape(self) -> Shape:
        """Voxels along each axis."""
        return self.lattice.grid.shape

    @property
    def mesh(self) -> tuple[Session, Mesh, int]:
        """What is visited, as the operations take it."""
        return self.session, self.sent.facets, self.lattice.bits

    def _stage(self, name: str) -> AbstractContextManager[None]:
        return timed(self.session, self.seconds, name)

    def _send(self, spare: int) -> None:
        """Let the mesh take *spare* bytes, from now on."""
        with self._stage("upload"):
            self.sent.fit(spare)

    # Cells

    def _mark_cells(self, result: dict[str, int]) -> Cells:
        """The touched cells of each level above the voxels; *result* learns their bytes."""
        sides, brick = self.levels[1], self.levels[-1]
        if len(self.levels) == 3:
            x, y, z = (a * b for a, b in zip(sides, brick, strict=True))
            sides = x, y, z
        self._send(self.room.require(result))
        with self._stage("mark"):
            part = self.told.part(0, 0.5)
            marks, self.collapsed = boundary.mark_and_count(
                *self.mesh, self.shape, sides, progress=part
            )
        with self._stage("rank"):
            cells = rank_cells(self.session, marks, self.levels[0], self.levels[1])
        if len(self.levels) == 2:
            return cells
        result |= middle_nbytes(cells)
        self._send(self.room.require(result))
        counts = cell_shape(self.shape, brick)
        with self._stage("mark"):
            marks = boundary.mark_voxels(*self.mesh, counts, cells, side=brick)
        with self._stage("rank"):
            return replace(cells, finer=rank_cells(self.session, marks, counts, brick))

    # Voxels

    def _fill_bricks(self, cells: Cells, result: dict[str, int]) -> VoxelArrays:
        slabs = self._slabs(cells, self.room.require(result))
        work = max(slab_nbytes(cells, slab) for slab in slabs)
        list_bytes = self._share(self.room.require(result, work))
        with self._stage("clear"):
            solid = empty_solid(self.session, cells)
            voxels = self.session.zeros((cells.last.count, cells.last.brick_words), np.uint32)
        for slab in slabs:
            solid = self._fill_slab(cells, voxels, slab, solid, list_bytes)
        self.odd_rays, self.disagreements = solid.odd_rays, solid.disagreements
        return VoxelArrays(self.shape, voxels, cells, solid.inside, solid.middle_inside)

    def _slabs(self, cells: Cells, spare: int) -> list[Slab]:
        """All of the model if its planes leave enough of *spare*, else slabs of it."""
        whole = Slab.whole(cells)
        # What is required beside a slab is a sixteenth of it, and the least there is to work in.
        most = min(spare // 2, (spare - LEAST_WORK) // 17 * 16)
        most = min(most, self.session.device.largest_allocation)
        return [whole] if slab_nbytes(cells, whole) <= most else cut_slabs(cells, most)

    def _share(self, spare: int) -> int:
        """Let the mesh take *spare* bytes, or half of them; return what lists may take."""
        if self.fill not in WINDINGS:
            self._send(spare)
            return 0
        self._send(spare // 2)
        return min(spare // 2, self.session.device.largest_allocation, LIST_BYTES)

    def _fill_slab(
        self, cells: Cells, voxels: cla.Array, slab: Slab, solid: Solid, list_bytes: int
    ) -> Solid:
        """Fill the bricks of *slab*; *solid* is what other slabs are."""
        layers, winding = cells.last.shape[2], WINDINGS.get(self.fill)
        with self._stage("clear"):
            bricks = Bricks.cleared(self.session, cells, voxels, slab)
        with self._stage("flip"):
            first, last = slab.first_layer, slab.first_layer + slab.layers
            part = self.told.part(0.5 + 0.5 * first / layers, 0.5 + 0.5 * last / layers)
            if winding is None:
                crossings.flip_bricks(*self.mesh, cells, bricks, progress=part)
            else:
                fills.flip_bricks(
                    *self.mesh, cells, winding, bricks, progress=part, list_bytes=list_bytes
                )
        with self._stage("carry"):
            return carry(self.session, cells, bricks, self.shape, solid)

    def _fill_dense(self, result: dict[str, int]) -> VoxelArrays:
        nx, ny, nz = self.shape
        words, winding = words_for(nx), WINDINGS.get(self.fill)
        list_bytes = self._share(self.room.require(result, 4 * nz * words))
        with self._stage("upload"):
            self.collapsed = boundary.count_flat(self.session, self.sent.facets)
        with self._stage("clear"):
            voxels = self.session.zeros((nz, ny, words), np.uint32)
            beyond = self.session.zeros((nz, words), np.uint32)
        with self._stage("flip"):
            target, part = (self.shape, voxels, beyond), self.told.part(0, 1)
            if winding is None:
                crossings.flip_dense(*self.mesh, *target, progress=part)
            else:
                fills.flip_dense(
                    *self.mesh,
                    self.shape,
                    winding,
                    voxels,
                    beyond,
                    progress=part,
                    list_bytes=list_bytes,
                )
        with self._stage("carry"):
            self.odd_rays = dense.fill(self.session, voxels, beyond)
        return VoxelArrays(self.shape, voxels)

    # Touched voxels: marks are all there is to them

    def _mark_bricks(self, cells: Cells, result: dict[str, int]) -> VoxelArrays:
        self._send(self.room.require(result))
        with self._stage("flip"):
            part = self.told.part(0.5, 1)
            voxels = boundary.mark_voxels(*self.mesh, self.shape, cells, progress=part)
        solid = empty_solid(self.session, cells)
        return VoxelArrays(self.shape, voxels, cells, solid.inside, solid.middle_inside)

    def _mark_dense(self, result: dict[str, int]) -> VoxelArrays:
        self._send(self.room.require(result))
        with self._stage("mark"):
            part = self.told.part(0, 1)
            marks, self.collapsed = boundary.mark_and_count(
                *self.mesh, self.shape, (1, 1, 1), progress=part
            )
        return VoxelArrays(self.shape, marks)
