"""Run the tests on one OpenCL implementation, or on all three, each in a process of its own.

    python tests/opencl.py                                # all three, as `make test` does
    python tests/opencl.py oclgrind                       # one of them, on its share of the tests
    python tests/opencl.py intel -- tests/api -k volume   # one of them, with pytest's arguments
    python tests/opencl.py --closing                      # the closing lines of the last runs

The implementations come from Python packages, and nothing is installed on the system: `make test`
has put PoCL and Intel's runtime into the virtual environment, and Oclgrind into a folder beside
it.  Oclgrind stays out of the environment because it calls itself a GPU, so that programs would
choose it by default.  The loader in PyOpenCL's wheels reads ``OCL_ICD_VENDORS`` instead of the
system's list; it also finds PoCL, always, so ``CLVOX_DEVICE`` names the platform to use.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
CACHE = ROOT / ".cache" / "opencl"
OCLGRIND_LOG = CACHE / "oclgrind.log"


def _no_driver() -> None:
    """PoCL needs no entry: PyOpenCL's loader finds it beside itself."""


def _intel_driver() -> Path:
    return Path(sys.prefix) / "lib" / "libintelocl.so"


def _oclgrind_driver() -> Path:
    folder = CACHE / "oclgrind" / "pyopencl" / ".libs"
    return next(folder.glob("liboclgrind-rt-icd*.so"), folder / "liboclgrind-rt-icd.so")


@dataclass(frozen=True)
class Implementation:
    """One OpenCL implementation, and its share of the tests."""

    platform: str
    tests: tuple[str, ...]
    driver: Callable[[], Path | None]
    profile: str


# In the order in which they run: the whole suite last, so that its closing line comes last too.
IMPLEMENTATIONS = {
    "oclgrind": Implementation("Oclgrind", ("tests/kernels",), _oclgrind_driver, "oclgrind"),
    # PoCL is beside it there, and pictures of the two are compared.
    "intel": Implementation(
        "Intel(R) OpenCL",
        ("tests/kernels", "tests/api/test_render.py::test_devices_differ_by_rounding"),
        _intel_driver,
        "second",
    ),
    "pocl": Implementation("Portable Computing Language", ("tests",), _no_driver, "default"),
}


def environment(name: str) -> dict[str, str]:
    """Return the environment in which OpenCL programs use the implementation *name*.

    Writes the folder of ``.icd`` files that the environment names.
    """
    chosen = IMPLEMENTATIONS[name]
    vendors = CACHE / f"{name}-icd"
    vendors.mkdir(parents=True, exist_ok=True)
    found = dict(os.environ)
    found["OCL_ICD_VENDORS"] = str(vendors)
    found["CLVOX_DEVICE"] = chosen.platform
    found["POCL_CACHE_DIR"] = str(CACHE / "pocl-programs")
    found.setdefault("HYPOTHESIS_PROFILE", chosen.profile)
    driver = chosen.driver()
    if driver is not None:
        if not driver.exists():
            sys.exit(f"{name}: there is no {driver}; run `make test`, which installs it")
        (vendors / f"{name}.icd").write_text(f"{driver}\n")
        # The driver loads libraries that lie beside it by name only.
        paths = [str(driver.parent), found.get("LD_LIBRARY_PATH", "")]
        found["LD_LIBRARY_PATH"] = os.pathsep.join(filter(None, paths))
    if name == "oclgrind":
        found["OCLGRIND_LOG"] = str(OCLGRIND_LOG)
        found["OCLGRIND_DATA_RACES"] = "1"
        found["OCLGRIND_UNINITIALIZED"] = "1"
        # Optimised code holds instructions that its watch on uninitialised values does not know,
        # and lacks accesses that were written.
        found["PYOPENCL_BUILD_OPTIONS"] = "-cl-opt-disable"
    return found


def _oclgrind_logs() -> list[Path]:
    """What Oclgrind wrote: one log for each process that ran tests."""
    return sorted(CACHE.glob(OCLGRIND_LOG.name + "*"))


def closing_file(name: str) -> Path:
    """Where the closing line of the last run on *name* is kept."""
    return CACHE / f"{name}.closing"


def run(name: str, arguments: list[str]) -> bool:
    """Run pytest on the implementation *name*; return whether all is well."""
    # Kernels of tests are small: a process for each core keeps the machine busy.  Tests of a file
    # share programs, so they share a process.
    whole = ["--numprocesses", "auto", "--dist", "loadfile", *IMPLEMENTATIONS[name].tests]
    command = [sys.executable, "-m", "pytest", "-q", *(arguments or whole)]
    variables = environment(name)
    closing_file(name).unlink(missing_ok=True)
    for log in _oclgrind_logs():
        log.unlink()
    print(f"\n{name}: {' '.join(command[1:])}", flush=True)
    closing = "pytest did not come to its end"
    with subprocess.Popen(
        command,
        cwd=ROOT,
        env=variables,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        for line in process.stdout:
            print(line, end="", flush=True)
            if re.search(r"\d+ (passed|failed|skipped|errors?|deselected)\b.* in [\d.]+s", line):
                closing = line.strip()
    closing_file(name).write_text(closing + "\n")
    reports = "".join(log.read_text() for log in _oclgrind_logs())
    if reports:
        print(f"Oclgrind reports, in {OCLGRIND_LOG.relative_to(ROOT)}*:\n{reports[:4000]}")
    return process.returncode == 0 and not reports


def print_closing_lines(names: list[str]) -> None:
    """Print pytest's closing line of the last run on each implementation, below its name."""
    for name in names:
        line = closing_file(name).read_text() if closing_file(name).exists() else "not run\n"
        print(f"{name} ({IMPLEMENTATIONS[name].platform}):\n{line}", end="")


def main() -> int:
    """Run what the command line asks for; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("implementation", nargs="?", choices=list(IMPLEMENTATIONS))
    parser.add_argument("--closing", action="store_true", help="print the last closing lines only")
    parser.add_argument("arguments", nargs="*", help="for pytest, after --")
    options = parser.parse_args()
    names = [options.implementation] if options.implementation else list(IMPLEMENTATIONS)
    well = True
    if not options.closing:
        # All of them run, whatever the first ones find: a failure on one device only says much.
        outcomes = [run(name, options.arguments) for name in names]
        well = all(outcomes)
        print()
    print_closing_lines(names)
    return 0 if well else 1


if __name__ == "__main__":
    sys.exit(main())
