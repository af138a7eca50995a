"""The stages that make the dexels of a mesh: snap, upload, list."""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace

from clvox.device import Session
from clvox.device.job import Job
from clvox.grid import Axis, Lattice
from clvox.mesh import Surface
from clvox.models.construct import timed
from clvox.models.dexel_memory import DexelRoom
from clvox.models.dexel_report import DexelReport
from clvox.models.dexel_sources import Source, Sources
from clvox.models.dexels import AXES, DexelModel
from clvox.models.memory import LEAST_WORK, SMALL
from clvox.models.sending import VISIT_BYTES, SentMesh
from clvox.models.telling import Told
from clvox.ops import boundary
from clvox.ops.facets import Facets, Progress
from clvox.ops.lists import CrossingLists, Listing
from clvox.reference.fill import FillRule

_COUNTED = 0.3
"""Which part of the work counting is, more or less."""


def construct_dexels(
    session: Session,
    surface: Surface,
    lattice: Lattice,
    axes: list[Axis],
    fill: FillRule,
    budget: int,
    tell: Progress | None,
) -> list[DexelModel]:
    """Return the models of *surface* along *axes*, on the grid of *lattice*.

    budget: bytes of the device that may be taken at once, the models included.
    """
    count = len(surface.faces)
    first: dict[str, float] = {}
    with timed(session, first, "snap"):
        vertices = lattice.snap(surface.vertices)
    told = Told(session, tell, len(axes) * count)
    sources = Sources((Source(count, surface),))
    models = []
    with session.job(budget, told.again) as job:
        room = DexelRoom(session, job, lattice.grid, surface, axes)
        build = _Build(room, lattice, SentMesh(session, vertices, surface.faces), first)
        for number, axis in enumerate(axes):
            build.seconds = dict(first)
            start, stop = number / len(axes), (number + 1) / len(axes)
            middle = start + _COUNTED * (stop - start)
            lists = build.list(axis, told.part(start, middle), told.part(middle, stop))
            report = replace(
                DexelReport.of_mesh(session.device, surface, lattice, fill),
                seconds=build.seconds,
                collapsed=build.collapsed or 0,
                peak_nbytes=job.peak_nbytes,
            )
            solid = fill, lattice.bits, lists
            models.append(DexelModel(session, lattice.grid, axis, *solid, sources, report))
    return models


@dataclass
class _Build:
    """Bundles in the making: what they share, and what is found."""

    room: DexelRoom
    lattice: Lattice
    sent: SentMesh
    seconds: dict[str, float] = field(default_factory=dict)
    collapsed: int | None = None

    @property
    def session(self) -> Session:
        """The device."""
        return self.room.session

    @property
    def job(self) -> Job:
        """What the bundles may take."""
        return self.room.job

    def list(self, axis: Axis, counted: Progress | None, written: Progress | None) -> CrossingLists:
        """Return the crossings of the rays along *axis*."""
        shape, number = self.lattice.grid.shape, AXES.index(axis)
        self.room.require()
        listing = Listing(self.session, self.lattice.bits, shape, number)
        later = self.room.later_nbytes(axis)
        _, counting = Listing.nbytes_of(self.session, shape, number)
        spare = self._send(later + counting)
        with self._stage("list"):
            listing.count(self.sent.facets, self._most(spare), counted)
        self.room.crossings[axis] = listing.total
        self.room.require(listing.work_nbytes)
        reserved = later + listing.list_nbytes
        spare = self.job.left - reserved - SMALL
        if not listing.keeps_bins or spare < LEAST_WORK // 2:
            # The mesh may be in the way, and the bins; or its parts are too large by now.
            listing.forget()
            spare = self._send(reserved)
        with self._stage("list"):
            return listing.write(self.sent.facets, self._most(spare), written)

    def _stage(self, name: str) -> AbstractContextManager[None]:
        return timed(self.session, self.seconds, name)

    def _most(self, spare: int) -> int:
        """Bytes of a buffer at most, too."""
        return min(spare, self.session.device.largest_allocation)

    def _send(self, reserved: int) -> int:
        """Send the mesh, or prepare to send it in parts; return the bytes that bins may take.

        reserved: bytes that are yet to be allocated for something else.
        """
        spare = self.job.left + self.sent.nbytes - reserved - SMALL
        with self._stage("upload"):
            self.sent.fit(spare * 2 // 3)
            if self.collapsed is None:
                self.collapsed = boundary.count_flat(self.session, self.sent.facets)
        if isinstance(self.sent.facets, Facets):
            return spare - self.sent.nbytes - VISIT_BYTES * self.sent.facets.triangles
        return spare // 4
