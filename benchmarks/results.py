"""Results kept as data, and the table made of them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from statistics import median

from clvox.bench import Record, Result, read_records, write_records
from clvox.bench.machine import slug

FOLDER = Path(__file__).parent / "results"


def save(records: list[Record], folder: Path = FOLDER) -> Path:
    """Write *records* into the file of their machine, over older ones of the same cases."""
    path = folder / f"{slug(records[0].machine['cpu'])}.jsonl"
    new = {record.result.case for record in records}
    kept = [record for record in read_records(path) if record.result.case not in new]
    folder.mkdir(exist_ok=True)
    write_records(path, kept + records)
    return path


def tables(folder: Path = FOLDER) -> str:
    """Return the results of every machine in *folder*, as Markdown."""
    parts = [
        "\n".join(_table(read_records(path))) + "\n" for path in sorted(folder.glob("*.jsonl"))
    ]
    return "\n".join(parts)


def _table(records: list[Record]) -> Iterator[str]:
    machine = records[-1].machine
    versions = ", ".join(f"{name} {number}" for name, number in machine["versions"].items())
    days = sorted({record.date for record in records})
    yield f"{machine['cpu']}, {machine['cores']} cores; {machine['device']}; {machine['os']};"
    yield f"Python {machine['python']}; {versions}; {' and '.join(dict.fromkeys(days))}."
    yield ""
    yield "| case | contestant | median s (least to most) | runs | ratio | CPU s | MB | notes |"
    yield "| --- | --- | --- | --- | --- | --- | --- | --- |"
    for case in dict.fromkeys(record.result.case for record in records):
        yield from rows([record.result for record in records if record.result.case == case])


def rows(results: Iterable[Result]) -> Iterator[str]:
    """Rows of the table for the results of one case; the ratio is to the first of them."""
    results = list(results)
    for result in results:
        low, high = min(result.seconds), max(result.seconds)
        memory = "" if result.peak_nbytes is None else f"{result.peak_nbytes / 1e6:.0f}"
        notes = ", ".join(f"{name} {value:.4g}" for name, value in result.notes.items())
        cells = [
            result.case if result is results[0] else "",
            result.contestant,
            f"{result.median:.4f} ({low:.4f} to {high:.4f})",
            str(len(result.seconds)),
            f"{result.median / results[0].median:.2f}",
            f"{median(result.cpu_seconds):.4f}" if result.cpu_seconds else "",
            memory,
            notes,
        ]
        yield f"| {' | '.join(cells)} |"
