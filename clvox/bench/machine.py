"""On what a benchmark ran."""

from __future__ import annotations

import os
import platform
import re
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from clvox._version import __version__
from clvox.device import Session

LIBRARIES = ("numpy", "pyopencl", "scikit-image", "trimesh")


def machine(session: Session, libraries: Sequence[str] = LIBRARIES) -> dict[str, Any]:
    """Return what one has to know of this machine to read its timings.

    Parameters
    ----------
    session : Session
        The OpenCL device that was used.
    libraries : sequence of str
        Distributions whose versions count; those that are not installed are left out.

    Returns
    -------
    dict
        cpu, cores (that this process may use), os (its kind, and the C library), python, device,
        driver, and versions by name.
    """
    versions = {"clvox": __version__}
    for name in libraries:
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            continue
    return {
        "cpu": _cpu(),
        "cores": _cores(),
        "os": _system(),
        "python": platform.python_version(),
        "device": str(session.device),
        "driver": session.device.version,
        "versions": versions,
    }


def slug(name: str) -> str:
    """Return *name* as a file may be called: lower-case letters, digits and hyphens."""
    return re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-")


def _cpu() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def _system() -> str:
    # Not the kernel's release, which tells of the host more than its timings need.
    return " ".join(filter(None, [platform.system(), *platform.libc_ver()]))


def _cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
