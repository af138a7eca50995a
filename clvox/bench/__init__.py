"""The one harness for every benchmark of clvox.

`compare` times contestants in one process, in turns; `machine` says on what; `meshes` has closed
meshes of any size; `streaming` holds passes over memory against a plain copy.
"""

from clvox.bench.harness import Contestant, Result, compare
from clvox.bench.machine import machine
from clvox.bench.memory import PeakMemory
from clvox.bench.record import Record, read_records, write_records

__all__ = [
    "Contestant",
    "PeakMemory",
    "Record",
    "Result",
    "compare",
    "machine",
    "read_records",
    "write_records",
]
