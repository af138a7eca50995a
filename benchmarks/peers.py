"""Other libraries at the same jobs, each used as well as we know how.

A peer that is not installed is None, and its reason is in `MISSING`.  They are imported by name,
so that the types check without them.
"""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clvox.device import Session
from clvox.grid import Grid
from clvox.mesh import Surface

MISSING: dict[str, str] = {}
"""Why a peer cannot take part, by its name."""

RAYS_AT_ONCE = 1 << 15
"""Open3D's rays per call: fewer cost calls, more cost memory."""


class Voxelizer(ABC):
    """Makes a solid of a closed mesh as a dense array, in two steps."""

    name: str
    about: str
    """What its preparation is."""

    @abstractmethod
    def prepare(self, surface: Surface, grid: Grid) -> Any:
        """Return what the library needs to know of the mesh before it answers anything."""

    @abstractmethod
    def voxelize(self, prepared: Any, grid: Grid) -> NDArray[np.uint8]:
        """Return 1 for each voxel whose centre is inside, [z, y, x]."""


class RayCaster(Voxelizer):
    """Open3D: one ray along z per column of voxels (Embree), and a running xor in NumPy."""

    name = "Open3D rays"
    about = "Open3D BVH"

    def __init__(self) -> None:
        self.library = import_module("open3d")

    def prepare(self, surface: Surface, grid: Grid) -> Any:
        """In units of a voxel, where float32 is best; the tree is built by the first query."""
        points = (surface.vertices - grid.origin) / grid.spacing
        scene = self.scene(points, surface.faces)
        scene.cast_rays(self.tensor(np.zeros((1, 6), np.float32)))
        return scene

    def scene(self, points: NDArray[Any], faces: NDArray[Any]) -> Any:
        """Return the scene of one mesh."""
        scene = self.library.t.geometry.RaycastingScene()
        scene.add_triangles(
            self.tensor(points.astype(np.float32)), self.tensor(faces.astype(np.uint32))
        )
        return scene

    def tensor(self, array: NDArray[Any]) -> Any:
        """Return *array* as Open3D takes it, not copied."""
        return self.library.core.Tensor.from_numpy(array)

    def list_hits(self, prepared: Any, grid: Grid) -> int:
        """All hits, sorted by ray and depth, of some rows of rays at a time; how many there are."""
        nx, ny, _ = grid.shape
        rows = max(1, RAYS_AT_ONCE // nx)
        rays = np.empty((rows, nx, 6), np.float32)
        rays[..., 0] = np.arange(nx) + 0.5
        rays[..., 2:] = (-1, 0, 0, 1)
        count = 0
        for first in range(0, ny, rows):
            some = rays[: min(rows, ny - first)]
            some[..., 1] = (np.arange(first, first + len(some)) + 0.5)[:, None]
            found = prepared.list_intersections(self.tensor(some.reshape(-1, 6)))
            depth = found["t_hit"].numpy()
            order = np.lexsort((depth, found["ray_ids"].numpy()))
            hits = depth[order], found["primitive_ids"].numpy()[order]
            count += len(hits[0])
        return count

    def voxelize(self, prepared: Any, grid: Grid) -> NDArray[np.uint8]:
        """All hits of some rows of rays at a time; then layer upon layer, on all cores."""
        nx, ny, nz = grid.shape
        voxels = np.zeros((nz, ny, nx), np.uint8)
        flat = voxels.reshape(-1)
        rows = max(1, RAYS_AT_ONCE // nx)
        rays = np.empty((rows, nx, 6), np.float32)
        rays[..., 0] = np.arange(nx) + 0.5
        rays[..., 2:] = (-1, 0, 0, 1)
        for first in range(0, ny, rows):
            some = rays[: min(rows, ny - first)]
            some[..., 1] = (np.arange(first, first + len(some)) + 0.5)[:, None]
            found = prepared.list_intersections(self.tensor(some.reshape(-1, 6)))
            # The ray starts one voxel before the grid, and the first centre is half a voxel in.
            slot = np.maximum(np.floor(found["t_hit"].numpy() - 0.5).astype(np.int64), 0)
            ray = found["ray_ids"].numpy().astype(np.int64)
            at = slot * (ny * nx) + (first * nx + ray)
            np.bitwise_xor.at(flat, at[slot < nz], np.uint8(1))

        def fill(part: slice) -> None:
            for k in range(1, nz):
                np.bitwise_xor(voxels[k, part], voxels[k - 1, part], out=voxels[k, part])

        parts = os.cpu_count() or 1
        edges = [ny * part // parts for part in range(parts + 1)]
        with ThreadPoolExecutor(parts) as pool:
            list(pool.map(fill, map(slice, edges[:-1], edges[1:])))
        return voxels


class Stenciller(Voxelizer):
    """VTK: vtkPolyDataToImageStencil, which cuts the mesh slice by slice."""

    name = "VTK stencil"
    about = "VTK polydata"

    def __init__(self) -> None:
        self.core = import_module("vtkmodules.vtkCommonCore")
        self.model = import_module("vtkmodules.vtkCommonDataModel")
        self.stencil = import_module("vtkmodules.vtkImagingStencil")
        self.arrays = import_module("vtkmodules.util.numpy_support")

    def prepare(self, surface: Surface, grid: Grid) -> Any:
        """From welded vertices: with three per triangle it takes minutes."""
        del grid
        points = self.core.vtkPoints()
        # VTK looks at the memory of the arrays, which therefore have to live as long.
        kept = np.array(surface.vertices), surface.faces.astype(np.int64).reshape(-1)
        points.SetData(self.arrays.numpy_to_vtk(kept[0]))
        cells = self.model.vtkCellArray()
        cells.SetData(3, self.arrays.numpy_to_vtkIdTypeArray(kept[1]))
        mesh = self.model.vtkPolyData()
        mesh.SetPoints(points)
        mesh.SetPolys(cells)
        return mesh, kept

    def voxelize(self, prepared: Any, grid: Grid) -> NDArray[np.uint8]:
        """Samples at the centres, without VTK's tolerance."""
        nx, ny, nz = grid.shape
        cut = self.stencil.vtkPolyDataToImageStencil()
        cut.SetInputData(prepared[0])
        cut.SetTolerance(0)
        cut.SetOutputOrigin(*(np.array(grid.origin) + np.array(grid.spacing) / 2))
        cut.SetOutputSpacing(*grid.spacing)
        cut.SetOutputWholeExtent(0, nx - 1, 0, ny - 1, 0, nz - 1)
        image = self.stencil.vtkImageStencilToImage()
        image.SetInputConnection(cut.GetOutputPort())
        image.SetInsideValue(1)
        image.SetOutsideValue(0)
        image.SetOutputScalarTypeToUnsignedChar()
        image.Update()
        values = image.GetOutput().GetPointData().GetScalars()
        voxels: NDArray[np.uint8] = self.arrays.vtk_to_numpy(values).reshape(nz, ny, nx)
        return voxels


def ray_caster() -> RayCaster | None:
    """Return Open3D, if it is installed."""
    try:
        return RayCaster()
    except ImportError as error:
        MISSING["Open3D"] = str(error)
        return None


def stenciller() -> Stenciller | None:
    """Return VTK, if it is installed."""
    try:
        return Stenciller()
    except ImportError as error:
        MISSING["VTK"] = str(error)
        return None


def voxelizers() -> list[Voxelizer]:
    """Return those that are installed."""
    return [peer for peer in (ray_caster(), stenciller()) if peer is not None]


def union() -> Callable[[Surface, Surface], Any] | None:
    """Return what makes the union of two meshes by manifold3d, from arrays to arrays."""
    try:
        library = import_module("manifold3d")
    except ImportError as error:
        MISSING["manifold3d"] = str(error)
        return None

    def solid(surface: Surface) -> Any:
        points = np.asarray(surface.vertices, np.float32)
        return library.Manifold(library.Mesh(points, np.asarray(surface.faces, np.uint32)))

    def run(one: Surface, other: Surface) -> Any:
        return (solid(one) + solid(other)).to_mesh()

    return run


def prefix_sum(session: Session, source: Any, target: Any) -> Callable[[], None] | None:
    """Return what makes pyopencl's exclusive prefix sum of *source* in *target*, and waits."""
    try:
        scans = import_module("pyopencl.scan")
        import_module("mako.template")
    except ImportError as error:
        MISSING["pyopencl.scan"] = f"it needs Mako: {error}"
        return None
    kernel = scans.GenericScanKernel(
        source.context,
        np.uint32,
        arguments="__global const unsigned int *source, __global unsigned int *target",
        input_expr="source[i]",
        scan_expr="a + b",
        neutral="0",
        output_statement="target[i] = prev_item;",
    )

    def run() -> None:
        kernel(source, target, queue=source.queue)
        session.finish()

    return run
