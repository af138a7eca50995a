"""From a mesh to a voxel model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, get_args

import numpy as np
from numpy.typing import ArrayLike

from clvox.device import DeviceLike, open_session
from clvox.errors import GridError
from clvox.grid import Axis, Grid, Lattice
from clvox.mesh import MeshLike, Surface, check
from clvox.models.attributes import Attribute, check_names
from clvox.models.construct import WINDINGS, Fill, construct, timed
from clvox.models.levels import Levels, fill_box, resolve_levels
from clvox.models.memory import find_budget
from clvox.models.openings import OPEN_FILLS, build_open
from clvox.models.telling import Told, drawn
from clvox.models.voxels import VoxelModel
from clvox.ops import crossings
from clvox.ops.facets import Progress, upload_facets

__all__ = ["Fill", "count_crossings", "voxelize"]


def voxelize(
    mesh: MeshLike | Surface,
    *,
    resolution: int | None = None,
    pitch: ArrayLike | None = None,
    grid: Grid | None = None,
    levels: Levels | None = None,
    fill: Fill = "parity",
    attributes: Sequence[Attribute] = (),
    lattice_bits: int | None = None,
    device: DeviceLike = None,
    memory_budget: int | None = None,
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
        Closed: every edge belongs to an even number of triangles; see *fill* for open ones.
    resolution, pitch
        As for `Grid.fit`: voxels along the longest side of the mesh, or width of a voxel.
    grid : Grid
        Where the voxels are; it may be smaller than the mesh, or beside it.  Give one of the
        three, or *levels* alone, whose voxels then fill the mesh's bounding box exactly.
    levels : sequence of (3,) int, optional
        ``[(N0x, N0y, N0z), (n1x, n1y, n1z)]``: cells of the coarse grid, and voxels in each of
        them, 1 to 64 along a side; a third entry divides those once more.  One entry alone, the
        grid's shape, asks for a dense grid of bits.  By default cells of 8 x 8 x 8 voxels, and
        once those would number more than 2**27, cells of 8 x 8 x 8 cells of 4 x 4 x 4
        voxels, which take the fewest bytes.
    fill : "parity", "nonzero", "positive", "vote", "winding" or "surface"
        What is inside where bodies overlap or lie within one another.  "parity": what an odd
        number of surfaces encloses.  "nonzero": what any body encloses, so overlapping bodies
        are united and nested ones filled, whichever way they are turned; but bodies turned
        oppositely cancel where they overlap, so that a void stays empty if it is turned inwards.
        "positive": what more bodies enclose whose triangles face outwards than inwards.
        "vote" and "winding" guess what an open mesh is to enclose.  "vote": what two of the three
        axes take to be inside, by parity from the low end of each ray; the report tells which
        rays were doubtful.  "winding": where the generalised winding number, the solid angle of
        the triangles over a whole sphere's, is above 1/2; triangles that meet must agree in
        orientation.  It sums floats, so bits within rounding of 1/2 may differ between devices.
        "surface": no inside, but every voxel that a triangle touches, of any mesh, open or not.
        "nonzero" and "positive" need an oriented mesh, each edge used equally often both ways.
    attributes : sequence of "edge", "normals", "area_normals" and "links"
        What the model keeps of its mesh.  "edge": which voxels it touches; otherwise this is found
        out when it is first asked for.  "normals": for each of them the mean normal of the
        triangles that touch it, for `VoxelModel.normals_at` and `render`; in "area_normals" large
        triangles weigh more.  "links": the triangles that touch each cell, for
        `VoxelModel.faces_at`.
    lattice_bits : int, optional
        Steps of the lattice in a voxel, as a power of two from 7 to 14; by default as many as
        fit.  Models that are to be combined share it.
    device : str, int or Device, optional
        See `devices`; by default the environment's ``CLVOX_DEVICE``, a GPU, or a processor.
    memory_budget : int, optional
        Bytes of the device that building may take at once, the model included; models that are
        there already do not count.  By default, most of what the device has free.  With less the
        work is done piece by piece, and the voxels are the same.
    progress : bool or callable, optional
        True draws a bar; a function is called with (done, total).  An exception that it raises
        ends the work.

    Returns
    -------
    VoxelModel

    Raises
    ------
    NotClosedError
        An edge belongs to an odd number of triangles, and *fill* is "parity", "nonzero" or
        "positive".
    NotOrientedError
        An edge is used more often one way than the other, and *fill* is "nonzero" or "positive";
        or such an edge has triangles on both sides, and *fill* is "winding".
    MeshError
        No triangles, a vertex that is not finite, or no extent along some axis.
    GridError
        The grid's numbers make no sense, do not agree with *levels*, or mesh and grid together
        span more voxels than the lattice can tell apart; or there is no such *fill*, or the
        budget is not a positive whole number.
    DeviceError, OutOfMemoryError
        There is no such device; or the work does not fit into its memory or *memory_budget*, and
        the message says what is needed and what would fit.

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
    names = check_names(attributes)
    surface = check(mesh)
    if fill in WINDINGS:
        surface.require_oriented()
    elif fill == "parity":
        surface.require_closed()
    elif fill == "winding":
        surface.require_oriented_but_for_holes()
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
    budget = find_budget(session, memory_budget)
    with drawn(progress=progress) as tell:
        told = Told(session, tell, 2 * len(surface.faces))
        build = build_open if fill in OPEN_FILLS else construct
        model = build(session, surface, lattice, shapes, fill, budget, told)
        return _keep(model, names, budget, told) if names else model


def _keep(model: VoxelModel, names: tuple[Attribute, ...], budget: int, told: Told) -> VoxelModel:
    """The model with attributes, for which it leaves what it does not take of the budget."""
    session, report = model._session, model.report
    seconds = dict(report.seconds)
    with (
        session.job(budget, told.again, model._arrays.arrays) as job,
        timed(session, seconds, "attributes"),
    ):
        model = model._keeping(names)
    peak = max(report.peak_nbytes, job.peak_nbytes)
    return replace(model, report=replace(report, seconds=seconds, peak_nbytes=peak))


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
