"""Pictures of 1920 x 1080 pixels: ours, Open3D's cast of the mesh, VTK's cast of the voxels."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

import clvox
from benchmarks import peers
from clvox.bench import Contestant
from clvox.mesh import Surface

SIZE = 1920, 1080


def contestants(
    model: clvox.VoxelModel, surface: Surface, size: tuple[int, int], *, dense: bool
) -> list[Contestant]:
    """Return all ways to draw *model*, made of *surface*, from the same place, a ray a pixel.

    dense: whether VTK is asked, which needs a byte for each voxel.
    """
    camera = clvox.Camera.around(model, aspect=size[0] / size[1])
    plain: dict[str, Any] = {"camera": camera, "size": size, "samples": 1, "occlusion": False}
    # What the first picture makes is for all of them, as the peers' trees are.
    clvox.render(model, camera=camera, size=(16, 9))
    ways = [Contestant("clvox, surface", lambda: clvox.render(model, **plain))]
    ways.append(Contestant("clvox, volume", lambda: clvox.render(model, style="volume", **plain)))
    ways.append(
        Contestant("clvox, as by default", lambda: clvox.render(model, camera=camera, size=size))
    )
    caster = peers.ray_caster()
    if caster is not None:
        scene = caster.scene(np.array(surface.vertices), surface.faces)
        rays = caster.tensor(camera_rays(camera, size))
        ways.append(Contestant("Open3D, cast of the mesh", lambda: scene.cast_rays(rays)))
    window = _vtk_window(model, camera, size) if dense else None
    if window is not None:
        ways.append(Contestant("VTK, fixed-point ray caster", window.Render))
    return ways


def camera_rays(camera: clvox.Camera, size: tuple[int, int]) -> NDArray[np.float32]:
    """Origins and directions, (rows, columns, 6)."""
    columns, rows = size
    right, above, back = camera.frame()
    slope = 2 * np.tan(np.radians(camera.fov or 0.0) / 2) / rows
    across = (np.arange(columns) - (columns - 1) / 2) * slope
    along = (np.arange(rows) - (rows - 1) / 2) * slope
    ahead = across[None, :, None] * right - along[:, None, None] * above - back
    rays = np.empty((rows, columns, 6), np.float32)
    rays[..., :3] = camera.eye
    rays[..., 3:] = ahead
    return rays


def _vtk_window(model: clvox.VoxelModel, camera: clvox.Camera, size: tuple[int, int]) -> Any:
    """A window that nobody sees, with VTK's caster, opaque inside and lit; None without VTK."""
    try:
        import_module("vtkmodules.vtkRenderingOpenGL2")
        import_module("vtkmodules.vtkRenderingVolumeOpenGL2")
        core = import_module("vtkmodules.vtkRenderingCore")
        volumes = import_module("vtkmodules.vtkRenderingVolume")
        data = import_module("vtkmodules.vtkCommonDataModel")
        arrays = import_module("vtkmodules.util.numpy_support")
    except ImportError as error:
        peers.MISSING["VTK"] = str(error)
        return None
    image = data.vtkImageData()
    image.SetDimensions(*model.grid.shape)
    image.SetSpacing(*model.grid.spacing)
    image.SetOrigin(*model.grid.centers([[0, 0, 0]])[0])
    voxels = model.to_array().view(np.uint8).reshape(-1) * np.uint8(255)
    image.GetPointData().SetScalars(arrays.numpy_to_vtk(voxels, deep=True))
    mapper = volumes.vtkFixedPointVolumeRayCastMapper()
    mapper.SetInputData(image)
    # One ray a pixel, half a voxel from sample to sample, however busy the machine is.
    mapper.SetAutoAdjustSampleDistances(0)
    mapper.SetImageSampleDistance(1.0)
    mapper.SetSampleDistance(0.5 * min(model.grid.spacing))
    opacity = data.vtkPiecewiseFunction()
    opacity.AddPoint(0, 0.0)
    opacity.AddPoint(127, 0.0)
    opacity.AddPoint(128, 1.0)
    look = core.vtkVolumeProperty()
    look.SetScalarOpacity(opacity)
    look.ShadeOn()
    volume = core.vtkVolume()
    volume.SetMapper(mapper)
    volume.SetProperty(look)
    renderer, window = core.vtkRenderer(), core.vtkRenderWindow()
    renderer.AddVolume(volume)
    window.SetOffScreenRendering(1)
    window.SetSize(*size)
    window.AddRenderer(renderer)
    eye = renderer.GetActiveCamera()
    eye.SetPosition(*camera.eye)
    eye.SetFocalPoint(*camera.target)
    eye.SetViewUp(*camera.up)
    eye.SetViewAngle(camera.fov or 0.0)
    renderer.ResetCameraClippingRange()
    return window
