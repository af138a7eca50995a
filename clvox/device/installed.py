"""Which OpenCL drivers are registered on this system, and what stands in the way of those."""

from __future__ import annotations

import ctypes
import os
import sys
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import pyopencl as cl

from clvox.device.choice import devices
from clvox.errors import DeviceError

_LIST = Path("/etc/OpenCL/vendors")
_VARIABLES = "OCL_ICD_VENDORS", "OPENCL_VENDOR_PATH"
_ENTRY = "clGetExtensionFunctionAddress"
"""What a loader asks every driver for."""


@dataclass(frozen=True)
class Driver:
    """A driver that is registered.

    Attributes
    ----------
    file : str
        The ``.icd`` file that registers it.
    library : str
        The library that the file names; empty if it names none.
    problem : str or None
        Why no loader can use it.
    """

    file: str
    library: str
    problem: str | None


@dataclass(frozen=True)
class Platform:
    """A driver that answers.

    Attributes
    ----------
    name, vendor, version : str
    devices : int
        How many it has; some drivers come without.
    """

    name: str
    vendor: str
    version: str
    devices: int


def drivers() -> list[Driver]:
    """Return the drivers that ``.icd`` files register; none where a system keeps no such files.

    A loader passes over one that it cannot use, without a word.  The libraries are loaded to see
    whether that works, as the loader has done before.
    """
    if not sys.platform.startswith("linux"):
        return []
    named = next(filter(None, map(os.environ.get, _VARIABLES)), None)
    folder = _LIST if named is None else Path(named)
    files = [folder] if folder.suffix == ".icd" else sorted(folder.glob("*.icd"))
    return [_driver(file) for file in files]


def _driver(file: Path) -> Driver:
    try:
        lines = file.read_text().split("\n")
    except (OSError, UnicodeDecodeError) as error:
        return Driver(str(file), "", f"the file cannot be read: {error}")
    library = lines[0].strip()
    if not library:
        return Driver(str(file), "", "the file names no library")
    try:
        loaded = ctypes.CDLL(library)
    except (OSError, ValueError) as error:
        return Driver(str(file), library, f"the library cannot be loaded: {error}")
    if not hasattr(loaded, _ENTRY):
        return Driver(str(file), library, f"the library is no OpenCL driver: it has no {_ENTRY}")
    return Driver(str(file), library, None)


def platforms() -> list[Platform]:
    """Return the drivers that answer, those without a device too."""
    with suppress(DeviceError):
        # The first call of all is left to it, since the loader reads its list only once.
        devices()
    try:
        answering = cl.get_platforms()
    except cl.Error:
        # A loader without any driver says so by an error.
        return []
    return [
        Platform(driver.name.strip(), driver.vendor.strip(), driver.version.strip(), _count(driver))
        for driver in answering
    ]


def _count(driver: cl.Platform) -> int:
    try:
        return len(driver.get_devices())
    except cl.Error:
        return 0
