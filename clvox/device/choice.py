"""Which OpenCL devices there are, and which one is meant."""

from __future__ import annotations

import os
import platform
from dataclasses import dataclass, field
from typing import TypeAlias

import pyopencl as cl

from clvox.device._drivers import platforms
from clvox.device._pocl import NAME, name_processor
from clvox.errors import DeviceError

DeviceLike: TypeAlias = "str | int | Device | None"


@dataclass(frozen=True)
class Device:
    """An OpenCL device.

    Attributes
    ----------
    name, platform, version : str
        As the driver gives them.
    kind : str
        "gpu", "cpu" or "accelerator".
    memory, largest_allocation : int
        Bytes of memory, and of the largest single buffer.
    units : int
        Compute units.
    atomic_loads : bool
        Whether kernels may look at a word that others are changing: an option of OpenCL C 3.0.
    """

    name: str
    platform: str
    version: str
    kind: str
    memory: int
    largest_allocation: int
    units: int
    atomic_loads: bool
    handle: cl.Device = field(repr=False, compare=False)

    def __str__(self) -> str:
        return f"{self.platform} / {self.name}"


def devices() -> list[Device]:
    """Return every OpenCL device of this machine: GPUs first, then PoCL's, then the others.

    A driver that pip installed with ``clvox[pocl]`` or ``clvox[intel]`` is among them, unless
    ``OCL_ICD_VENDORS`` says where drivers are, and unless OpenCL was used before.

    Raises
    ------
    DeviceError
        There is no OpenCL driver, or no driver has a device; the message says what to install.
    """
    found = [_describe(handle) for driver in platforms() for handle in _handles(driver)]
    if not found:
        raise DeviceError(f"no OpenCL device was found. {_advice()}")
    return sorted(found, key=_preference)


def choose(wanted: DeviceLike = None) -> Device:
    """Return the device that is meant.

    Parameters
    ----------
    wanted : str, int or Device, optional
        A number of the list that `devices` gives, a kind ("gpu", "cpu"), or a part of a device's
        name, platform or version, in any case.  Without it the environment's ``CLVOX_DEVICE``
        decides, and without that the first GPU or else the first device.

    Raises
    ------
    DeviceError
        No device matches what was asked for; the message lists the devices that there are.
    """
    if isinstance(wanted, Device):
        return wanted
    present = devices()
    if wanted is None:
        wanted = os.environ.get("CLVOX_DEVICE") or None
    if wanted is None:
        return present[0]
    text = str(wanted).strip().lower()
    if text.isdigit():
        matching = present[int(text) : int(text) + 1]
    else:
        matching = [device for device in present if text == device.kind] or [
            device for device in present if text in f"{device} {device.version}".lower()
        ]
    if not matching:
        here = "; ".join(f"{number}: {device}" for number, device in enumerate(present))
        raise DeviceError(f"no OpenCL device matches {wanted!r}; devices here: {here}")
    return matching[0]


def _preference(device: Device) -> int:
    """Where a device stands in the list; equal ones stay in the loader's order."""
    if device.kind == "gpu":
        return 0
    return 1 if device.platform == NAME else 2


def _handles(driver: cl.Platform) -> list[cl.Device]:
    try:
        return driver.get_devices()
    except cl.Error:
        # A platform without devices says so by an error.
        return []


def _describe(handle: cl.Device) -> Device:
    name_processor(handle)
    kinds = {cl.device_type.GPU: "gpu", cl.device_type.CPU: "cpu"}
    kind = next((word for bit, word in kinds.items() if handle.type & bit), "accelerator")
    return Device(
        name=handle.name.strip(),
        platform=handle.platform.name.strip(),
        version=handle.version.strip(),
        kind=kind,
        memory=handle.global_mem_size,
        largest_allocation=handle.max_mem_alloc_size,
        units=handle.max_compute_units,
        atomic_loads="__opencl_c_atomic_scope_device" in _features(handle),
        handle=handle,
    )


def _features(handle: cl.Device) -> set[str]:
    """The optional features of OpenCL C that a device has; before version 3.0, none."""
    try:
        return {feature.name for feature in handle.opencl_c_features}
    except (cl.Error, AttributeError):
        return set()


def _advice() -> str:
    """What to install on this system to have a device."""
    system = platform.system()
    if system == "Linux":
        return (
            "Install one with pip install 'clvox[pocl]' (x86-64) or 'clvox[intel]' (x86-64), with "
            "apt install pocl-opencl-icd, or install your GPU vendor's driver."
        )
    if system == "Windows":
        return "Install your GPU vendor's driver, or pip install 'clvox[intel]' for the processor."
    return "macOS has its own OpenCL; elsewhere install your GPU vendor's driver or PoCL."
