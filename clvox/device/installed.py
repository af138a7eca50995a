"""Which OpenCL drivers are registered on this system, and what stands in the way of those."""

from __future__ import annotations

import ctypes
import os
import sys
from dataclasses import dataclass
from pathlib import Path

import pyopencl as cl

from clvox.device import _drivers

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
    named = next(filter(None, map(os.environ.get, _drivers.CHOSEN_BY_USER)), None)
    folder = _drivers.LIST if named is None else Path(named)
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
    return [
        Platform(one.name.strip(), one.vendor.strip(), one.version.strip(), _count(one))
        for one in _drivers.platforms()
    ]


def _count(driver: cl.Platform) -> int:
    try:
        return len(driver.get_devices())
    except cl.Error:
        return 0
