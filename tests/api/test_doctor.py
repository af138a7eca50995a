"""`clvox.doctor`: with no driver, with broken ones, and with devices that answer wrongly."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from clvox import doctor
from clvox.cli import main
from clvox.device import DRIVER_ERRORS, Device, Session, source
from clvox.device import session as sessions
from clvox.device.installed import drivers
from clvox.doctor import TESTS, Finding, advice, exit_status
from clvox.errors import DeviceError, KernelBuildError
from clvox.ops import selftest
from clvox.reference.crossings import fill_parity
from tests.repository import ROOT

SAY = (
    "import sys; from clvox import doctor; found = doctor.examine()\n"
    "print(*found, sep='\\n'); sys.exit(doctor.exit_status(found))"
)
# PyOpenCL's loader finds the PoCL that lies beside it, unless it is led astray.
WITHOUT_POCL = "import os, pyopencl; os.environ['PYOPENCL_HOME'] = os.devnull\n"

LINUX = pytest.mark.skipif(sys.platform != "linux", reason=".icd files are for Linux")


def run(code: str, vendors: Path) -> tuple[int, list[str]]:
    """Run *code* where drivers are looked for in a folder; return its status and its lines."""
    ended = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": str(ROOT), "OCL_ICD_VENDORS": str(vendors)},
        check=False,
        capture_output=True,
        text=True,
    )
    assert not ended.stderr
    return ended.returncode, ended.stdout.splitlines()


def of_topic(topic: str, lines: list[str]) -> list[str]:
    return [line for line in lines if line.startswith(f"{topic}: ")]


# --- drivers ------------------------------------------------------------------------------------


@LINUX
def test_without_a_driver_there_is_advice(tmp_path: Path) -> None:
    status, lines = run(WITHOUT_POCL + SAY, tmp_path)
    assert status == 3
    assert not of_topic("device", lines)
    assert not of_topic("driver", lines)
    assert "no OpenCL device was found" in of_topic("advice", lines)[0]
    assert any("OCL_ICD_VENDORS" in line for line in of_topic("advice", lines))


@LINUX
@pytest.mark.parametrize("alone", [False, True])
def test_broken_drivers_are_named(tmp_path: Path, alone: bool) -> None:
    """Whether or not another one works: a loader would pass over them without a word."""
    texts = {
        "absent": "/nowhere/libabsent.so\n",
        "empty": "\n",
        "other": f"{np.linalg._umath_linalg.__file__}\n",
    }
    for name, text in texts.items():
        (tmp_path / f"{name}.icd").write_text(text)
    (tmp_path / "noise.icd").write_bytes(b"\xff\xfe\0")
    status, lines = run(WITHOUT_POCL * alone + SAY, tmp_path)
    told = of_topic("driver", lines)
    assert [line.split(": ")[2] for line in told] == ["FAILED"] * 4
    for name, words in [
        ("absent", "/nowhere/libabsent.so: the library cannot be loaded: "),
        ("empty", "the file names no library"),
        ("noise", "the file cannot be read"),
        ("other", "the library is no OpenCL driver: it has no clGetExtensionFunctionAddress"),
    ]:
        (line,) = (line for line in told if f"{name}.icd" in line)
        assert words in line
    if alone:
        assert status == 3
        assert of_topic("advice", lines)
    elif of_topic("device", lines):
        assert status == 1
        assert not of_topic("advice", lines)


@LINUX
def test_a_single_file_may_be_named_as_well(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "one.icd"
    file.write_text("libnone.so\n")
    (tmp_path / "two.icd").write_text("libnone.so\n")
    monkeypatch.setenv("OCL_ICD_VENDORS", str(file))
    assert [driver.file for driver in drivers()] == [str(file)]


@pytest.mark.parametrize(
    ("system", "machine", "words"),
    [
        ("Linux", "x86_64", ["clvox[pocl]", "clvox[intel]", "pocl-opencl-icd", "NVIDIA"]),
        ("Linux", "aarch64", ["its wheel is for x86-64 only", "NVIDIA"]),
        ("Windows", "AMD64", ["clvox[intel]", "NVIDIA"]),
        ("Windows", "ARM64", ["vendor"]),
        ("Darwin", "arm64", ["macOS brings OpenCL with the system", "PoCL's wheel does not"]),
        ("FreeBSD", "amd64", ["PoCL runs on the processor", "NVIDIA"]),
    ],
)
def test_advice_is_for_the_system(system: str, machine: str, words: list[str]) -> None:
    told = " ".join(advice(system, machine))
    for word in words:
        assert word in told
    assert ("'clvox[pocl]'" in told) == ((system, machine) == ("Linux", "x86_64"))
    assert ("'clvox[intel]'" in told) == (machine in ("x86_64", "AMD64"))


# --- devices ------------------------------------------------------------------------------------


@pytest.fixture
def only(session: Session, monkeypatch: pytest.MonkeyPatch) -> Device:
    """The device under test alone, in a session that has built nothing yet."""
    monkeypatch.setattr(doctor, "devices", lambda: [session.device])
    monkeypatch.setattr(sessions, "_sessions", {})
    return session.device


def failures() -> dict[str, str]:
    """What fails of the device, by what is tried."""
    findings = doctor.examine()
    tests = [finding for finding in findings if finding.topic == "test"]
    assert len(tests) == len(TESTS)
    failed = {one.text.partition(": ")[0]: one.text for one in tests if one.failed}
    # A broken driver of the system's own is none of the device's doing.
    assert exit_status([one for one in findings if one.topic != "driver"]) == bool(failed)
    return failed


def test_a_sound_device_passes(only: Device) -> None:
    assert failures() == {}
    (finding,) = (finding for finding in doctor.examine() if finding.topic == "device")
    assert finding.subject == str(only)
    assert not finding.failed
    for words in (only.version, f"{only.memory:,}", f"{only.largest_allocation:,}"):
        assert words in finding.text


ATOMICS, INTEGERS, ROUNDING, _, TIES = TESTS


@pytest.mark.parametrize(
    ("before", "after", "failing"),
    [
        ("atomic_inc(words)", "if (id % 999) atomic_inc(words)", {ATOMICS}),
        ("atomic_max(words + 4, hash)", "words[4] = hash", {ATOMICS}),
        ("= popcount(x)", "= popcount((uint)x)", {INTEGERS}),
        ("= x * y", "= (uint)x * y", {INTEGERS}),
        ("(ulong)((long)x >> by)", "x >> by", {INTEGERS}),
        ("rint(a[id])", "round(a[id])", {ROUNDING}),
        ("out[2 * id + 1] = product + c[id]", "out[2 * id + 1] = fma(a[id], b[id], c[id])",
         {ROUNDING}),
        ("return d.x > 0 || (d.x == 0 && d.y < 0);", "return d.x > 0 || (d.x == 0 && d.y > 0);",
         {TIES}),
        ("return along_v > 0;", "return along_v >= 0;", {TIES}),
    ],
)  # fmt: skip
def test_a_device_that_answers_wrongly_is_named(
    only: Device,
    monkeypatch: pytest.MonkeyPatch,
    before: str,
    after: str,
    failing: set[str],
) -> None:
    """As if its compiler had changed a line of a kernel."""
    seen = []

    def misread(file: str) -> str:
        text = source.read_source(file)
        seen.append(before in text)
        return text.replace(before, after)

    monkeypatch.setattr(sessions, "read_source", misread)
    failed = failures()
    assert any(seen)
    assert set(failed) == failing
    findings = [one for one in doctor.examine() if one.topic == "test" and one.failed]
    assert {one.subject for one in findings} == {str(only)}
    assert all(str(one).startswith(f"test: {only}: FAILED: ") for one in findings)


@pytest.mark.parametrize("error", [KernelBuildError("it does not build"), DRIVER_ERRORS[0]("lost")])
def test_a_device_that_fails_is_named_and_the_others_are_tried(
    monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    def fail(_: Session, __: int) -> None:
        raise error

    monkeypatch.setattr(selftest, "contend", fail)
    assert failures() == {ATOMICS: f"{ATOMICS}: {error}"}


@pytest.mark.usefixtures("only")
def test_a_device_that_cannot_be_opened_fails_all_tests(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refuse(_: Device) -> Session:
        raise DeviceError("it is big-endian")

    monkeypatch.setattr(doctor, "open_session", refuse)
    assert set(failures()) == set(TESTS)


def test_exit_status() -> None:
    device = Finding("device", "a", failed=False, text="")
    good = Finding("test", "a", failed=False, text="")
    bad = Finding("test", "b", failed=True, text="")
    assert exit_status([device, good]) == 0
    assert exit_status([device, good, bad]) == 1
    assert exit_status([good, bad]) == 3


def test_the_tetrahedron_is_the_twins() -> None:
    """Whatever the axis of the rays."""
    vertices, faces = doctor.TETRAHEDRON
    for axis in doctor._AXES:
        right = fill_parity(np.array(vertices) * 128, faces, 7, doctor.GRID.shape, axis)
        assert right.sum() == doctor.TETRAHEDRON_COUNT
        assert doctor.digest_of(right) == doctor.TETRAHEDRON_DIGEST


# --- the command --------------------------------------------------------------------------------


def test_the_command_tells_what_examine_finds(
    only: Device, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    findings = [finding for finding in doctor.examine() if finding.topic != "driver"]
    monkeypatch.setattr(doctor, "examining", lambda: iter(findings))
    assert main(["doctor"]) == 0
    said = capsys.readouterr().out
    assert f"{only}: {ATOMICS}: right" in said
    assert main(["doctor", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["findings"] == [vars(one) for one in findings]
    findings.append(Finding("test", str(only), failed=True, text="wrong"))
    assert main(["doctor"]) == 1
    assert f"{only}: FAILED: wrong" in capsys.readouterr().out


@LINUX
def test_the_command_without_a_driver(tmp_path: Path) -> None:
    code = "import sys; from clvox.cli import main; sys.exit(main(['doctor']))"
    status, lines = run(WITHOUT_POCL + code, tmp_path)
    assert status == 3
    assert any("no OpenCL device was found" in line for line in lines)
