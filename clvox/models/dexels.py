"""The dexel model: solid pieces of parallel rays, a frozen value."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from clvox.device import Session, open_session
from clvox.errors import GridError
from clvox.grid import Axis, Grid, Lattice
from clvox.models import archive, dexel_archive
from clvox.models.booleans import Combinable
from clvox.models.cutter import Cutter
from clvox.models.dexel_moments import Integrals
from clvox.models.dexel_report import DexelReport
from clvox.models.dexel_sources import Source, Sources
from clvox.models.dexel_surface import move_vertices
from clvox.models.levels import Levels, resolve_levels
from clvox.models.memory import find_budget
from clvox.models.milling import Cut, Work, moves_of
from clvox.models.report import Report
from clvox.models.telling import drawn
from clvox.models.voxels import VoxelModel
from clvox.ops import combine, dexel_measure, dexel_voxels, dexels
from clvox.ops.combine import Operation
from clvox.ops.crossings import fraction_bits
from clvox.ops.dexels import Frame, Rule
from clvox.ops.facets import Progress
from clvox.ops.layout import VoxelArrays
from clvox.ops.lists import CrossingLists

AXES: tuple[Axis, ...] = "x", "y", "z"

MOST_MESHES = 16
"""From so many meshes on, those that no end comes from are dropped now and then."""

_REPORTED = 100
"""Most triangles of odd rays that a report names."""


@dataclass(frozen=True, eq=False, repr=False)
class DexelModel(Combinable):
    """A solid as pieces of parallel rays through the voxel centres of a grid.

    Made by `dexelize`, `DexelModel.from_voxels` and `open`; never changed afterwards.  A ray has
    any number of crossings.

    Attributes
    ----------
    grid : Grid
        The grid whose voxel centres the rays run through; the solid ends at its box.
    axis : "x", "y" or "z"
        The direction of the rays.
    fill : str
        The rule that says what is inside, see `voxelize`; "" for a model made of others.
    lattice_bits : int
        Steps in a voxel, as a power of two, of the lattice that the solid was decided on.
    """

    _session: Session
    grid: Grid
    axis: Axis
    fill: str
    lattice_bits: int
    _crossings: CrossingLists
    _sources: Sources
    _built: DexelReport

    @classmethod
    def from_voxels(
        cls, model: VoxelModel, *, axis: Axis = "z", lattice_bits: int | None = None
    ) -> DexelModel:
        """Return the pieces of a voxel model: they end half-way between two voxels' centres.

        Parameters
        ----------
        model : VoxelModel
        axis : "x", "y" or "z"
        lattice_bits : int, optional
            As for `dexelize`, so that the model can be combined with others; by default that of
            the mesh which the voxels were made of, if they were.

        Raises
        ------
        GridError
            There is no such axis, or the lattice does not hold the grid.
        """
        if axis not in AXES:
            raise GridError(f"axis must be 'x', 'y' or 'z', got {axis!r}")
        grid, session = model.grid, model._session
        if lattice_bits is None and model._surfaces:
            lattice_bits = model._surfaces[0][1].bits
        bits = Lattice.fit(grid, grid.bounds, bits=lattice_bits).bits
        frame = Frame(grid.shape, AXES.index(axis), fraction_bits(bits))
        bitmap = combine.rebrick(session, model._arrays, (grid.shape,)).voxels
        pieces = dexel_voxels.from_dense(session, frame, bitmap)
        report = DexelReport(str(session.device))
        return cls(session, grid, axis, "", bits, pieces, Sources(), report)

    # What it is

    @property
    def rays_shape(self) -> tuple[int, int]:
        """Shape of an array with an entry for each ray: the grid's [z, y, x] without the axis."""
        first, second = self._frame.across
        return second, first

    @cached_property
    def offsets(self) -> NDArray[np.uint64]:
        """Where the crossings of each ray begin, (rays + 1,); rays as in `rays_shape`, flattened.

        Crossings are ordered by depth, then by triangle.  A model made of others has the ends of
        its pieces in their place.
        """
        return _frozen(self._crossings.offsets.get())

    @cached_property
    def fixed_depths(self) -> NDArray[np.int32]:
        """Depth of each crossing as it is stored: fixed point in voxels, rounded up.

        0 is the centre of the first voxel, and `fraction_bits` binary places follow the point.
        """
        return _frozen(self._crossings.depth.get())

    @property
    def fraction_bits(self) -> int:
        """Binary places of `fixed_depths`."""
        return self._crossings.fraction_bits

    @cached_property
    def depths(self) -> NDArray[np.float64]:
        """Coordinate along the axis of each crossing, in the length unit of the grid."""
        return _frozen(self._along(self.fixed_depths))

    @property
    def triangles(self) -> NDArray[np.int64]:
        """Triangle of each crossing, as the caller's mesh numbers it.

        -1 where the grid's box cuts the solid, and in a model made of voxels.
        """
        return self._split[1]

    @property
    def operands(self) -> NDArray[np.int32]:
        """Mesh of each crossing, 0 in a model of one mesh; -1 where `triangles` is.

        A model made of others has their meshes, each once, in the order in which they came in.
        """
        return self._split[0]

    @cached_property
    def signs(self) -> NDArray[np.int32]:
        """+1 for each crossing that goes in, -1 for those that go out.

        In a model of one mesh as the triangle faces; in one made of others as the solid says.
        """
        return _frozen(self._crossings.sign())

    def intervals(
        self,
    ) -> tuple[NDArray[np.uint64], NDArray[np.float64], NDArray[np.float64]]:
        """Return the solid pieces of all rays: what is inside by the fill rule.

        Crossings of one depth act together, so solids that touch merge, and no piece is without
        length.  Pieces end at the faces of the grid's box.

        Returns
        -------
        offsets : (rays + 1,) uint64
            Where the pieces of each ray begin.
        enter, leave : (n,) float64
            Coordinates along the axis, increasing along each ray.
        """
        pieces = self._pieces
        depths = self._along(pieces.depth.get())
        return pieces.offsets.get() // np.uint64(2), depths[::2].copy(), depths[1::2].copy()

    @cached_property
    def report(self) -> DexelReport:
        """How the model was built, and what its rays are like."""
        crossings, pieces = self._crossings, self._pieces
        found = dexel_measure.examine(self._session, self._frame, crossings, pieces)
        thinnest = found.thinnest_ray
        return replace(
            self._built,
            crossings=crossings.count,
            deepest=found.depth,
            deepest_ray=self._place(found.deepest_ray),
            thinnest=found.thinnest * self._unit,
            thinnest_ray=None if thinnest < 0 else self._place(thinnest),
            odd_rays=found.odd_rays,
            odd_triangles=self._odd_triangles() if found.odd_rays else (),
        )

    @property
    def nbytes(self) -> int:
        """Bytes of device memory that the model holds."""
        pieces = self.__dict__.get("_pieces", self._crossings)
        more = 0 if pieces is self._crossings else pieces.nbytes
        return int(self._crossings.nbytes + more)

    @property
    def device(self) -> str:
        """The device that holds the model."""
        return str(self._session.device)

    def __repr__(self) -> str:
        rows, along = self.rays_shape
        size = f"{self.nbytes / 1e6:.1f} MB" if self.nbytes >= 1e5 else f"{self.nbytes} bytes"
        return (
            f"DexelModel({along} x {rows} rays along {self.axis}, {self._crossings.count:,} "
            f"crossings, {size} on {self.device})"
        )

    def __eq__(self, other: object) -> bool:
        """Whether both have the same pieces on the same rays, from whatever triangles."""
        if not isinstance(other, DexelModel):
            return NotImplemented
        if self is other:
            return True
        if self.grid != other.grid or self._frame != other._frame:
            return False
        other = other._on(self._session)
        return not dexels.differ(self._session, self._frame, self._pieces, other._pieces)

    def __hash__(self) -> int:
        return hash((self.grid, self.axis))

    def __reduce__(self) -> tuple[Any, ...]:
        return _restore, (self.to_record(), self._built, self._sources)

    # Combinations

    def __invert__(self) -> DexelModel:
        """The grid's box without the model."""
        pieces = dexels.complement(self._session, self._frame, self._pieces)
        return self._with(pieces, self._sources)

    # Milling

    def cut(
        self,
        cutter: Cutter,
        path: ArrayLike,
        *,
        memory_budget: int | None = None,
        progress: bool | Progress | None = None,
    ) -> Cut:
        """Return what is left after a cutter has moved along a path, and what each move took.

        The rays must be along z, as the cutter's axis is.  Each move sweeps an exact volume, of
        which all is taken that lies in the solid; what is left ends to 2**-`fraction_bits` of a
        voxel.

        Parameters
        ----------
        cutter : Cutter
        path : (n + 1, 3) float64
            Where the tip of the cutter goes, on straight lines: n moves.
        memory_budget : int, optional
            Most bytes of the device that what is left may take; by default most of what is free.
            The moves are worked out on the host, and take nothing there.
        progress : bool or callable, optional
            True draws a bar; a function is called with (done, total) moves.  An exception that it
            raises ends the work.

        Returns
        -------
        Cut

        Raises
        ------
        GridError
            The rays are not along z, the cutter is no `Cutter`, or the path is not of finite
            points.
        OutOfMemoryError
            The device has no room for what is left.

        Examples
        --------
        >>> import clvox, trimesh
        >>> block = clvox.dexelize(trimesh.creation.box((20.0, 20.0, 5.0)), pitch=0.25)
        >>> cut = block.cut(clvox.Cutter.ball(2.0), [(-12, 0, 1.5), (12, 0, 1.5)])
        >>> bool(cut.removed[0] == block.volume - cut.model.volume)
        True
        """
        if self.axis != "z":
            raise GridError(f"a cutter's axis is z, so the rays must be along z, got {self.axis}")
        if not isinstance(cutter, Cutter):
            raise GridError(
                f"cutter must be a Cutter, got {cutter!r}. Make one with Cutter.flat, Cutter.ball "
                "or Cutter.bull."
            )
        moves = list(moves_of(path))
        budget = find_budget(self._session, memory_budget)
        sources, _ = self._sources.joined(Sources((Source(len(moves)),)))
        with self._session.job(budget) as job:
            # Where the rays begin, which whatever is left has: better refused before the work.
            job.refuse(self._session.size_of(self._crossings.offsets.nbytes))
        work = Work(self.grid, self._frame, self._pieces)
        with drawn(progress=progress, verb="cut", unit="moves") as tell:
            removed, engagement = work.cut_all(cutter, moves, tell)
        with self._session.job(budget):
            left = work.left(self._session, sources.starts[-2])
            return Cut(self._with_used(left, sources), removed, engagement)

    def moved(self, transform: ArrayLike, *, grid: Grid | None = None) -> DexelModel:
        """Return the model moved, by way of its mesh: as if it were clamped anew.

        A mesh of one bundle is rough across its rays; `TripleDexelModel.moved` loses less.

        Parameters
        ----------
        transform : (4, 4) float64
            As for `trimesh.Trimesh.apply_transform`.
        grid : Grid, optional
            Where the result is; the grid of this model by default.

        Raises
        ------
        MeshError
            Nothing is inside.
        GridError
            The transform is not (4, 4) finite numbers, or takes the model so far from the grid
            that this model's lattice does not hold both.
        """
        from clvox.models.dexel_build import remade

        return remade(self.to_mesh(), transform, grid or self.grid, self)

    # Measures

    @property
    def volume(self) -> float:
        """Volume of the pieces, each a bar of a voxel's section.

        Their sum in voxels is exact and then rounded; it is multiplied by `Grid.voxel_volume`,
        a product of floats.
        """
        return float(self._integrals.volume) * self.grid.voxel_volume

    @property
    def center_mass(self) -> NDArray[np.float64]:
        """Centre of mass of the bars, (x, y, z) float64; NaN, three times, if there are none.

        From sums of integers, so the same on every device.
        """
        return self._integrals.center()

    @property
    def moment_inertia(self) -> NDArray[np.float64]:
        """Moments of inertia of the bars about the centre of mass, at density 1; (3, 3) float64.

        As `trimesh.Trimesh.moment_inertia`; from sums of integers, so the same on every device.
        """
        return self._integrals.inertia()

    def thickness(self) -> NDArray[np.float64]:
        """Return how much of each ray is inside, as an image of the shape `rays_shape`.

        In the length unit of the grid.
        """
        lengths = dexel_measure.sum_lengths(self._session, self._frame, self._pieces)
        image: NDArray[np.float64] = lengths.reshape(self.rays_shape) * np.float64(self._unit)
        return image

    def column_fractions(self, *, cells: int = 1) -> NDArray[np.float32]:
        """Return which fraction of each cell is inside, measured along the ray through it.

        Partial occupancy, without more than one ray to a cell.

        Parameters
        ----------
        cells : int
            Voxels along the ray in a cell; across it, a cell is one voxel wide.

        Returns
        -------
        ndarray of float32
            Indexed [z, y, x], with ceil(voxels / cells) cells along the axis.  Where the grid ends
            within a cell, the fraction is of its part in the grid.

        Raises
        ------
        GridError
            *cells* is not a positive integer.
        """
        if not isinstance(cells, int | np.integer) or cells < 1:
            raise GridError(f"cells must be a positive integer, got {cells!r}")
        frame = self._frame
        count = frame.shape[frame.axis]
        side = min(int(cells), count)
        lengths = dexel_measure.sum_cells(self._session, frame, self._pieces, side)
        held = np.minimum(side, count - np.arange(0, count, side)) << frame.fraction_bits
        shape = [-1 if a == 2 - frame.axis else 1 for a in range(3)]
        fractions: NDArray[np.float32] = (lengths / held.reshape(shape)).astype(np.float32)
        return fractions

    # Questions

    def contains(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Return whether each point lies in a piece of the ray through the middle of its column.

        Along the ray, the answer is that of the point itself; a piece owns where it begins.

        Parameters
        ----------
        points : (n, 3) float64
            Outside of the grid, and for NaN, the answer is False.

        Returns
        -------
        (n,) bool
        """
        voxels = self.grid.indices(points)
        where = np.asarray(points, dtype=np.float64)
        frame = self._frame
        u, v = (a for a in range(3) if a != frame.axis)
        rays = voxels[:, v].astype(np.int64) * frame.across[0] + voxels[:, u]
        outside = voxels[:, 0] < 0
        rays[outside] = -1
        along = np.where(outside, self.grid.origin[frame.axis], where[:, frame.axis])
        depth = (along - self.grid.origin[frame.axis]) / self.grid.spacing[frame.axis] - 0.5
        places = np.floor(depth * (1 << frame.fraction_bits)).astype(np.int32)
        return dexel_measure.look_up(self._session, self._pieces, rays, places).view(np.bool_)

    # Ways out

    def to_voxels(self, *, levels: Levels | None = None) -> VoxelModel:
        """Return the voxels whose samples are inside: those that `voxelize` finds.

        Parameters
        ----------
        levels
            As for `voxelize`.  Cells whose voxels are all alike have no brick, as in a compact
            model.

        Raises
        ------
        GridError
            The levels do not hold the grid's shape.
        OutOfMemoryError
            There is no room for a bit for each voxel of the grid.
        """
        shapes = resolve_levels(self.grid.shape, levels)
        bitmap = dexel_voxels.to_dense(self._session, self._frame, self._pieces)
        arrays = VoxelArrays(self.grid.shape, bitmap)
        if len(shapes) > 1:
            arrays = combine.rebrick(self._session, arrays, shapes, prune=True)
        return VoxelModel(self._session, self.grid, arrays, Report(device=self.device))

    def to_mesh(self) -> trimesh.Trimesh:
        """Return the surface, by marching cubes: closed and oriented.

        Vertices on edges along the rays lie where the ray crosses the surface; the others, of which
        the rays tell nothing, half-way between two samples.

        Returns
        -------
        trimesh.Trimesh
            Without triangles if no sample is inside.
        """
        return move_vertices(self.to_voxels().to_mesh(), [self])

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the model to *path*, a ``.npz`` file: the arrays of docs/layouts, and the grid.

        The meshes are not in it, so the numbers of triangles are those of the checked mesh.
        """
        archive.write(path, self.to_record())

    def to_record(self) -> dict[str, NDArray[Any]]:
        """Return the grid and the arrays of the model, as docs/layouts describes them."""
        counts = [mesh.triangles for mesh in self._sources.meshes]
        axis = AXES.index(self.axis)
        rays = dexel_archive.Rays(axis, self.lattice_bits, self.fill, self._crossings, counts)
        return dexel_archive.pack(self.grid, rays)

    # Inside

    @cached_property
    def _frame(self) -> Frame:
        return Frame(self.grid.shape, AXES.index(self.axis), self._crossings.fraction_bits)

    @property
    def _unit(self) -> float:
        """Length of one unit of the depth."""
        return self.grid.spacing[self._frame.axis] / (1 << self.fraction_bits)

    @cached_property
    def _pieces(self) -> CrossingLists:
        """The ends of the pieces, in and out by turns."""
        if not self.fill:
            return self._crossings
        rule = Rule[self.fill.upper()]
        return dexels.resolve(self._session, self._frame, self._crossings, rule)

    @cached_property
    def _integrals(self) -> Integrals:
        sums = dexel_measure.sum_moments(self._session, self._frame, self._pieces)
        return Integrals(self.grid, self._frame, sums)

    @cached_property
    def _split(self) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
        operands, triangles = self._sources.split(self._crossings.triangle().astype(np.int64))
        return _frozen(operands), _frozen(triangles)

    def _along(self, depths: NDArray[np.int32]) -> NDArray[np.float64]:
        """Coordinates along the axis of depths."""
        axis = self._frame.axis
        voxels = depths / (1 << self.fraction_bits) + 0.5
        along: NDArray[np.float64] = self.grid.origin[axis] + voxels * self.grid.spacing[axis]
        return along

    def _place(self, ray: int) -> tuple[int, int]:
        row, column = divmod(ray, self.rays_shape[1])
        return row, column

    def _odd_triangles(self) -> tuple[int, ...]:
        ends = self.offsets.astype(np.int64)
        counts = ends[1:] - ends[:-1]
        triangles = self.triangles[np.repeat(counts % 2 == 1, counts)]
        return tuple(np.unique(triangles)[:_REPORTED].tolist())

    def _combined(self, other: DexelModel, operation: Operation) -> DexelModel:
        if self.grid != other.grid or self.axis != other.axis:
            raise GridError(
                f"the models are on different rays: along {self.axis} of {self.grid} and along "
                f"{other.axis} of {other.grid}. Dexelize both on one grid (grid=) and axis."
            )
        if self.lattice_bits != other.lattice_bits:
            bits = sorted([self.lattice_bits, other.lattice_bits])
            raise GridError(
                f"the models are on different lattices of the grid {self.grid}: lattice_bits are "
                f"{' and '.join(map(str, bits))}. Dexelize both with the smaller one."
            )
        session, frame = self._session, self._frame
        other = other._on(session)
        sources, renumbering = self._sources.joined(other._sources)
        pieces = self._pieces, other._pieces
        made = dexels.combine(session, frame, *pieces, operation, renumbering)
        return self._with_used(made, sources)

    def _with_used(self, pieces: CrossingLists, sources: Sources) -> DexelModel:
        """A model that another one became; of many meshes it keeps those that have an end."""
        if len(sources.meshes) > max(MOST_MESHES, 2 * sources.kept):
            used = dexels.used_meshes(self._session, pieces, sources.starts[:-1])
            sources, renumbering = sources.only(used)
            dexels.renumber(self._session, pieces, renumbering)
        return self._with(pieces, sources)

    def _with(self, pieces: CrossingLists, sources: Sources) -> DexelModel:
        """A model that another one became."""
        report = DexelReport(self.device)
        rays = self._session, self.grid, self.axis
        return DexelModel(*rays, "", self.lattice_bits, pieces, sources, report)

    def _on(self, session: Session) -> DexelModel:
        """The same model on the device of *session*."""
        if session is self._session:
            return self
        return _unpack(session, self.to_record(), self._built, self._sources)


def _unpack(
    session: Session,
    record: dict[str, NDArray[Any]],
    report: DexelReport | None = None,
    sources: Sources | None = None,
) -> DexelModel:
    grid, rays = dexel_archive.unpack(session, record)
    return from_rays(session, grid, rays, report, sources)


def from_rays(
    session: Session,
    grid: Grid,
    rays: dexel_archive.Rays,
    report: DexelReport | None = None,
    sources: Sources | None = None,
) -> DexelModel:
    """Return the model of arrays that were read."""
    report = report or DexelReport(str(session.device))
    sources = sources or dexel_archive.sources_of(rays)
    solid = rays.fill, rays.lattice_bits, rays.crossings
    return DexelModel(session, grid, AXES[rays.axis], *solid, sources, report)


def _restore(record: dict[str, NDArray[Any]], report: DexelReport, sources: Sources) -> DexelModel:
    return _unpack(open_session(), record, report, sources)


def _frozen(array: NDArray[Any]) -> NDArray[Any]:
    array.flags.writeable = False
    return array
