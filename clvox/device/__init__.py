"""The OpenCL device: which one, its queue and programs, its memory."""

from clvox.device.choice import Device, DeviceLike, choose, devices
from clvox.device.session import GROUP, Session, open_session

__all__ = ["GROUP", "Device", "DeviceLike", "Session", "choose", "devices", "open_session"]
