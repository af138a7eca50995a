"""The tests run on the OpenCL implementation asked for, and Oclgrind sees what it is there for."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pyopencl as cl
import pytest

from tests.opencl import IMPLEMENTATIONS

if TYPE_CHECKING:
    from clvox.device import Session

# One kernel in a process of its own: 16 work-items in groups of 8, over 16 ints that nobody wrote.
LAUNCH = """
import sys
import numpy as np
import pyopencl as cl

(device,) = [d for p in cl.get_platforms() if p.name == "Oclgrind" for d in p.get_devices()]
context = cl.Context([device])
queue = cl.CommandQueue(context)
kernel = cl.Program(context, sys.argv[1]).build(["-cl-std=CL1.2", "-Werror"]).planted
kernel(queue, (16,), (8,), cl.Buffer(context, cl.mem_flags.READ_WRITE, 64))
queue.finish()
"""

FAULTS = {
    "write out of bounds": ("out[get_global_id(0) + 1] = 7;", "Invalid write of size 4"),
    "read out of bounds": (
        "out[get_global_id(0)] = out[get_global_id(0) + 16];",
        "Invalid read of size 4",
    ),
    "race": ("out[0] = get_global_id(0);", "Write-write data race"),
    "race in local memory": (
        """__local int s[8];
        const int i = get_local_id(0);
        s[i] = i;
        barrier(CLK_LOCAL_MEM_FENCE);
        s[i] = s[(i + 1) % 8] + 1;
        out[get_global_id(0)] = s[i];""",
        "Read-write data race at local memory",
    ),
    "barrier that some skip": (
        "if (get_local_id(0) > 0) barrier(CLK_LOCAL_MEM_FENCE); out[get_global_id(0)] = 1;",
        "Work-group divergence detected (barrier)",
    ),
    "uninitialised buffer": (
        "if (out[get_global_id(0)] > 3) out[get_global_id(0)] = 1;",
        "Controlflow depends on uninitialized value",
    ),
    "uninitialised variable": (
        "int a[2]; a[0] = 1; out[get_global_id(0)] = a[get_global_id(0) % 2];",
        "Uninitialized value written to global memory",
    ),
}


def test_device_belongs_to_the_implementation_asked_for(session: Session) -> None:
    """Otherwise three runs of the tests might all be on one device."""
    asked = os.environ.get("CLVOX_DEVICE")
    if asked not in [chosen.platform for chosen in IMPLEMENTATIONS.values()]:
        pytest.skip("CLVOX_DEVICE names none of the three platforms of tests/opencl.py")
    assert session.device.platform == asked


def test_arrays_end_where_their_memory_ends(session: Session) -> None:
    """Or else Oclgrind sees no access beyond their end."""
    if "OCLGRIND_LOG" not in os.environ:
        pytest.skip("the device under test is not Oclgrind")
    for words in (1, 5, 33, 1025):
        memory = session.zeros(words, np.uint32).base_data
        assert isinstance(memory, cl.Buffer)
        assert memory.size == 4 * words


def oclgrind_reports(body: str, folder: Path) -> str:
    """What Oclgrind says of a kernel with this body."""
    if "OCLGRIND_LOG" not in os.environ:
        pytest.skip("the device under test is not Oclgrind")
    log = folder / "log"
    source = f"__kernel void planted(__global int *out) {{ {body} }}"
    subprocess.run(
        [sys.executable, "-c", LAUNCH, source],
        env={**os.environ, "OCLGRIND_LOG": str(log)},
        check=True,
    )
    return log.read_text()


@pytest.mark.parametrize("fault", FAULTS)
def test_oclgrind_reports_a_planted(fault: str, tmp_path: Path) -> None:
    """A checker that is switched off would pass everything."""
    body, expected = FAULTS[fault]
    assert expected in oclgrind_reports(body, tmp_path)


def test_oclgrind_says_nothing_of_a_clean_kernel(tmp_path: Path) -> None:
    """So that any report may count as a failure."""
    assert oclgrind_reports("out[get_global_id(0)] = get_local_id(0);", tmp_path) == ""
