"""Drivers that pip installed, which no OpenCL loader looks for.

A loader reads its list of drivers once, in the first OpenCL call of the process.  The list that
Intel's wheel installs lies in the virtual environment, where nobody reads it, and names a folder
that does not exist.  So the first call is made here, with the wheel's driver added to what the
loader would find anyway.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import cache
from importlib.metadata import PackageNotFoundError, files
from pathlib import Path
from tempfile import TemporaryDirectory

import pyopencl as cl

from clvox.device._environment import variable
from clvox.device._pocl import start_threads

LIST = Path("/etc/OpenCL/vendors")
"""Where the loader in PyOpenCL's wheels looks; it finds PoCL's wheel beside itself, always."""

CHOSEN_BY_USER = "OCL_ICD_VENDORS", "OPENCL_VENDOR_PATH"
_DRIVERS = "libintelocl.so", "intelocl64.dll"

_lock = threading.Lock()


def platforms() -> tuple[cl.Platform, ...]:
    """Return every OpenCL platform, those of drivers that pip installed among them."""
    # The environment, which the first call changes for a moment, belongs to all threads.
    with _lock:
        return _platforms()


@cache
def _platforms() -> tuple[cl.Platform, ...]:
    driver = None if any(map(os.environ.get, CHOSEN_BY_USER)) else intel_driver()
    with _listed(driver) if driver else ExitStack():
        try:
            return start_threads(cl.get_platforms)
        except cl.Error:
            # A loader without any driver says so by an error.
            return ()


def intel_driver() -> Path | None:
    """Return the driver in the wheel intel-opencl-rt, if that is installed."""
    try:
        installed = files("intel-opencl-rt") or []
    except PackageNotFoundError:
        return None
    found = (Path(str(file.locate())).resolve() for file in installed if file.name in _DRIVERS)
    return next((path for path in found if path.exists()), None)


@contextmanager
def _listed(driver: Path) -> Iterator[None]:
    """Have the loader find *driver*, beside all that it finds anyway."""
    with ExitStack() as stack:
        if any(Path(cl.__file__).parent.glob(".libs/libOpenCL*")):
            # The loader in PyOpenCL's wheels for Linux, ocl-icd, takes a list instead of its own,
            # never in addition: so ours begins with a copy of that.
            drivers = _system_drivers()
            if not any(driver.name in line for line in drivers.values()):
                drivers["clvox-intel.icd"] = f"{driver}\n"
                folder = stack.enter_context(TemporaryDirectory(prefix="clvox-icd-"))
                for name, line in drivers.items():
                    Path(folder, name).write_text(line)
                stack.enter_context(variable("OCL_ICD_VENDORS", folder))
        else:
            # Khronos's loader, as on Windows, adds what this variable names.
            if sys.platform == "win32":
                stack.enter_context(os.add_dll_directory(str(driver.parent)))
            names = [os.environ.get("OCL_ICD_FILENAMES", ""), str(driver)]
            value = os.pathsep.join(filter(None, names))
            stack.enter_context(variable("OCL_ICD_FILENAMES", value))
        yield


def _system_drivers() -> dict[str, str]:
    """What each file of the system's list says."""
    found = {}
    for path in sorted(LIST.glob("*.icd")):
        try:
            found[path.name] = path.read_text()
        except (OSError, UnicodeDecodeError):
            # The loader passes over what it cannot read, too.
            continue
    return found
