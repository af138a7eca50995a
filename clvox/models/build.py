"""From a mesh to a voxel model."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike
from tqdm import tqdm

from clvox.device import DeviceLike, Session, open_session
from clvox.errors import GridError
from clvox.grid import Axis, Grid, Lattice, Shape
from clvox.mesh import MeshLike, Surface, check
from clvox.models.levels import Levels, fill_box, resolve_levels
from clvox.models.report import Report
from clvox.models.voxels import VoxelModel
from clvox.ops import boundary, crossings, dense
from clvox.ops import fill as fills
from clvox.ops.facets import Facets, Progress, upload_facets
from clvox.ops.fill import Winding
from clvox.ops.layout import Bricks, Cells, VoxelArrays, cell_shape, words_for
from clvox.ops.multilevel import carry, rank_cells

Fill: TypeAlias = Literal["parity", "nonzero", "positive", "surface"]
"""What is inside: see `voxelize`."""

_WINDINGS = {"nonzero": Winding.NONZERO, "positive": Winding.POSITIVE}


def voxelize(
    mesh: MeshLike | Surface,
    *,
    resolution: int | None = None,
    pitch: ArrayLike | None = None,
    grid: Grid | None = None,
    levels: Levels | None = None,
    fill: Fill = "parity",
    lattice_bits: int | None = None,
    device: DeviceLike = None,
    progress: bool | Progress | None = None,
) -> VoxelModel:
    """Return the voxels whose samples lie inside a mesh.

    The sample of a voxel is its centre, moved by an infinitesimal that breaks all ties, so that
    a centre exactly on a surface is in or out by rule and never by rounding.  The answer is exact
    for the mesh with its vertices moved to the lattice (by at most half a lattice step, see
    `Lattice.step`), and the same bits on every device.

    Parameters
    ----------
    mesh : trimesh.Trimesh, path, or (vertices, faces)
        Closed: every edge belongs to an even number of triangles; see *fill* for others.
    resolution, pitch
        As for `Grid.fit`: voxels along the longest side of the mesh, or width of a voxel.
    grid : Grid
        Where the voxels are; it may be smaller than the mesh, or beside it.  Give one of the
        three, or *levels* alone, whose voxels then fill the mesh's bounding box exactly.
    levels : sequence of (3,) int, optional
        ``[(N0x, N0y, N0z), (n1x, n1y, n1z)]``: cells of the coarse grid, and voxels in each of
        them, 1 to 64 along a side; a third entry divides those once more.  One entry alone, the
        grid's shape, asks for a dense grid of bits.  By default cells of 8 x 8 x 8 voxels, and
        once those would number more than 2**27, cells of 8 x 8 x 8 of such cells.
    fill : "parity", "nonzero", "positive" or "surface"
        What is inside where bodies overlap or lie within one another.  "parity": what an odd
        number of surfaces encloses.  "nonzero": what any body encloses, so overlapping bodies
        are united and nested ones filled, whichever way they are turned; but bodies turned
        oppositely cancel where they overlap, so that a void stays empty if it is turned inwards.
        "positive": what more bodies enclose whose triangles face outwards than inwards.
        "surface": no inside, but every voxel that a triangle touches, of any mesh, open or not.
        "nonzero" and "positive" need an oriented mesh, each edge used equally often both ways.
    lattice_bits : int, optional
        Steps of the lattice in a voxel, as a power of two from 7 to 14; by default as many as
        fit.  Models that are to be combined share it.
    device : str, int or Device, optional
        See `devices`; by default the environment's ``CLVOX_DEVICE``, a GPU, or a processor.
    progress : bool or callable, optional
        True draws a bar; a function is called with (done, total).  An exception that it raises
        ends the work.

    Returns
    -------
    VoxelModel

    Raises
    ------
    NotClosedError
        An edge belongs to an odd number of triangles, and *fill* is not "surface".
    NotOrientedError
        An edge is used more often one way than the other, and *fill* is "nonzero" or "positive".
    MeshError
        No triangles, a vertex that is not finite, or no extent along some axis.
    GridError
        The grid's numbers make no sense, do not agree with *levels*, or mesh and grid together
        span more voxels than the lattice can tell apart; or there is no such *fill*.
    DeviceError, OutOfMemoryError
        There is no such device, or it has no room.

    References
    ----------
    G. Young, "Multi-level voxel representation for GPU-accelerated solid modeling", MSc thesis,
    Iowa State University, 2017.

    Examples
    --------
    >>> import clvox, trimesh
    >>> ball = trimesh.creation.icosphere(radius=10.0)
    >>> model = clvox.voxelize(ball, resolution=64)
    >>> bool(model.contains([[0.0, 0.0, 0.0]])[0])
    True
    """
    if fill not in get_args(Fill):
        raise GridError(f"fill must be one of {', '.join(map(repr, get_args(Fill)))}, got {fill!r}")
    surface = check(mesh)
    if fill in _WINDINGS:
        surface.require_oriented()
    elif fill == "parity":
        surface.require_closed()
    if grid is None and resolution is None and pitch is None and levels is not None:
        grid = fill_box(surface.bounds, levels)
    elif [grid is None, resolution is None, pitch is None].count(False) != 1:
        raise GridError(
            "give one of resolution= (voxels along the longest side), pitch= (width of a voxel) "
            "and grid=, or levels= alone"
        )
    elif grid is None:
        grid = Grid.fit(surface, resolution=resolution, pitch=pitch)
    shapes = resolve_levels(grid.shape, levels)
    lattice = Lattice.fit(grid, surface.bounds, bits=lattice_bits)
    session = open_session(device)
    with told(2 * len(surface.faces), "voxelize", progress=progress) as tell:
        return _build(session, surface, lattice, shapes, fill, tell)


def count_crossings(
    mesh: MeshLike | Surface,
    *,
    grid: Grid,
    axis: Axis = "y",
    lattice_bits: int | None = None,
    device: DeviceLike = None,
) -> np.ndarray[Any, np.dtype[np.uint32]]:
    """Return how many triangles of *mesh* each ray along *axis* crosses.

    Rays run through the voxel centres of *grid* and beyond it, without end.  On a closed mesh
    every count is even, whatever vertices, edges or degenerate triangles a ray runs through.

    Parameters
    ----------
    mesh : trimesh.Trimesh, path, or (vertices, faces)
        In the length unit of *grid*; open meshes are welcome here.
    grid : Grid
        The voxels whose centres the rays join.  It may be smaller than the mesh.
    axis : "x", "y" or "z"
    lattice_bits, device
        As for `voxelize`.

    Returns
    -------
    ndarray of uint32
        Shape: the grid's [z, y, x] without *axis*; for rays along y, (nz, nx).

    Raises
    ------
    MeshError
        No triangles, or a vertex that is not finite.
    GridError
        Mesh and grid together span more voxels than the lattice can tell apart.

    References
    ----------
    M. Schwarz and H.-P. Seidel, "Fast parallel surface and solid voxelization on GPUs", ACM
    Transactions on Graphics 29(6), 2010.

    Examples
    --------
    >>> import clvox, trimesh
    >>> ball = trimesh.creation.icosphere(radius=10.0)
    >>> counts = clvox.count_crossings(ball, grid=clvox.Grid.fit(ball, pitch=0.5))
    >>> bool((counts % 2).any())
    False
    """
    if axis not in ("x", "y", "z"):
        raise GridError(f"axis must be 'x', 'y' or 'z', got {axis!r}")
    surface = check(mesh)
    lattice = Lattice.fit(grid, surface.bounds, bits=lattice_bits)
    session = open_session(device)
    facets = upload_facets(session, lattice.snap(surface.vertices), surface.faces)
    counts = crossings.count_crossings(session, facets, lattice.bits, grid.shape, "xyz".index(axis))
    result: np.ndarray[Any, np.dtype[np.uint32]] = counts.get()
    return result


@dataclass
class Stages:
    """Seconds per stage of a build; each ends with the device idle."""

    session: Session
    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Add the time that the body takes to that of stage *name*."""
        start = time.perf_counter()
        yield
        self.session.finish()
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start


def _build(
    session: Session,
    surface: Surface,
    lattice: Lattice,
    levels: tuple[Shape, ...],
    fill: Fill,
    tell: Progress | None,
) -> VoxelModel:
    session.reset_peak()
    stages = Stages(session)
    with stages.stage("snap"):
        vertices = lattice.snap(surface.vertices)
    with stages.stage("upload"):
        facets = upload_facets(session, vertices, surface.faces)
        collapsed = boundary.count_flat(session, facets)
    odd_rays = disagreements = 0
    if fill == "surface":
        arrays = _build_surface(session, facets, lattice, levels, stages, tell)
    else:
        build = _build_dense if len(levels) == 1 else _build_bricks
        winding = _WINDINGS.get(fill)
        arrays, odd_rays, disagreements = build(
            session, facets, lattice, levels, winding, stages, tell
        )
    warnings = list(surface.warnings)
    if odd_rays or disagreements:
        warnings.append(
            f"{odd_rays} rays cross the mesh an odd number of times and {disagreements} untouched "
            "cells are in and out at once: please report this mesh"
        )
    report = Report(
        device=str(session.device),
        fill=fill,
        seconds=stages.seconds,
        triangles=len(surface.faces),
        repeated=surface.repeated,
        duplicates=surface.duplicates,
        cancelled=surface.cancelled,
        collapsed=collapsed,
        odd_rays=odd_rays,
        lattice_bits=lattice.bits,
        peak_nbytes=session.peak_nbytes,
        warnings=tuple(warnings),
    )
    return VoxelModel(session, lattice.grid, arrays, report, ((surface, lattice),))


def _build_bricks(
    session: Session,
    facets: Facets,
    lattice: Lattice,
    levels: tuple[Shape, ...],
    winding: Winding | None,
    stages: Stages,
    tell: Progress | None,
) -> tuple[VoxelArrays, int, int]:
    shape = lattice.grid.shape
    cells = _mark_cells(session, facets, lattice, levels, stages, tell)
    with stages.stage("clear"):
        bricks = Bricks.cleared(session, cells)
    with stages.stage("flip"):
        part = _part(tell, 1)
        if winding is None:
            crossings.flip_bricks(session, facets, lattice.bits, cells, bricks, progress=part)
        else:
            fills.flip_bricks(session, facets, lattice.bits, cells, winding, bricks, progress=part)
    with stages.stage("carry"):
        solid = carry(session, cells, bricks, shape)
    arrays = VoxelArrays(shape, bricks.voxels, cells, solid.inside, solid.middle_inside)
    return arrays, solid.odd_rays, solid.disagreements


def _build_dense(
    session: Session,
    facets: Facets,
    lattice: Lattice,
    levels: tuple[Shape, ...],
    winding: Winding | None,
    stages: Stages,
    tell: Progress | None,
) -> tuple[VoxelArrays, int, int]:
    (shape,) = levels
    nx, ny, nz = shape
    with stages.stage("clear"):
        voxels = session.zeros((nz, ny, words_for(nx)), np.uint32)
        beyond = session.zeros((nz, words_for(nx)), np.uint32)
    with stages.stage("flip"):
        target, part = (voxels, beyond), _part(tell, 1)
        if winding is None:
            crossings.flip_dense(session, facets, lattice.bits, shape, *target, progress=part)
        else:
            fills.flip_dense(session, facets, lattice.bits, shape, winding, *target, progress=part)
    with stages.stage("carry"):
        odd_rays = dense.fill(session, voxels, beyond)
    return VoxelArrays(shape, voxels), odd_rays, 0


def _build_surface(
    session: Session,
    facets: Facets,
    lattice: Lattice,
    levels: tuple[Shape, ...],
    stages: Stages,
    tell: Progress | None,
) -> VoxelArrays:
    """The touched voxels: marks are all there is to it."""
    shape = lattice.grid.shape
    if len(levels) == 1:
        with stages.stage("mark"):
            marks = boundary.mark_cells(
                session, facets, lattice.bits, shape, (1, 1, 1), progress=_part(tell, 1)
            )
        return VoxelArrays(shape, marks)
    cells = _mark_cells(session, facets, lattice, levels, stages, tell)
    with stages.stage("flip"):
        voxels = boundary.mark_voxels(
            session, facets, lattice.bits, shape, cells, progress=_part(tell, 1)
        )
    inside = session.zeros(cells.boundary.shape, np.uint32)
    middle = session.zeros(cells.finer.boundary.shape, np.uint32) if cells.finer else None
    return VoxelArrays(shape, voxels, cells, inside, middle)


def _mark_cells(
    session: Session,
    facets: Facets,
    lattice: Lattice,
    levels: tuple[Shape, ...],
    stages: Stages,
    tell: Progress | None,
) -> Cells:
    """The touched cells of each level above the voxels."""
    shape = lattice.grid.shape
    sides = levels[1] if len(levels) == 2 else _product(levels[1], levels[2])
    with stages.stage("mark"):
        marks = boundary.mark_cells(
            session, facets, lattice.bits, shape, sides, progress=_part(tell, 0)
        )
    with stages.stage("rank"):
        cells = rank_cells(session, marks, levels[0], levels[1])
    if len(levels) == 3:
        counts = cell_shape(shape, levels[2])
        with stages.stage("mark"):
            marks = boundary.mark_voxels(
                session, facets, lattice.bits, counts, cells, side=levels[2]
            )
        with stages.stage("rank"):
            finer = rank_cells(session, marks, counts, levels[2])
        cells = replace(cells, finer=finer)
    return cells


def _product(a: Shape, b: Shape) -> Shape:
    return a[0] * b[0], a[1] * b[1], a[2] * b[2]


def _part(tell: Progress | None, part: int) -> Progress | None:
    """Progress of one of two passes over the triangles, as progress of the whole."""
    if tell is None:
        return None
    return lambda done, total: tell(part * total + done, 2 * total)


@contextmanager
def told(total: int, verb: str, *, progress: bool | Progress | None) -> Iterator[Progress | None]:
    """Whom to tell of progress: the caller's function, a bar, or nobody."""
    if not isinstance(progress, bool):
        yield progress
    elif not progress:
        yield None
    else:
        with tqdm(total=total, unit=" triangles", unit_scale=True, desc=verb) as bar:
            yield lambda done, _: bar.update(done - bar.n)
