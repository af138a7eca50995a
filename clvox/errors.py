"""Every exception that clvox raises on purpose.

Each message says what is wrong, with the value; what was expected; and what to do.  All of them
inherit `ClvoxError` and the closest built-in exception, so that code which knows nothing of clvox
still catches them where it would expect to.
"""


class ClvoxError(Exception):
    """Base of every exception that clvox raises on purpose."""


class MeshError(ClvoxError, ValueError):
    """The mesh cannot be used: not finite, empty, flat, or without the surface asked for."""


class NotClosedError(MeshError):
    """The mesh is open: some edge belongs to an odd number of triangles."""


class NotOrientedError(MeshError):
    """The mesh is not oriented: some edge is not used equally often both ways."""


class GridError(ClvoxError, ValueError):
    """The grid cannot be used: its numbers make no sense, or two grids do not agree."""


class FormatError(ClvoxError, ValueError):
    """The file is not what its name or its header says, or clvox does not read its format."""


class DeviceError(ClvoxError, RuntimeError):
    """The OpenCL device is absent, unsuitable, or failed."""


class KernelBuildError(DeviceError):
    """A kernel does not build on the device; the message holds the compiler's words."""


class OutOfMemoryError(DeviceError, MemoryError):
    """The work does not fit into the memory of the device, or into the budget given."""
