"""What stands between this machine and voxels: drivers, devices, and what each can really do."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clvox import device as opencl
from clvox._version import __version__
from clvox.device import Device, Session, devices, open_session
from clvox.errors import ClvoxError, DeviceError
from clvox.grid import Axis, Grid
from clvox.models import count_crossings, voxelize
from clvox.ops import selftest
from clvox.reference import selftest as expected

Topic: TypeAlias = Literal["system", "driver", "platform", "device", "test", "advice"]

NOTHING_FOUND = 3
"""Exit status when there is no device at all."""

_AXES: tuple[Axis, ...] = ("x", "y", "z")
_CONTENDERS = 1 << 16
_PACKAGES = "pyopencl", "numpy", "trimesh", "scikit-image"

TETRAHEDRON = (
    [[2, 2, 2], [30, 6, 10], [6, 30, 14], [14, 10, 30]],
    [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]],
)
"""Its corners, and many edges with them, lie on voxel centres of `GRID`: ties are common."""

TETRAHEDRON_COUNT = 2808
TETRAHEDRON_DIGEST = "5be01ac74298b730"

GRID = Grid((-0.5, -0.5, -0.5), (1.0, 1.0, 1.0), (33, 33, 33))


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at.

    Attributes
    ----------
    topic : str
        "system", "driver", "platform", "device", "test" or "advice".
    subject : str
        What it is about: for a test, the device.
    failed : bool
        It does not work as it should.
    text : str
        What was found.
    """

    topic: Topic
    subject: str
    failed: bool
    text: str

    def __str__(self) -> str:
        return f"{self.topic}: {self.subject}: {'FAILED: ' * self.failed}{self.text}"


def examine() -> list[Finding]:
    """Return what there is to say about OpenCL on this machine.

    Drivers that are registered and cannot be loaded, platforms, devices with their versions and
    limits, and for each device a self-test: atomics under contention, 64-bit integers, rounding,
    and small meshes whose voxels are known.  Without a device, what to install.

    A test never raises: what goes wrong is a finding that failed.  A driver that crashes takes
    the process with it; the finding before it is then the last one.
    """
    return list(examining())


def examining() -> Iterator[Finding]:
    """Yield the findings of `examine` as they are made."""
    yield from _system()
    for driver in opencl.drivers():
        text = driver.problem or f"{driver.library} can be loaded"
        if driver.problem and driver.library:
            text = f"{driver.library}: {text}"
        yield Finding("driver", driver.file, driver.problem is not None, text)
    for found in opencl.platforms():
        count = f"{found.devices} devices" if found.devices != 1 else "1 device"
        yield Finding("platform", found.name, failed=False, text=f"{found.version}, {count}")
    try:
        present = devices()
    except DeviceError:
        system, machine = platform.system(), platform.machine()
        where = f"{system} on {machine}"
        yield Finding("advice", where, failed=True, text="no OpenCL device was found")
        for text in advice(system, machine):
            yield Finding("advice", where, failed=False, text=text)
        return
    for device in present:
        yield from _device(device)


def exit_status(findings: list[Finding]) -> int:
    """Return 0 if all is good, 1 if something failed, 3 if there is no device at all."""
    if not any(finding.topic == "device" for finding in findings):
        return NOTHING_FOUND
    return int(any(finding.failed for finding in findings))


def _system() -> Iterator[Finding]:
    words = f"{platform.system()} {platform.release()} on {platform.machine()}"
    python = f"{platform.python_implementation()} {platform.python_version()}"
    yield Finding(
        "system", "versions", failed=False, text=f"clvox {__version__}, {python}, {words}"
    )
    found = []
    for package in _PACKAGES:
        try:
            found.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            found.append(f"{package} of unknown version")
    yield Finding("system", "packages", failed=False, text=", ".join(found))


def _device(device: Device) -> Iterator[Finding]:
    name = str(device)
    group = device.handle.max_work_group_size
    text = (
        f"{device.kind}, {device.version}, driver {device.handle.driver_version.strip()}, "
        f"{device.units} units, {device.memory:,} bytes of memory, {device.largest_allocation:,} "
        f"in one buffer, {device.handle.local_mem_size:,} of local memory, groups of {group}"
    )
    if group < opencl.GROUP:
        text += f"; clvox needs groups of {opencl.GROUP}"
    yield Finding("device", name, group < opencl.GROUP, text)
    for words, test in TESTS.items():
        try:
            problem = test(open_session(device))
        except (ClvoxError, *opencl.DRIVER_ERRORS) as error:
            problem = str(error).strip() or type(error).__name__
        yield Finding("test", name, problem is not None, f"{words}: {problem or 'right'}")


def advice(system: str, machine: str) -> tuple[str, ...]:
    """Return what may bring a device to a computer of this kind, the easiest first.

    Parameters
    ----------
    system, machine : str
        As `platform.system` and `platform.machine` name them.
    """
    intel = machine.lower() in ("x86_64", "amd64")
    runtime = "pip install 'clvox[intel]' brings Intel's runtime for the processor (x86-64)"
    vendor = "a GPU has its OpenCL driver from its vendor: NVIDIA, AMD or Intel"
    if system == "Linux":
        wheel = "pip install 'clvox[pocl]' brings PoCL for the processor"
        package = "the package pocl-opencl-icd of Debian and Ubuntu, pocl elsewhere, is PoCL too"
        files = (
            "drivers register themselves by an .icd file in /etc/OpenCL/vendors, or in the folder "
            "that OCL_ICD_VENDORS names: is it set by mistake?"
        )
        if intel:
            return wheel, runtime, package, vendor, files
        return f"{package} (its wheel is for x86-64 only)", vendor, files
    if system == "Windows":
        return (runtime, vendor) if intel else (vendor,)
    if system == "Darwin":
        system_own = (
            "macOS brings OpenCL with the system; where PyOpenCL does not see it, its package from "
            "conda-forge does, with ocl_icd_wrapper_apple"
        )
        return (
            system_own,
            "the package pocl from conda-forge runs on the processor; PoCL's wheel does not",
        )
    return "PoCL runs on the processor wherever LLVM does", vendor


# --- the self-test: each returns what is wrong, or None -----------------------------------------


def _atomics(session: Session) -> str | None:
    found, right = selftest.contend(session, _CONTENDERS), expected.contend(_CONTENDERS)
    names = "inc", "add", "xor", "or", "max", "min"
    return _differences(names, found[None], right[None])


def _integers(session: Session) -> str | None:
    rng = np.random.default_rng(1)
    special = [0, 1, 2**31, 2**32 - 1, 2**32, 2**62, 2**63 - 1, 2**63, 2**64 - 1]
    a = np.concatenate([np.array(special * 9, np.uint64), rng.integers(0, 2**64, 400, np.uint64)])
    b = np.concatenate(
        [np.repeat(np.array(special, np.uint64), 9), rng.integers(0, 2**64, 400, np.uint64)]
    )
    names = ("product", "left shift", "right shift", "signed right shift", "set bits", "less",
             "less as signed")  # fmt: skip
    return _differences(names, selftest.calculate(session, a, b), expected.calculate(a, b))


def _rounding(session: Session) -> str | None:
    rng = np.random.default_rng(2)
    halves = np.arange(-16, 17).astype(np.float32) / 2
    a = np.concatenate([halves, rng.uniform(-4096, 4096, 400).astype(np.float32)])
    b = rng.uniform(-1, 1, len(a)).astype(np.float32)
    # Near the product, so that a fused multiply-add shows.
    c = (-a * b * np.float32(1 + 2**-20)).astype(np.float32)
    found = selftest.round_off(session, a, b, c)
    return _differences(("rint", "a * b + c"), found, expected.round_off(a, b, c))


def _differences(names: tuple[str, ...], found: NDArray[Any], right: NDArray[Any]) -> str | None:
    wrong = found != right
    if not wrong.any():
        return None
    row, column = np.argwhere(wrong)[0]
    return (
        f"{names[column]} is {found[row, column]} and should be {right[row, column]}, one of "
        f"{int(wrong.sum())} wrong answers of {wrong.size}"
    )


def _tetrahedron(session: Session) -> str | None:
    for levels in (None, [GRID.shape]):
        model = voxelize(TETRAHEDRON, grid=GRID, levels=levels, device=session.device)
        digest = digest_of(model.to_array())
        if model.count != TETRAHEDRON_COUNT or digest != TETRAHEDRON_DIGEST:
            kind = "two levels" if levels is None else "one level"
            return (
                f"{model.count} voxels with digest {digest} on {kind}; expected "
                f"{TETRAHEDRON_COUNT} with {TETRAHEDRON_DIGEST}"
            )
    return None


def digest_of(voxels: NDArray[np.bool_]) -> str:
    """Return a short name for the content of an array of voxels."""
    return hashlib.sha256(np.packbits(voxels).tobytes()).hexdigest()[:16]


def _ties(session: Session) -> str | None:
    corners = np.array([(x, y, z) for z in (4, 20) for y in (4, 20) for x in (4, 20)], float)
    faces = [[0, 2, 3], [0, 3, 1], [4, 5, 7], [4, 7, 6], [0, 1, 5], [0, 5, 4],
             [2, 6, 7], [2, 7, 3], [0, 4, 6], [0, 6, 2], [1, 3, 7], [1, 7, 5]]  # fmt: skip
    # A centre on a face is in where the body is above it, along each axis alike.
    right = np.zeros(GRID.shape[::-1], bool)
    right[4:20, 4:20, 4:20] = True
    found = voxelize((corners, faces), grid=GRID, device=session.device).to_array()
    if (found != right).any():
        return f"{int((found != right).sum())} voxels with their centres on a box's faces are wrong"
    for axis in _AXES:
        counts = count_crossings((corners, faces), grid=GRID, axis=axis, device=session.device)
        if counts.sum() != 2 * 16 * 16 or counts.max() != 2:
            return f"rays along {axis} through a box's edges cross it {counts.sum()} times, not 512"
    return None


TESTS: dict[str, Callable[[Session], str | None]] = {
    "32-bit atomics under contention": _atomics,
    "64-bit integers": _integers,
    "rounding": _rounding,
    "a tetrahedron": _tetrahedron,
    "a box with its faces on voxel centres": _ties,
}
"""The self-test, by what is tried."""
