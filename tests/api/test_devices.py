"""Which devices there are, which one is meant, and what is said when there is none."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pyopencl as cl
import pytest

import clvox
from clvox.device import Device, Session, _drivers, _pocl, choice, choose, devices, open_session
from clvox.errors import DeviceError, KernelBuildError

POCL = "Portable Computing Language"


@pytest.fixture(autouse=True)
def no_wish(monkeypatch: pytest.MonkeyPatch) -> None:
    """No device is asked for but by the test itself."""
    monkeypatch.delenv("CLVOX_DEVICE", raising=False)


def device(name: str, platform: str, kind: str) -> Device:
    """A device that is only looked at."""
    return Device(name, platform, "OpenCL 3.0", kind, 1 << 30, 1 << 28, 4, False, cast("Any", None))


ZOO = [
    device("Graphics 9000", "GPU Vendor", "gpu"),
    device("Graphics 9000 Super", "GPU Vendor", "gpu"),
    device("pthread-some", POCL, "cpu"),
    device("Some CPU", "Intel(R) OpenCL", "cpu"),
]


@pytest.fixture
def zoo(monkeypatch: pytest.MonkeyPatch) -> list[Device]:
    """A machine with four devices."""
    monkeypatch.setattr(choice, "devices", lambda: ZOO)
    return ZOO


# --- what there is ------------------------------------------------------------------------------


def test_devices_say_what_they_are() -> None:
    """Each device has a name, a kind and sizes that make sense."""
    for found in devices():
        assert found.name
        assert found.platform
        assert found.version.startswith("OpenCL ")
        assert found.kind in ("gpu", "cpu", "accelerator")
        assert 0 < found.largest_allocation <= found.memory
        assert found.units >= 1
        assert str(found) == f"{found.platform} / {found.name}"
        assert "handle" not in repr(found)


def test_devices_is_public_and_answers_the_same_again() -> None:
    assert clvox.devices() == devices() == devices()


def test_gpus_come_first_then_pocl(monkeypatch: pytest.MonkeyPatch) -> None:
    """Equal ones stay in the loader's order; PoCL's own GPUs are GPUs like others."""
    vendor, other = device("g1", "Vendor", "gpu"), device("g2", POCL, "gpu")
    intel, pocl, board = (
        device("c1", "Intel(R) OpenCL", "cpu"),
        device("c2", POCL, "cpu"),
        device("a", "Board", "accelerator"),
    )
    listed = [intel, board, vendor, pocl, other]
    platform = SimpleNamespace(get_devices=lambda: listed)
    monkeypatch.setattr("clvox.device.choice.platforms", lambda: (platform,))
    monkeypatch.setattr(choice, "_describe", lambda handle: handle)
    assert devices() == [vendor, other, pocl, intel, board]


def test_a_platform_without_devices_is_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse() -> list[cl.Device]:
        raise cl.LogicError("clGetDeviceIDs failed: DEVICE_NOT_FOUND")

    present = _drivers.platforms()
    empty = SimpleNamespace(get_devices=refuse)
    expected = devices()
    monkeypatch.setattr("clvox.device.choice.platforms", lambda: (empty, *present))
    assert devices() == expected


# --- which one is meant -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("wanted", "number"),
    [
        (None, 0),
        (0, 0),
        (1, 1),
        ("3", 3),
        (" 2 ", 2),
        ("gpu", 0),
        ("CPU", 2),
        ("super", 1),
        ("intel", 3),
        ("Portable Computing", 2),
        ("GPU Vendor / Graphics 9000 S", 1),
        ("opencl 3.0", 0),
        (ZOO[3], 3),
    ],
)
def test_choose(zoo: list[Device], wanted: str | int | Device | None, number: int) -> None:
    """By number, by kind, by a part of name, platform or version, in any case."""
    assert choose(wanted) is zoo[number]


def test_the_environment_chooses(zoo: list[Device], monkeypatch: pytest.MonkeyPatch) -> None:
    """CLVOX_DEVICE stands in for an argument, and only for one that is not given."""
    monkeypatch.setenv("CLVOX_DEVICE", "intel")
    assert choose() is zoo[3]
    assert choose("super") is zoo[1]
    monkeypatch.setenv("CLVOX_DEVICE", "")
    assert choose() is zoo[0]


@pytest.mark.parametrize("wanted", ["nvidia", "4", 17, "-1", "accelerator"])
def test_an_absent_device_is_an_error_that_lists_the_present_ones(
    zoo: list[Device], monkeypatch: pytest.MonkeyPatch, wanted: str | int
) -> None:
    with pytest.raises(DeviceError, match="no OpenCL device matches") as caught:
        choose(wanted)
    message = str(caught.value)
    assert repr(wanted) in message
    for number, found in enumerate(zoo):
        assert f"{number}: {found}" in message
    monkeypatch.setenv("CLVOX_DEVICE", str(wanted))
    with pytest.raises(DeviceError, match="no OpenCL device matches"):
        choose()


def test_a_device_has_one_session(session: Session) -> None:
    """However it is named."""
    number = devices().index(session.device)
    assert open_session(number) is session
    assert open_session(session.device) is session
    assert open_session(str(session.device)) is session


# --- what to install ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("system", "said", "unsaid"),
    [
        ("Linux", ["'clvox[pocl]'", "'clvox[intel]'", "pocl-opencl-icd"], ["macOS"]),
        ("Windows", ["GPU vendor's driver", "'clvox[intel]'"], ["apt", "pocl"]),
        ("Darwin", ["macOS has its own OpenCL"], ["pip", "apt"]),
    ],
)
def test_advice_fits_the_system(
    monkeypatch: pytest.MonkeyPatch, system: str, said: list[str], unsaid: list[str]
) -> None:
    monkeypatch.setattr("clvox.device.choice.platforms", lambda: ())
    monkeypatch.setattr("platform.system", lambda: system)
    with pytest.raises(DeviceError, match="no OpenCL device was found") as caught:
        devices()
    assert all(words in str(caught.value) for words in said)
    assert not any(words in str(caught.value) for words in unsaid)


PRINT_DEVICES = "import clvox; print(*clvox.devices(), sep='\\n')"
WITHOUT_POCL = "import os, pyopencl; os.environ['PYOPENCL_HOME'] = os.devnull\n"
"""PyOpenCL's loader finds the PoCL that lies beside it, unless it is led astray."""


def run(code: str, vendors: Path | None, **variables: str) -> subprocess.CompletedProcess[str]:
    """Run *code* in a process of its own, in which OpenCL has not been used yet."""
    environment = {
        name: value
        for name, value in os.environ.items()
        if name not in ("OCL_ICD_VENDORS", "OPENCL_VENDOR_PATH", "CLVOX_DEVICE")
    }
    if vendors is not None:
        environment["OCL_ICD_VENDORS"] = str(vendors)
    return subprocess.run(
        [sys.executable, "-c", code],
        env=environment | variables,
        cwd=Path(clvox.__file__).parents[1],
        capture_output=True,
        text=True,
        check=False,
    )


def test_no_driver_at_all(tmp_path: Path) -> None:
    """The user said where drivers are, and there are none: an error with advice."""
    ended = run(WITHOUT_POCL + PRINT_DEVICES, tmp_path)
    assert ended.returncode == 1
    last = ended.stderr.strip().splitlines()[-1]
    assert last.startswith("clvox.errors.DeviceError: no OpenCL device was found. ")
    assert choice._advice() in last


def test_broken_drivers_are_passed_over(tmp_path: Path) -> None:
    """A list that names no library, nothing, or not even text, is no reason to crash."""
    (tmp_path / "absent.icd").write_text("/nowhere/libabsent.so\n")
    (tmp_path / "empty.icd").write_text("")
    (tmp_path / "bytes.icd").write_bytes(bytes(range(128, 256)))
    (tmp_path / "text.so").write_text("not a library")
    (tmp_path / "text.icd").write_text(f"{tmp_path / 'text.so'}\n")
    (tmp_path / "gone.icd").symlink_to(tmp_path / "gone")
    ended = run(WITHOUT_POCL + PRINT_DEVICES, tmp_path)
    assert "clvox.errors.DeviceError: no OpenCL device was found" in ended.stderr
    assert ended.returncode == 1


# --- drivers that pip installed -----------------------------------------------------------------

NEEDS_INTEL = pytest.mark.skipif(
    _drivers.intel_driver() is None, reason="intel-opencl-rt is not installed"
)


@NEEDS_INTEL
def test_pip_install_is_enough(tmp_path: Path) -> None:
    """Intel's wheel is found, beside PoCL's, and leaves no trace in the environment."""
    says = "; import os; print('OCL_ICD_VENDORS' in os.environ)"
    ended = run(PRINT_DEVICES + says, None, TMPDIR=str(tmp_path))
    *found, listed = ended.stdout.splitlines()
    assert any("Intel" in name for name in found), ended.stderr
    assert listed == "False"
    assert not list(tmp_path.iterdir())
    beside = run(PRINT_DEVICES, tmp_path).stdout.splitlines()
    assert [name for name in found if "Intel" not in name] == beside


@NEEDS_INTEL
def test_pip_install_is_enough_to_voxelize() -> None:
    code = (
        "import clvox, trimesh\n"
        "print(clvox.voxelize(trimesh.creation.box(), resolution=8, device='intel').count)"
    )
    ended = run(code, None)
    assert ended.stdout == "512\n", ended.stderr
    assert ended.stderr == ""


@NEEDS_INTEL
def test_the_user_decides_where_drivers_are(tmp_path: Path) -> None:
    ended = run(WITHOUT_POCL + PRINT_DEVICES, tmp_path)
    assert "Intel" not in ended.stdout
    assert "DeviceError" in ended.stderr


@pytest.fixture
def unused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """As if OpenCL had not been used yet; the system's list of drivers is empty."""
    for name in ("OCL_ICD_VENDORS", "OPENCL_VENDOR_PATH", "OCL_ICD_FILENAMES"):
        monkeypatch.delenv(name, raising=False)
    folder = tmp_path / "vendors"
    folder.mkdir()
    monkeypatch.setattr(_drivers, "LIST", folder)
    return folder


DRIVER = Path("/somewhere/libintelocl.so")


def fake_loader(monkeypatch: pytest.MonkeyPatch, folder: Path, *, bundled: bool) -> None:
    """Have PyOpenCL lie in *folder*, with a loader of its own or without."""
    libraries = folder / "pyopencl" / ".libs"
    libraries.mkdir(parents=True)
    if bundled:
        (libraries / "libOpenCL-1.so").touch()
    monkeypatch.setattr(cl, "__file__", str(folder / "pyopencl" / "__init__.py"))


def test_the_list_for_the_loader_begins_with_the_systems(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, unused: Path
) -> None:
    fake_loader(monkeypatch, tmp_path, bundled=True)
    (unused / "vendor.icd").write_text("libvendor.so\n")
    (unused / "gone.icd").symlink_to(unused / "gone")
    (unused / "bytes.icd").write_bytes(b"\xff")
    (unused / "notes.txt").write_text("not a driver")
    with _drivers._listed(DRIVER):
        folder = Path(os.environ["OCL_ICD_VENDORS"])
        assert {path.name: path.read_text() for path in folder.iterdir()} == {
            "vendor.icd": "libvendor.so\n",
            "clvox-intel.icd": f"{DRIVER}\n",
        }
    assert "OCL_ICD_VENDORS" not in os.environ
    assert not folder.exists()


def test_a_driver_that_the_system_has_is_not_listed_twice(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, unused: Path
) -> None:
    fake_loader(monkeypatch, tmp_path, bundled=True)
    (unused / "intel.icd").write_text("/opt/intel/lib/libintelocl.so\n")
    with _drivers._listed(DRIVER):
        assert "OCL_ICD_VENDORS" not in os.environ


@pytest.mark.usefixtures("unused")
@pytest.mark.skipif(sys.platform == "win32", reason="the folder of a library must exist there")
def test_other_loaders_are_told_of_one_driver_more(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    fake_loader(monkeypatch, tmp_path, bundled=False)
    with _drivers._listed(DRIVER):
        assert os.environ["OCL_ICD_FILENAMES"] == str(DRIVER)
        assert "OCL_ICD_VENDORS" not in os.environ
    assert "OCL_ICD_FILENAMES" not in os.environ
    monkeypatch.setenv("OCL_ICD_FILENAMES", "/mine.so")
    with _drivers._listed(DRIVER):
        assert os.environ["OCL_ICD_FILENAMES"] == f"/mine.so{os.pathsep}{DRIVER}"
    assert os.environ["OCL_ICD_FILENAMES"] == "/mine.so"


@pytest.mark.usefixtures("unused")
def test_many_threads_make_one_first_call(monkeypatch: pytest.MonkeyPatch) -> None:
    """The environment is changed once, whoever comes first."""
    calls = []

    @contextmanager
    def listed(driver: Path) -> Iterator[None]:
        calls.append(driver)
        yield

    monkeypatch.setattr(_drivers, "intel_driver", lambda: DRIVER)
    monkeypatch.setattr(_drivers, "_listed", listed)
    _drivers._platforms.cache_clear()
    threads = [threading.Thread(target=_drivers.platforms) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert calls == [DRIVER]


@pytest.mark.parametrize("name", ["OCL_ICD_VENDORS", "OPENCL_VENDOR_PATH"])
def test_a_users_list_is_left_alone(
    monkeypatch: pytest.MonkeyPatch, unused: Path, name: str
) -> None:
    monkeypatch.setenv(name, str(unused))
    monkeypatch.setattr(_drivers, "intel_driver", lambda: pytest.fail("was looked for"))
    _drivers._platforms.cache_clear()
    assert _drivers.platforms() == tuple(cl.get_platforms())


# --- PoCL on processors it does not know --------------------------------------------------------


@pytest.mark.parametrize(
    "version",
    [
        "OpenCL 3.0 PoCL 3.0-rc3  Linux, Release, RELOC, LLVM 14.0.6, SLEEF",
        "OpenCL 3.0 PoCL 6.0  Linux, Release, RELOC, LLVM 18.1.8, SLEEF",
        "OpenCL 3.0 LINUX",
    ],
)
def test_other_drivers_are_not_touched(version: str) -> None:
    """Only the one build whose record is known; of another not even the address is asked for."""

    class Untouchable:
        platform = SimpleNamespace(version=version)

        @property
        def int_ptr(self) -> int:
            pytest.fail("the address was asked for")

    _pocl.name_processor(cast("cl.Device", Untouchable()))


@pytest.mark.skipif(sys.platform != "linux", reason="PoCL's wheel is for Linux")
@pytest.mark.parametrize(
    ("before", "flags", "after"),
    [
        (b"generic", "sse4_2 popcnt", b"nehalem"),
        (b"generic", "avx2 bmi1 bmi2 f16c fma movbe sse4_2 popcnt", b"haswell"),
        (b"generic", "", b"x86-64"),
        (b"znver3", "avx2 bmi1 bmi2 f16c fma movbe", b"znver3"),
        (b"generic-rv64", "", b"generic-rv64"),
    ],
)
def test_pocl_gets_a_name_for_the_processor(
    monkeypatch: pytest.MonkeyPatch, before: bytes, flags: str, after: bytes
) -> None:
    """In a record made like PoCL's, nothing but a name that says nothing is replaced."""
    import ctypes

    monkeypatch.setattr(_pocl, "_instructions", lambda: set(flags.split()))
    name = ctypes.create_string_buffer(before)
    record = np.full(200, 0xABCDEF, np.uint64)
    record[_pocl._NAME_OFFSET // 8] = ctypes.addressof(name)
    untouched = np.delete(record, _pocl._NAME_OFFSET // 8)
    fake = SimpleNamespace(
        platform=SimpleNamespace(version=f"OpenCL 3.0 {_pocl._BUILD}, SLEEF"),
        int_ptr=record.ctypes.data,
    )
    _pocl.name_processor(cast("cl.Device", fake))
    pointer = int(record[_pocl._NAME_OFFSET // 8])
    assert ctypes.string_at(pointer) == after
    assert name.value == before
    assert np.array_equal(np.delete(record, _pocl._NAME_OFFSET // 8), untouched)


BOUND = """
import os
import clvox
clvox.devices()
sets = [os.sched_getaffinity(int(thread)) for thread in os.listdir("/proc/self/task")]
print(sorted(next(iter(cores)) for cores in sets if len(cores) == 1))
print(os.environ.get("POCL_AFFINITY"))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere PoCL binds no threads")
@pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="of one core nothing can be seen")
@pytest.mark.parametrize("decided", [{}, {"POCL_AFFINITY": "0"}, {"POCL_MAX_PTHREAD_COUNT": "1"}])
def test_pocl_keeps_a_thread_on_each_core(decided: dict[str, str]) -> None:
    """Unless somebody has decided otherwise; and no process that starts later learns of it."""
    if not any(platform.name == POCL for platform in _drivers.platforms()):
        pytest.skip("PoCL is not installed")
    cores = os.sched_getaffinity(0)
    if cores != set(range(os.cpu_count() or 0)):
        pytest.skip("this process may not use every core")
    environment = {name: value for name, value in os.environ.items() if "POCL_" not in name}
    said = subprocess.run(
        [sys.executable, "-c", BOUND],
        capture_output=True,
        text=True,
        check=True,
        env=environment | decided,
    ).stdout.splitlines()
    assert said == [str([] if decided else sorted(cores)), str(decided.get("POCL_AFFINITY"))]


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere PoCL binds no threads")
def test_threads_are_not_bound_where_not_every_core_may_be_used(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("POCL_AFFINITY", raising=False)
    monkeypatch.delenv("POCL_MAX_PTHREAD_COUNT", raising=False)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set[int]())
    seen: list[str | None] = []

    def find() -> list[cl.Platform]:
        seen.append(os.environ.get("POCL_AFFINITY"))
        return []

    _pocl.start_threads(find)
    assert seen == [None]


def test_kernels_build(session: Session) -> None:
    """On whatever device this is, also on a processor younger than the driver's compiler."""
    words = session.upload(np.arange(100, dtype=np.uint32))
    session.run(session.kernel("buffers/clear.cl", "clear"), 100, np.uint64(100), words)
    assert not words.get().any()


@pytest.mark.parametrize("young", [True, False])
def test_a_compiler_older_than_the_processor(
    session: Session, monkeypatch: pytest.MonkeyPatch, *, young: bool
) -> None:
    """The error says what to do, and only where that helps."""
    complaint = "error: unknown target CPU 'generic'" if young else "error: no such thing"

    def refuse(*_: object) -> None:
        raise cl.RuntimeError(f"clBuildProgram failed: BUILD_PROGRAM_FAILURE\n{complaint}")

    monkeypatch.setattr(cl.Program, "build", refuse)
    with pytest.raises(KernelBuildError) as caught:
        session._build("buffers/clear.cl", {})
    assert complaint in str(caught.value)
    assert ("pip install 'clvox[intel]'" in str(caught.value)) == young


def test_drivers_before_opencl_3_have_no_optional_features() -> None:
    class Old:
        @property
        def opencl_c_features(self) -> list[object]:
            raise cl.LogicError("clGetDeviceInfo failed: INVALID_VALUE")

    new = SimpleNamespace(opencl_c_features=[SimpleNamespace(name="__opencl_c_int64")])
    assert choice._features(cast("Any", Old())) == set()
    assert choice._features(cast("Any", SimpleNamespace())) == set()
    assert choice._features(cast("Any", new)) == {"__opencl_c_int64"}
