"""Results kept as data: one JSON object a line."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from clvox.bench.harness import Result

_TIMES = "seconds", "cpu_seconds"


@dataclass(frozen=True)
class Record:
    """A result, and where and when it came about; complete in itself.

    Attributes
    ----------
    date : str
        ISO 8601, of the day.
    machine : dict
        See `machine`.
    result : Result
    """

    date: str
    machine: dict[str, Any]
    result: Result


def write_records(path: Path, records: Iterable[Record]) -> None:
    """Write *records* to *path*, a line each."""
    lines = [json.dumps(_flat(record)) + "\n" for record in records]
    path.write_text("".join(lines), encoding="utf-8")


def read_records(path: Path) -> list[Record]:
    """Return the records in *path*; none if there is no such file."""
    if not path.exists():
        return []
    return [_record(json.loads(line)) for line in path.read_text(encoding="utf-8").splitlines()]


def _flat(record: Record) -> dict[str, Any]:
    result = asdict(record.result)
    for name in _TIMES:
        result[name] = [round(seconds, 6) for seconds in result[name]]
    result["notes"] = {name: round(value, 6) for name, value in record.result.notes.items()}
    return {"date": record.date, **result, "machine": record.machine}


def _record(line: dict[str, Any]) -> Record:
    date, machine = line.pop("date"), line.pop("machine")
    times = {name: tuple(line[name]) for name in _TIMES}
    return Record(date, machine, Result(**{**line, **times}))
