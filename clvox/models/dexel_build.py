"""From a mesh to dexels."""

from __future__ import annotations

from typing import Literal, TypeAlias, get_args, overload

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from clvox.device import DeviceLike, open_session
from clvox.errors import GridError, MeshError
from clvox.grid import Axis, Grid, Lattice
from clvox.mesh import MeshLike, Surface, check
from clvox.models.dexel_construct import construct_dexels
from clvox.models.dexels import AXES, DexelModel
from clvox.models.memory import find_budget
from clvox.models.telling import drawn
from clvox.models.triple import TripleDexelModel
from clvox.ops.facets import Progress
from clvox.reference.fill import FillRule

DexelAxis: TypeAlias = Literal["x", "y", "z", "xyz"]


@overload
def dexelize(
    mesh: MeshLike | Surface,
    *,
    resolution: int | None = None,
    pitch: ArrayLike | None = None,
    grid: Grid | None = None,
    axis: Axis = "z",
    fill: FillRule = "parity",
    lattice_bits: int | None = None,
    device: DeviceLike = None,
    memory_budget: int | None = None,
    progress: bool | Progress | None = None,
) -> DexelModel: ...


@overload
def dexelize(
    mesh: MeshLike | Surface,
    *,
    resolution: int | None = None,
    pitch: ArrayLike | None = None,
    grid: Grid | None = None,
    axis: Literal["xyz"],
    fill: FillRule = "parity",
    lattice_bits: int | None = None,
    device: DeviceLike = None,
    memory_budget: int | None = None,
    progress: bool | Progress | None = None,
) -> TripleDexelModel: ...


def dexelize(
    mesh: MeshLike | Surface,
    *,
    resolution: int | None = None,
    pitch: ArrayLike | None = None,
    grid: Grid | None = None,
    axis: DexelAxis = "z",
    fill: FillRule = "parity",
    lattice_bits: int | None = None,
    device: DeviceLike = None,
    memory_budget: int | None = None,
    progress: bool | Progress | None = None,
) -> DexelModel | TripleDexelModel:
    """Return where the rays through the voxel centres of a grid cross a mesh, in order.

    A ray has any number of crossings.  Depths are exact for the mesh with its vertices moved to
    the lattice (by at most half a lattice step), rounded up to 2**-18 voxel, or 2**-14 on the
    coarsest lattice; and the same bits on every device.

    Parameters
    ----------
    mesh : trimesh.Trimesh, path, or (vertices, faces)
        Closed: every edge belongs to an even number of triangles.
    resolution, pitch
        As for `Grid.fit`: voxels along the longest side of the mesh, or width of a voxel.
    grid : Grid
        The voxels whose centres the rays join.  Give one of the three.
    axis : "x", "y", "z" or "xyz"
        The direction of the rays; with "xyz", three bundles.
    fill : "parity", "nonzero" or "positive"
        What is inside where bodies overlap, as for `voxelize`.
    lattice_bits, device
        As for `voxelize`.
    memory_budget : int, optional
        Bytes of the device that the work may take at once, the result included; by default, most
        of what the device has free.  With less, rays are done bundle by bundle and the mesh is sent
        in parts; the result is the same.
    progress : bool or callable, optional
        True draws a bar; a function is called with (done, total) triangles.  An exception that it
        raises ends the work.

    Returns
    -------
    DexelModel, or TripleDexelModel if *axis* is "xyz"

    Raises
    ------
    NotClosedError
        An edge belongs to an odd number of triangles.
    NotOrientedError
        An edge is used more often one way than the other, and *fill* is not "parity".
    MeshError
        No triangles, a vertex that is not finite, or no extent along some axis.
    GridError
        The grid's numbers make no sense, or mesh and grid together span more voxels than the
        lattice can tell apart; or there is no such *axis* or *fill*.
    DeviceError, OutOfMemoryError
        There is no such device; or the result does not fit into its memory or *memory_budget*, and
        the message says what is needed and what would fit.

    References
    ----------
    M. Inui, K. Kaba, N. Umezu, "Fast dexelization of polyhedral models using ray-tracing cores of
    GPU", Computer-Aided Design and Applications 18(4), 2021.

    Examples
    --------
    >>> import clvox, trimesh
    >>> ball = trimesh.creation.icosphere(radius=10.0)
    >>> dexels = clvox.dexelize(ball, resolution=64, axis="z")
    >>> offsets, enter, leave = dexels.intervals()
    >>> bool((enter < leave).all())
    True
    """
    if axis not in get_args(DexelAxis):
        raise GridError(f"axis must be 'x', 'y', 'z' or 'xyz', got {axis!r}")
    if fill not in get_args(FillRule):
        names = ", ".join(map(repr, get_args(FillRule)))
        raise GridError(f"fill must be one of {names}, got {fill!r}")
    surface = check(mesh)
    if fill == "parity":
        surface.require_closed()
    else:
        surface.require_oriented()
    if [grid is None, resolution is None, pitch is None].count(False) != 1:
        raise GridError(
            "give one of resolution= (voxels along the longest side), pitch= (width of a voxel) "
            "and grid="
        )
    if grid is None:
        grid = Grid.fit(surface, resolution=resolution, pitch=pitch)
    lattice = Lattice.fit(grid, surface.bounds, bits=lattice_bits)
    session = open_session(device)
    axes: list[Axis] = [name for name in AXES if name in axis]
    budget = find_budget(session, memory_budget)
    with drawn(progress=progress, verb="dexelize") as tell:
        models = construct_dexels(session, surface, lattice, axes, fill, budget, tell)
    return models[0] if len(models) == 1 else TripleDexelModel(*models)


@overload
def remade(
    mesh: trimesh.Trimesh, transform: ArrayLike, grid: Grid, like: DexelModel
) -> DexelModel: ...


@overload
def remade(
    mesh: trimesh.Trimesh, transform: ArrayLike, grid: Grid, like: TripleDexelModel
) -> TripleDexelModel: ...


def remade(
    mesh: trimesh.Trimesh,
    transform: ArrayLike,
    grid: Grid,
    like: DexelModel | TripleDexelModel,
) -> DexelModel | TripleDexelModel:
    """Return dexels of *mesh* moved, on *grid* and the lattice of *like*, to combine with it."""
    matrix = _matrix(transform)
    if not len(mesh.faces):
        raise MeshError("nothing is inside, so there is nothing to move")
    moved = mesh.copy().apply_transform(matrix)
    bundle = like.x if isinstance(like, TripleDexelModel) else like
    bits, device = bundle.lattice_bits, bundle._session.device
    most = Lattice.fit(grid, moved.bounds).bits
    if most < bits:
        raise GridError(
            f"where it is moved, the model and the grid span so much together that the lattice "
            f"has room for {most} bits at most; the model has {bits}. Move it less far, move it "
            f"to a grid that is nearer (grid=), or dexelize with lattice_bits={most} first."
        )
    if isinstance(like, TripleDexelModel):
        return dexelize(moved, grid=grid, axis="xyz", lattice_bits=bits, device=device)
    return dexelize(moved, grid=grid, axis=like.axis, lattice_bits=bits, device=device)


def _matrix(transform: ArrayLike) -> NDArray[np.float64]:
    """The transform, checked."""
    try:
        matrix = np.asarray(transform, dtype=np.float64)
    except (TypeError, ValueError):
        raise GridError(f"transform must be (4, 4) numbers, got {transform!r}") from None
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
        raise GridError(
            f"transform must be (4, 4) finite numbers, got {matrix.tolist()} of the shape "
            f"{matrix.shape}"
        )
    return matrix
