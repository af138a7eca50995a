"""The voxel model: a frozen value, each property a thin call of one operation."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from io import BytesIO
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from clvox import surface as surfaces
from clvox.device import DeviceLike, Session, open_session
from clvox.errors import GridError, MeshError
from clvox.grid import Grid, Lattice, Shape
from clvox.mesh import MeshLike, Surface
from clvox.models import archive, updates
from clvox.models.attributes import Attribute, Attributes, build_attributes
from clvox.models.booleans import Combinable
from clvox.models.expand import RuleName, check_bounds, expand_layers, find_rule
from clvox.models.levels import Levels, resolve_levels
from clvox.models.memory import find_budget
from clvox.models.moments import center_of_mass, inertia
from clvox.models.outline import corners_of
from clvox.models.report import Report
from clvox.models.snapping import swept_volume
from clvox.ops import combine, measure, pack, query
from clvox.ops.boundary import mark_cells, mark_voxels
from clvox.ops.combine import Operation
from clvox.ops.drawing import Drawing
from clvox.ops.facets import Progress, upload_facets
from clvox.ops.layout import VoxelArrays
from clvox.ops.query import Rule

if TYPE_CHECKING:
    import pyopencl.array as cla

    from clvox.models.build import Fill

OUTSIDE, INSIDE, BOUNDARY = 0, 1, 2
"""What `VoxelModel.classify` and coarse levels say."""

NOTEBOOK_SIZE = 640, 400
"""Pixels of the picture that notebooks show."""


@dataclass(frozen=True, eq=False, repr=False)
class VoxelModel(Combinable):
    """A solid as voxels, on one level, two or three, on an OpenCL device.

    Made by `voxelize`, `VoxelModel.from_array` and `open`; never changed afterwards.

    Attributes
    ----------
    grid : Grid
        Where the voxels are.
    levels : tuple of (3,) int
        Cells of the coarse grid, and cells or voxels in each of them, level by level; for a
        dense grid its shape alone.
    report : Report
        How the model was built.
    """

    _session: Session
    grid: Grid
    _arrays: VoxelArrays
    report: Report
    _surfaces: tuple[tuple[Surface, Lattice], ...] = ()
    _attributes: Attributes | None = None

    @classmethod
    def from_array(
        cls,
        voxels: ArrayLike,
        grid: Grid,
        *,
        levels: Levels | None = None,
        device: DeviceLike = None,
    ) -> VoxelModel:
        """Return the model whose voxels are those that are true in *voxels*.

        Parameters
        ----------
        voxels : (nz, ny, nx) bool
            Indexed [z, y, x].
        grid : Grid
            Of the shape (nx, ny, nz).
        levels, device
            As for `voxelize`.

        Raises
        ------
        GridError
            The array has not the grid's shape, or *levels* do not agree with it.
        """
        array = np.asarray(voxels)
        if array.shape != grid.array_shape:
            raise GridError(
                f"an array of this grid's voxels has the shape {grid.array_shape} (z, y, x), got "
                f"{array.shape}"
            )
        array = np.ascontiguousarray(array, dtype=np.bool_)
        session = open_session(device)
        shapes = resolve_levels(grid.shape, levels)
        if len(shapes) == 1:
            arrays = pack.pack_dense(session, array)
        else:
            arrays = pack.pack_voxels(session, array, shapes[-1])
        if len(shapes) == 3:
            arrays = combine.rebrick(session, arrays, shapes)
        return cls(session, grid, arrays, Report(device=str(session.device)))

    # What it is

    @property
    def levels(self) -> tuple[Shape, ...]:
        """Cells of the coarse grid, and cells or voxels in each; of a dense grid its shape."""
        return self._arrays.levels

    @property
    def nbytes(self) -> int:
        """Bytes of device memory that the model holds."""
        drawing = self.__dict__.get("_drawing")
        held = self._arrays.nbytes + (drawing.nbytes if drawing is not None else 0)
        if self._attributes is not None:
            return held + self._attributes.nbytes
        edge = self.__dict__.get("_edge")
        return held + (edge.nbytes if edge is not None else 0)

    @property
    def bounds(self) -> NDArray[np.float64]:
        """Lowest and highest corner of the coarse cells that are not empty, (2, 3) float64.

        In a dense model cells of 8 x 8 x 8 voxels; the whole grid's if all of them are empty.
        """
        return np.stack([self.outline.min(axis=0), self.outline.max(axis=0)])

    @cached_property
    def outline(self) -> NDArray[np.float64]:
        """Points whose convex hull holds the model, (n, 3) float64: corners of its coarse cells."""
        if len(self.levels) > 1:
            side = _triple(np.prod(self.levels[1:], axis=0))
            return corners_of(self.grid, self.to_array(level=0) != 0, side)
        return corners_of(self.grid, self.coverage(cells=8) > 0, (8, 8, 8))

    @property
    def attributes(self) -> tuple[Attribute, ...]:
        """What the model keeps of its mesh: the *attributes* that `voxelize` was asked for."""
        return () if self._attributes is None else self._attributes.names

    @property
    def device(self) -> str:
        """The device that holds the model."""
        return str(self._session.device)

    def __repr__(self) -> str:
        x, y, z = self.grid.shape
        bricks = ""
        if len(self.levels) > 1:
            sides = ["{} x {} x {}".format(*brick) for brick in self.levels[1:]]
            bricks = f" in cells of {' of '.join(sides)}"
        size = f"{self.nbytes / 1e6:.1f} MB" if self.nbytes >= 1e5 else f"{self.nbytes} bytes"
        return f"VoxelModel({x} x {y} x {z} voxels{bricks}, {size} on {self.device})"

    def __eq__(self, other: object) -> bool:
        """Whether both have the same grid and the same voxels, on whatever levels."""
        if not isinstance(other, VoxelModel):
            return NotImplemented
        if self is other:
            return True
        if self.grid != other.grid or self.count != other.count:
            return False
        other = other._on(self._session)
        mine, theirs = self._arrays, other._arrays
        differing = combine.combine(self._session, mine, theirs, Operation.XOR)
        return not measure.count_voxels(self._session, differing)

    def __hash__(self) -> int:
        return hash((self.grid, self.count))

    def __reduce__(self) -> tuple[Any, ...]:
        record = self.to_record()
        return restore, (record, self.report, self._surfaces, None, self.attributes)

    # Combinations

    def __invert__(self) -> VoxelModel:
        """The voxels of the grid's box that are not inside."""
        return self._with(combine.complement(self._session, self._arrays), self._surfaces)

    def compact(self) -> VoxelModel:
        """Return the same voxels without bricks whose voxels are all alike.

        Combining models leaves such bricks: they cost memory and change no answer.  The mesh may
        touch voxels of some of them, so a compact model no longer knows which are touched.
        """
        arrays = combine.rebrick(self._session, self._arrays, self.levels, prune=True)
        return self._with(arrays, ())

    def updated(self, mesh: MeshLike | Surface, *, changed: ArrayLike) -> VoxelModel:
        """Return the model of this model's mesh after an edit: some of its triangles moved.

        It is that of ``voxelize(mesh, grid=model.grid, levels=model.levels)`` on this model's
        lattice (``lattice_bits=model.report.lattice_bits``), bit for bit: the same voxels in the
        same bricks.  Only the crossings of changed triangles are looked for, as they were and as
        they are (Young 2017), so that it costs less the less has changed; but by a fill other than
        "parity" everything is done anew.

        Parameters
        ----------
        mesh : trimesh.Trimesh, path, or (vertices, faces)
            With as many triangles as the mesh that was voxelized, in the same order; closed, as
            the fill demands.
        changed : (n,) int
            The numbers of the triangles with a vertex that moved, and perhaps of others.

        Raises
        ------
        MeshError
            A number is out of range; the number of triangles is another; the model is not that
            of one mesh, but was read from a file, combined, compacted, or made from an array; or,
            by "parity", a triangle that is not listed has changed: other fills do not look.
        NotClosedError, NotOrientedError
            As for `voxelize`.
        GridError
            The mesh has grown beyond this model's lattice.
        OutOfMemoryError
            The device has no room for the model beside those that are there.
        """
        before, lattice = source = updates.require_one_mesh(self._surfaces, self.report)
        after, listed = updates.check_edit(before, mesh, changed)
        if self.report.fill != "parity":
            return self._anew(after, lattice.bits)
        after.require_closed()
        # Only says whether the edited mesh has room on the lattice.
        Lattice.fit(self.grid, after.bounds, bits=lattice.bits)
        with self._session.job(find_budget(self._session, None)) as job:
            arrays, report = updates.update_arrays(
                self._session, self._arrays, self.report, source, after, listed
            )
            model = replace(
                self,
                _arrays=arrays,
                report=report,
                _surfaces=((after, lattice),),
                _attributes=None,
            )
            # What it kept of the mesh that was, it keeps of the one that is.
            model = model._keeping(self.attributes)
        return replace(model, report=replace(report, peak_nbytes=job.peak_nbytes))

    # Measures

    @cached_property
    def count(self) -> int:
        """Number of voxels inside."""
        return measure.count_voxels(self._session, self._arrays)

    @property
    def volume(self) -> float:
        """Volume of the voxels inside."""
        return self.count * self.grid.voxel_volume

    @cached_property
    def volume_bounds(self) -> tuple[float, float]:
        """Volume of the voxels wholly inside, and of those inside or touched, a little widened.

        The volume of the solid within the grid's box is between the two: the solid of the mesh as
        it was given.  Its vertices moved to the lattice, by at most half a step, and the bounds are
        widened by the volume that the surface swept, which is far less than a voxel's width would
        be (docs/algorithms/measures.md).

        Raises
        ------
        MeshError
            The model does not come from a mesh, so no voxel is known to be touched.
        """
        within, touch = (
            measure.count_voxels(self._session, self._arrays, rule, self._edge)
            for rule in (Rule.WITHIN, Rule.TOUCH)
        )
        swept = sum(swept_volume(surface, lattice) for surface, lattice in self._surfaces)
        voxel = self.grid.voxel_volume
        return max(0.0, within * voxel - swept), min(self.grid.size * voxel, touch * voxel + swept)

    @property
    def center_mass(self) -> NDArray[np.float64]:
        """Centre of mass of the voxels inside, (x, y, z) float64; NaN, three times, if none is.

        It comes from sums of integers, and is the same on every device.
        """
        return center_of_mass(self.grid, self._moments)

    @property
    def moment_inertia(self) -> NDArray[np.float64]:
        """Moments of inertia about the centre of mass, at density 1, along the axes of the grid.

        As `trimesh.Trimesh.moment_inertia`, for the solid that is the union of the voxels' boxes.
        (3, 3) float64, zeros if no voxel is inside; the same on every device.
        """
        return inertia(self.grid, self._moments)

    def coverage(self, *, cells: ArrayLike = 8) -> NDArray[np.float32]:
        """Return the fraction of each coarser cell that is inside.

        Parameters
        ----------
        cells : int or (3,) int
            Voxels along x, y and z of such a cell; they need not divide the grid, nor agree with
            the model's levels.

        Returns
        -------
        ndarray of float32
            Indexed [z, y, x], of ceil(shape / cells) cells.  Where the grid ends within a cell, the
            fraction is of its voxels that are in the grid.

        Raises
        ------
        GridError
            *cells* is not one or three positive integers.
        """
        asked = np.asarray(cells)
        if asked.dtype.kind not in "iu" or asked.shape not in ((), (3,)) or asked.min() < 1:
            raise GridError(f"cells must be one or three positive integers, got {cells!r}")
        side = _triple(np.minimum(asked, self.grid.shape))
        counts = measure.count_blocks(self._session, self._arrays, side)
        # The host divides: OpenCL devices need not round a quotient correctly.
        x, y, z = (
            np.minimum(width, count - np.arange(0, count, width))
            for width, count in zip(side, self.grid.shape, strict=True)
        )
        held = z[:, None, None] * y[:, None] * x
        fractions: NDArray[np.float32] = (counts / held).astype(np.float32)
        return fractions

    # Questions

    def contains(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Return whether each point lies in a voxel that is inside.

        Parameters
        ----------
        points : (n, 3) float64
            Outside of the grid, and for NaN, the answer is False.

        Returns
        -------
        (n,) bool
        """
        voxels = self.grid.indices(points)
        return query.look_up(self._session, self._arrays, voxels).view(np.bool_)

    def classify(self, points: ArrayLike) -> NDArray[np.uint8]:
        """Return 0 (outside), 1 (inside) or 2 (in a voxel that the mesh touches) for each point.

        Parameters
        ----------
        points : (n, 3) float64
            Outside of the grid, and for NaN, the answer is 0.

        Returns
        -------
        (n,) uint8

        Raises
        ------
        MeshError
            The model does not come from a mesh, so no voxel is known to be touched.
        """
        voxels = self.grid.indices(points)
        return query.look_up(self._session, self._arrays, voxels, Rule.CLASS, self._edge)

    def normals_at(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the normal of the voxel that holds each point.

        It is the mean of the normals of the triangles that touch the voxel (Young 2017), of
        length 1, and on an oriented mesh points outwards.  If they cancel, it is that of the
        triangle with the lowest number.  The same on every device.

        Parameters
        ----------
        points : (n, 3) float64

        Returns
        -------
        (n, 3) float64
            0, three times, for a point in a voxel that no triangle touches, outside of the grid,
            and for NaN.

        Raises
        ------
        MeshError
            The model was not made with ``attributes=("normals",)``.
        """
        return self._kept().normals_at(self._session, self.grid.indices(points))

    def faces_at(self, points: ArrayLike) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the triangles that touch the cell that holds each point.

        A cell is one of the coarse grid, or of the level above the voxels; in a dense model, and
        only there, it is the voxel.

        Parameters
        ----------
        points : (n, 3) float64
            Outside of the grid, and for NaN, there are none.

        Returns
        -------
        offsets : (n + 1,) int64
        faces : (offsets[-1],) int64
            ``faces[offsets[i]:offsets[i + 1]]`` are those of point i: row numbers of the mesh's
            triangles as they were given to `voxelize`, rising.

        Raises
        ------
        MeshError
            The model was not made with ``attributes=("links",)``.
        """
        attributes = self._kept()
        ((surface, _),) = self._surfaces
        voxels = self.grid.indices(points)
        return attributes.faces_at(self._session, voxels, surface.face_numbers)

    def to_array(
        self,
        *,
        level: int | None = None,
        bounds: ArrayLike | None = None,
        rule: RuleName = "centre",
    ) -> NDArray[Any]:
        """Return the voxels as an array indexed [z, y, x].

        Parameters
        ----------
        level : int, optional
            The finest by default.  A coarse one gives the state of its cells.
        bounds : ((i0, j0, k0), (i1, j1, k1)), optional
            First voxel, and the one after the last; at a coarse level its cells that overlap.
        rule : "centre", "touch" or "within"
            Voxels whose sample is inside; those inside or touched by the mesh; or those inside
            and not touched (Inui 2021).

        Returns
        -------
        ndarray
            bool at the finest level; at a coarse one uint8, 0 outside, 1 inside, 2 boundary.

        Raises
        ------
        GridError
            There is no such level or rule, or the bounds reach beyond the grid.
        MeshError
            *rule* asks for touched voxels, and the model does not come from a mesh.
        """
        start, stop = check_bounds(bounds, self.grid.shape)
        finest = len(self.levels) - 1
        if level is None:
            level = finest
        if not 0 <= level <= finest:
            raise GridError(f"level must be from 0 to {finest}, got {level}")
        if level < finest:
            brick = np.prod(self.levels[level + 1 :], axis=0)
            low, high = np.array(start) // brick, -(-np.array(stop) // brick)
            return query.expand_cells(
                self._session, self._arrays, _triple(low), _triple(np.maximum(low, high)), level
            )
        array = np.empty(
            [last - first for first, last in zip(start, stop, strict=True)][::-1], bool
        )
        for _ in self._layers(rule, start, stop, into=array):
            pass
        return array

    def coordinates(self, *, rule: RuleName = "centre") -> NDArray[np.int32]:
        """Return the voxels (i, j, k) that *rule* takes (see `to_array`), ordered by k, j, i.

        Returns
        -------
        (n, 3) int32
        """
        found = []
        for first, slab in self._layers(rule, (0, 0, 0), self.grid.shape):
            k, j, i = np.nonzero(slab)
            found.append(np.stack([i, j, k + first], axis=1).astype(np.int32))
        return np.concatenate(found)

    # Ways out

    def to_mesh(self, *, progress: Progress | None = None) -> trimesh.Trimesh:
        """Return the surface of the voxels inside, by marching cubes: closed and oriented.

        Vertices lie half-way between the centres of a voxel inside and one outside.  Where the
        grid cuts the solid, the mesh is closed by a cap half a voxel beyond the last centres.

        Returns
        -------
        trimesh.Trimesh
            Without triangles if no voxel is inside.
        """
        uniform = self.to_array(level=0) if len(self.levels) > 1 else None
        cell = _triple(np.prod(((1, 1, 1), *self.levels[1:]), axis=0))
        vertices, faces = surfaces.extract(
            self.grid,
            lambda start, stop: query.expand(self._session, self._arrays, start, stop),
            uniform,
            cell,
            progress=progress,
        )
        return trimesh.Trimesh(vertices, faces, process=False)

    def to_trimesh(self) -> trimesh.voxel.VoxelGrid:
        """Return the voxels as trimesh has them, placed where they are.

        Its ``matrix`` is indexed [x, y, z] and takes a byte for each voxel of the grid; its
        ``points`` are the centres of the voxels inside, and ``is_filled(points)`` says what
        `contains` says.

        Returns
        -------
        trimesh.voxel.VoxelGrid
        """
        place = np.diag([*self.grid.spacing, 1.0])
        place[:3, 3] = self.grid.centers([[0, 0, 0]])[0]
        make: Any = trimesh.voxel.VoxelGrid
        voxels: trimesh.voxel.VoxelGrid = make(self.to_array().transpose(2, 1, 0), transform=place)
        return voxels

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the model to *path*, a ``.npz`` file: the arrays of docs/layouts, and the grid."""
        archive.write(path, self.to_record())

    def to_record(self) -> dict[str, NDArray[Any]]:
        """Return the grid and the arrays of the model, as docs/layouts describes them."""
        return archive.pack(self.grid, self._arrays)

    def _repr_png_(self) -> bytes:
        """Return a small picture as a PNG file, for notebooks."""
        from PIL import Image

        import clvox

        file = BytesIO()
        Image.fromarray(clvox.render(self, size=NOTEBOOK_SIZE)).save(file, "PNG")
        return file.getvalue()

    # Inside

    @cached_property
    def _moments(self) -> tuple[int, ...]:
        return measure.sum_moments(self._session, self._arrays)

    @cached_property
    def _edge(self) -> cla.Array:
        """Which voxels the mesh touches, laid out like the voxels; marked when first asked for."""
        if self._attributes is not None:
            return self._attributes.touched.edge
        if not self._surfaces:
            raise MeshError(
                "no voxel of this model is known to be touched: models read from a file, made from "
                'an array, or compacted keep no mesh. rule="centre" and contains() need none.'
            )
        shape, cells = self.grid.shape, self._arrays.cells
        marks = self._session.zeros(self._arrays.voxels.shape, np.uint32)
        for surface, lattice in self._surfaces:
            vertices = lattice.snap(surface.vertices)
            facets = upload_facets(self._session, vertices, surface.faces)
            if cells is None:
                mark_cells(self._session, facets, lattice.bits, shape, (1, 1, 1), marks)
            else:
                mark_voxels(self._session, facets, lattice.bits, shape, cells, marks)
        return marks

    @cached_property
    def _drawing(self) -> Drawing:
        """What pictures need besides; its parts are made for the first one."""
        edge = None if self._attributes is None else self._attributes.touched.edge
        return Drawing(self._session, self._arrays, self.grid.spacing, edge)

    def _kept(self) -> Attributes:
        if self._attributes is None:
            raise MeshError(
                "this model keeps nothing of its mesh. Ask for it when the model is made: "
                'voxelize(..., attributes=("normals", "links")); what is made of others, and what '
                "is read from a file, cannot have it."
            )
        return self._attributes

    def _keeping(self, names: tuple[Attribute, ...]) -> VoxelModel:
        """The same model, made of one mesh, with the attributes *names*."""
        if not names:
            return self
        ((surface, lattice),) = self._surfaces
        attributes = build_attributes(
            self._session, self._arrays, self._edge, surface, lattice, names
        )
        return replace(self, _attributes=attributes)

    def _layers(
        self,
        name: RuleName,
        start: Shape,
        stop: Shape,
        into: NDArray[np.bool_] | None = None,
    ) -> Iterator[tuple[int, NDArray[np.bool_]]]:
        rule = find_rule(name)
        edge = None if rule == Rule.CENTRE else self._edge
        return expand_layers(self._session, self._arrays, start, stop, rule, edge, into)

    def _combined(self, other: VoxelModel, operation: Operation) -> VoxelModel:
        if self.grid != other.grid:
            raise GridError(
                f"the models are on different grids: {self.grid} and {other.grid}. Voxelize both "
                "on one grid (grid=)."
            )
        bits = {lattice.bits for _, lattice in self._surfaces + other._surfaces}
        if len(bits) > 1:
            raise GridError(
                f"the models are on different lattices of the grid {self.grid}: lattice_bits are "
                f"{' and '.join(map(str, sorted(bits)))}. Voxelize both with the smaller one."
            )
        other = other._on(self._session)
        arrays = combine.combine(self._session, self._arrays, other._arrays, operation)
        known = self._surfaces and other._surfaces
        surfaces = tuple(dict.fromkeys(self._surfaces + other._surfaces)) if known else ()
        return self._with(arrays, surfaces)

    def _anew(self, surface: Surface, bits: int) -> VoxelModel:
        """The model of another mesh, made like this one."""
        from clvox.models.build import voxelize

        return voxelize(
            surface,
            grid=self.grid,
            levels=self.levels,
            fill=cast("Fill", self.report.fill),
            attributes=self.attributes,
            lattice_bits=bits,
            device=self._session.device,
        )

    def _with(
        self, arrays: VoxelArrays, surfaces: tuple[tuple[Surface, Lattice], ...]
    ) -> VoxelModel:
        """A model that another one became."""
        return VoxelModel(self._session, self.grid, arrays, Report(device=self.device), surfaces)

    def _on(self, session: Session) -> VoxelModel:
        """The same model on the device of *session*."""
        if session is self._session:
            return self
        _, arrays = archive.unpack(session, self.to_record())
        return VoxelModel(session, self.grid, arrays, self.report, self._surfaces)


def restore(
    record: dict[str, NDArray[Any]],
    report: Report | None,
    surfaces: tuple[tuple[Surface, Lattice], ...],
    device: DeviceLike = None,
    attributes: tuple[Attribute, ...] = (),
) -> VoxelModel:
    """Return the model of arrays that were read."""
    session = open_session(device)
    grid, arrays = archive.unpack(session, record)
    report = report or Report(device=str(session.device))
    return VoxelModel(session, grid, arrays, report, surfaces)._keeping(attributes)


def _triple(values: NDArray[Any]) -> Shape:
    x, y, z = values.tolist()
    return x, y, z
