"""Exact multi-level voxel models of closed meshes, on any OpenCL device.

Public are the names below, what they return, and `clvox.doctor`.  The names are loaded when they
are first used, so that importing clvox neither looks for an OpenCL driver nor loads the libraries
that meshes need.
"""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING

from clvox._version import __version__
from clvox.errors import (
    ClvoxError,
    DeviceError,
    FormatError,
    GridError,
    KernelBuildError,
    MeshError,
    NotClosedError,
    NotOrientedError,
    OutOfMemoryError,
)
from clvox.grid import Grid

if TYPE_CHECKING:
    from clvox.camera import Camera
    from clvox.device import devices
    from clvox.mesh import load
    from clvox.models import (
        Cutter,
        DexelModel,
        TripleDexelModel,
        VoxelModel,
        count_crossings,
        dexelize,
        open,  # noqa: A004
        voxelize,
    )
    from clvox.render import Material, render, turntable

__all__ = [
    "Camera",
    "ClvoxError",
    "Cutter",
    "DeviceError",
    "DexelModel",
    "FormatError",
    "Grid",
    "GridError",
    "KernelBuildError",
    "Material",
    "MeshError",
    "NotClosedError",
    "NotOrientedError",
    "OutOfMemoryError",
    "TripleDexelModel",
    "VoxelModel",
    "__version__",
    "count_crossings",
    "devices",
    "dexelize",
    "load",
    "open",
    "render",
    "turntable",
    "voxelize",
]

_HOMES = {
    "Camera": "clvox.camera",
    "Material": "clvox.render",
    "Cutter": "clvox.models",
    "DexelModel": "clvox.models",
    "TripleDexelModel": "clvox.models",
    "VoxelModel": "clvox.models",
    "count_crossings": "clvox.models",
    "devices": "clvox.device",
    "dexelize": "clvox.models",
    "load": "clvox.mesh",
    "open": "clvox.models",
    "render": "clvox.render",
    "turntable": "clvox.render",
    "voxelize": "clvox.models",
}


class _Package(ModuleType):
    """Lets a verb bear the name of the module it lives in, as `render` does.

    Importing a submodule sets it as an attribute of its package, which would hide the verb.
    """

    def __setattr__(self, name: str, value: object) -> None:
        if not (name in _HOMES and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package


if not TYPE_CHECKING:  # A type checker would believe that every name is there.

    def __getattr__(name: str) -> object:
        if name not in _HOMES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = getattr(import_module(_HOMES[name]), name)
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
