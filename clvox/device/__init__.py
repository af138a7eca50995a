"""The OpenCL device: which one, its queue and programs, its memory."""

from pyopencl import Error as _Error

from clvox.device.choice import Device, DeviceLike, choose, devices
from clvox.device.installed import Driver, Platform, drivers, platforms
from clvox.device.session import GROUP, Session, open_session

__all__ = [
    "DRIVER_ERRORS",
    "GROUP",
    "Device",
    "DeviceLike",
    "Driver",
    "Platform",
    "Session",
    "choose",
    "devices",
    "drivers",
    "open_session",
    "platforms",
]

DRIVER_ERRORS = (_Error,)
"""What a driver that fails raises, where clvox does not say it in words of its own."""
