"""The stages that make the voxels of a mesh: mark, rank, clear, flip, carry."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from clvox.device import Session
from clvox.grid import Lattice, Shape
from clvox.mesh import Surface
from clvox.models.report import Report
from clvox.models.voxels import VoxelModel
from clvox.ops import boundary, crossings, dense
from clvox.ops import fill as fills
from clvox.ops.facets import Facets, Progress, upload_facets
from clvox.ops.fill import Winding
from clvox.ops.layout import Bricks, Cells, VoxelArrays, cell_shape, words_for
from clvox.ops.multilevel import carry, rank_cells

if TYPE_CHECKING:
    import pyopencl.array as cla

Fill: TypeAlias = Literal["parity", "nonzero", "positive", "surface"]
"""What is inside: see `voxelize`."""

WINDINGS = {"nonzero": Winding.NONZERO, "positive": Winding.POSITIVE}
"""The fills that go by winding numbers."""


def construct(
    session: Session,
    surface: Surface,
    lattice: Lattice,
    levels: tuple[Shape, ...],
    fill: Fill,
    tell: Progress | None,
) -> VoxelModel:
    """Return the model of *surface* on the grid of *lattice*, with *levels*, filled by *fill*."""
    session.reset_peak()
    seconds: dict[str, float] = {}
    with _timed(session, seconds, "snap"):
        vertices = lattice.snap(surface.vertices)
    with _timed(session, seconds, "upload"):
        facets = upload_facets(session, vertices, surface.faces)
        collapsed = boundary.count_flat(session, facets)
    build = _Build(session, facets, lattice, levels, fill, tell, seconds)
    arrays = build.arrays()
    warnings = list(surface.warnings)
    if build.odd_rays or build.disagreements:
        warnings.append(
            f"{build.odd_rays} rays cross the mesh an odd number of times and "
            f"{build.disagreements} untouched cells are in and out at once: please report this mesh"
        )
    report = Report(
        device=str(session.device),
        fill=fill,
        seconds=seconds,
        triangles=len(surface.faces),
        repeated=surface.repeated,
        duplicates=surface.duplicates,
        cancelled=surface.cancelled,
        collapsed=collapsed,
        odd_rays=build.odd_rays,
        lattice_bits=lattice.bits,
        peak_nbytes=session.peak_nbytes,
        warnings=tuple(warnings),
    )
    return VoxelModel(session, lattice.grid, arrays, report, ((surface, lattice),))


@contextmanager
def _timed(session: Session, seconds: dict[str, float], stage: str) -> Iterator[None]:
    """Add to *seconds* what a stage takes; it ends with the device idle."""
    start = time.perf_counter()
    yield
    session.finish()
    seconds[stage] = seconds.get(stage, 0.0) + time.perf_counter() - start


@dataclass
class _Build:
    """One model in the making: what its stages share, and what they find."""

    session: Session
    facets: Facets
    lattice: Lattice
    levels: tuple[Shape, ...]
    fill: Fill
    tell: Progress | None
    seconds: dict[str, float] = field(default_factory=dict)
    odd_rays: int = 0
    disagreements: int = 0

    @property
    def shape(self) -> Shape:
        """Voxels along each axis."""
        return self.lattice.grid.shape

    def arrays(self) -> VoxelArrays:
        """Return the model."""
        if len(self.levels) == 1:
            return self._mark_dense() if self.fill == "surface" else self._fill_dense()
        cells = self._mark_cells()
        return self._mark_bricks(cells) if self.fill == "surface" else self._fill_bricks(cells)

    def _stage(self, name: str) -> AbstractContextManager[None]:
        return _timed(self.session, self.seconds, name)

    def _part(self, part: int) -> Progress | None:
        """Progress of one of two passes over the triangles, as progress of the whole."""
        tell = self.tell
        if tell is None:
            return None
        return lambda done, total: tell(part * total + done, 2 * total)

    # Cells

    def _mark_cells(self) -> Cells:
        """The touched cells of each level above the voxels."""
        counts, sides = self.levels[0], self.levels[1]
        if len(self.levels) == 3:
            x, y, z = (a * b for a, b in zip(self.levels[1], self.levels[2], strict=True))
            sides = x, y, z
        bits, shape = self.lattice.bits, self.shape
        with self._stage("mark"):
            marks = boundary.mark_cells(
                self.session, self.facets, bits, shape, sides, progress=self._part(0)
            )
        with self._stage("rank"):
            cells = rank_cells(self.session, marks, counts, self.levels[1])
        if len(self.levels) == 2:
            return cells
        brick = self.levels[2]
        counts = cell_shape(shape, brick)
        with self._stage("mark"):
            marks = boundary.mark_voxels(self.session, self.facets, bits, counts, cells, side=brick)
        with self._stage("rank"):
            finer = rank_cells(self.session, marks, counts, brick)
        return replace(cells, finer=finer)

    # Voxels

    def _fill_bricks(self, cells: Cells) -> VoxelArrays:
        with self._stage("clear"):
            bricks = Bricks.cleared(self.session, cells)
        with self._stage("flip"):
            self._flip_bricks(cells, bricks)
        with self._stage("carry"):
            solid = carry(self.session, cells, bricks, self.shape)
        self.odd_rays, self.disagreements = solid.odd_rays, solid.disagreements
        return VoxelArrays(self.shape, bricks.voxels, cells, solid.inside, solid.middle_inside)

    def _flip_bricks(self, cells: Cells, bricks: Bricks) -> None:
        mesh, winding = (self.session, self.facets, self.lattice.bits), WINDINGS.get(self.fill)
        if winding is None:
            crossings.flip_bricks(*mesh, cells, bricks, progress=self._part(1))
        else:
            fills.flip_bricks(*mesh, cells, winding, bricks, progress=self._part(1))

    def _fill_dense(self) -> VoxelArrays:
        nx, ny, nz = self.shape
        with self._stage("clear"):
            voxels = self.session.zeros((nz, ny, words_for(nx)), np.uint32)
            beyond = self.session.zeros((nz, words_for(nx)), np.uint32)
        with self._stage("flip"):
            self._flip_dense(voxels, beyond)
        with self._stage("carry"):
            self.odd_rays = dense.fill(self.session, voxels, beyond)
        return VoxelArrays(self.shape, voxels)

    def _flip_dense(self, voxels: cla.Array, beyond: cla.Array) -> None:
        mesh, winding = (self.session, self.facets, self.lattice.bits), WINDINGS.get(self.fill)
        part = self._part(1)
        if winding is None:
            crossings.flip_dense(*mesh, self.shape, voxels, beyond, progress=part)
        else:
            fills.flip_dense(*mesh, self.shape, winding, voxels, beyond, progress=part)

    # Touched voxels: marks are all there is to them

    def _mark_bricks(self, cells: Cells) -> VoxelArrays:
        mesh = self.session, self.facets, self.lattice.bits
        with self._stage("flip"):
            voxels = boundary.mark_voxels(*mesh, self.shape, cells, progress=self._part(1))
        inside = self.session.zeros(cells.boundary.shape, np.uint32)
        middle = self.session.zeros(cells.finer.boundary.shape, np.uint32) if cells.finer else None
        return VoxelArrays(self.shape, voxels, cells, inside, middle)

    def _mark_dense(self) -> VoxelArrays:
        mesh = self.session, self.facets, self.lattice.bits
        with self._stage("mark"):
            marks = boundary.mark_cells(*mesh, self.shape, (1, 1, 1), progress=self._part(1))
        return VoxelArrays(self.shape, marks)
