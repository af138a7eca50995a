"""What PoCL needs to be told: about its threads, and about young processors.

PoCL keeps a thread for each core, asleep between kernels.  Linux wakes those that one thread calls
on the core where that one runs, and spreads them only some milliseconds later: of a job of many
short kernels one core does all the work.  So each thread is bound to its core, as PoCL offers.

PoCL 3.0, the version on PyPI, holds LLVM 14 and asks it for the name of the processor.  For AMD's
Zen 5 and later LLVM 14 answers "generic", a name that its own front end then refuses: no kernel
builds ("unknown target CPU 'generic'", pocl/pocl#1049), and no option or variable of PoCL changes
the name.  So we put a processor's name that LLVM 14 knows, and whose instructions this machine
has, where PoCL keeps it: one pointer in its record of the device.  The record's layout belongs to
that one build of PoCL, so nothing is touched unless the version is exactly that one and the
pointer's target reads "generic".
"""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pyopencl as cl

from clvox.device._environment import variable

NAME = "Portable Computing Language"

_BUILD = "PoCL 3.0-rc2  Linux, Release, RELOC, LLVM 14.0.6"
_NAME_OFFSET = 640
_UNKNOWN = b"generic"

# Each processor with the instructions that code for it may use, the best first.
_PROCESSORS = {
    b"skylake-avx512": {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl", "bmi2", "adx"},
    b"haswell": {"avx2", "bmi1", "bmi2", "f16c", "fma", "movbe"},
    b"nehalem": {"sse4_2", "popcnt"},
    b"x86-64": set[str](),
}
# PoCL keeps the pointer as long as the process lives, so the strings do too.
_names = {name: ctypes.create_string_buffer(name) for name in _PROCESSORS}

_BINDS = "POCL_AFFINITY"
_COUNTS = "POCL_MAX_PTHREAD_COUNT"


def start_threads(find: Callable[[], list[cl.Platform]]) -> tuple[cl.Platform, ...]:
    """Return the platforms that *find* finds; have PoCL bind each of its threads to a core.

    Not if the process may not use every core, or cores have other numbers than the first, since
    PoCL binds its threads to those; nor if the user has decided about it, or wants few threads,
    which would share the first cores with those of other processes.  Elsewhere than on Linux PoCL
    binds no threads.
    """
    if sys.platform != "linux" or _BINDS in os.environ or _COUNTS in os.environ:
        return tuple(find())
    if os.sched_getaffinity(0) != set(range(os.cpu_count() or 0)):
        return tuple(find())
    with variable(_BINDS, "1"):
        found = tuple(find())
        for platform in found:
            if platform.name == NAME:
                # It starts them when it is asked for devices, if no loader has asked yet.
                with suppress(cl.Error):
                    platform.get_devices()
    return found


def name_processor(device: cl.Device) -> None:
    """Give PoCL's record of *device* a processor's name that its compiler knows."""
    if sys.platform != "linux" or _BUILD not in device.platform.version:
        return
    pointer = ctypes.c_void_p.from_address(device.int_ptr + _NAME_OFFSET)
    if not pointer.value or ctypes.string_at(pointer.value, 8).rstrip(b"\0") != _UNKNOWN:
        return
    has = _instructions()
    name = next(name for name, needs in _PROCESSORS.items() if needs <= has)
    pointer.value = ctypes.addressof(_names[name])


def _instructions() -> set[str]:
    """What this machine's processor says it can do."""
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("flags"):
            return set(line.partition(":")[2].split())
    return set()
