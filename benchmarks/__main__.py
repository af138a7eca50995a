"""Run the benchmarks, or print the table of those that were kept."""

from __future__ import annotations

import argparse
import datetime as dt
import itertools
import sys
from collections.abc import Sequence

from benchmarks import __doc__ as usage
from benchmarks import peers, results
from benchmarks.cases import CASES, Plan
from clvox.bench import Record, machine
from clvox.bench.machine import LIBRARIES
from clvox.device import open_session


def main(arguments: Sequence[str] | None = None) -> int:
    """Do what the command line asks for; return the exit status."""
    parser = argparse.ArgumentParser(
        "python -m benchmarks",
        description=usage,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--case", choices=list(CASES), action="append", help="only this one")
    parser.add_argument("--quick", action="store_true", help="each case once, at its smallest")
    parser.add_argument("--repeats", type=int, default=5, help="timed runs of each (5)")
    parser.add_argument("--device", help="as for clvox.voxelize")
    parser.add_argument("--save", action="store_true", help="keep the results as data")
    parser.add_argument("--table", action="store_true", help="print the results that were kept")
    options = parser.parse_args(arguments)
    if options.repeats < 1:
        parser.error(f"--repeats must be at least 1, got {options.repeats}")
    if options.table:
        print(results.tables(), end="")
        return 0

    session = open_session(options.device)
    plan = Plan(session, 1 if options.quick else options.repeats, options.quick)
    here = machine(session, (*LIBRARIES, "open3d", "vtk"))
    today = dt.datetime.now(tz=dt.UTC).date().isoformat()
    print(f"{here['cpu']}, {here['cores']} cores; {here['device']}")
    records = []
    for name in options.case or CASES:
        print(f"\n{name}: {' '.join((CASES[name].__doc__ or '').split())}", flush=True)
        for _, group in itertools.groupby(CASES[name](plan), lambda result: result.case):
            found = list(group)
            records += [Record(today, here, result) for result in found]
            print(*results.rows(found), sep="\n", flush=True)
    for name, reason in peers.MISSING.items():
        print(f"{name} did not take part: {reason}")
    if options.save:
        print(f"kept in {results.save(records)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
