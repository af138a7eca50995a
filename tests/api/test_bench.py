"""The harness is fair and keeps what it measures; every benchmark still runs.

No test asserts a time.
"""

from __future__ import annotations

import os
import platform
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from benchmarks import peers, results
from benchmarks.__main__ import main
from benchmarks.cases import CASES, Plan
from clvox.bench import Contestant, PeakMemory, Record, Result, compare, machine, meshes
from clvox.bench import harness as harnesses
from clvox.bench import memory as memories
from clvox.bench.machine import slug
from clvox.bench.record import read_records, write_records
from clvox.bench.streaming import copy
from clvox.device import Session
from clvox.mesh import check

SOMEWHERE = {
    "cpu": "A (R) Processor",
    "cores": 2,
    "os": "an OS",
    "python": "3.11.0",
    "device": "a device",
    "driver": "1.2",
    "versions": {"clvox": "1.0"},
}


# --- the harness --------------------------------------------------------------------------------


def contestants(order: list[str], names: str = "abc") -> list[Contestant]:
    """Each of them writes its name when it runs."""
    return [Contestant(name, lambda name=name: order.append(name)) for name in names]  # type: ignore[misc]


def test_contestants_take_turns_and_each_begins() -> None:
    """One round to warm up, and then each round begins with the next one."""
    order: list[str] = []
    compare("a case", contestants(order), repeats=3)
    assert "".join(order) == "abc" + "abc" + "bca" + "cab"


def test_results_come_in_order_and_without_the_warm_up() -> None:
    """As many seconds as repeats, for each."""
    found = compare("a case", contestants([]), repeats=4)
    assert [(each.case, each.contestant) for each in found] == [("a case", name) for name in "abc"]
    assert [len(each.seconds) for each in found] == [4, 4, 4]
    assert [len(each.cpu_seconds) for each in found] == [4, 4, 4]
    assert all(seconds >= 0 for each in found for seconds in each.seconds)


def test_who_takes_too_long_runs_once_only() -> None:
    """And is told all the same: its warm-up counts."""
    order: list[str] = []
    found = compare("a case", contestants(order), repeats=3, patience=-1)
    assert "".join(order) == "abc"
    assert [len(each.seconds) for each in found] == [1, 1, 1]


def test_notes_are_medians_over_the_runs() -> None:
    """Of what each run tells; the warm-up tells nothing that is kept."""
    told = iter([1000.0, 3.0, 1.0, 2.0])
    contestant = Contestant("one", lambda: next(told), lambda value: {"told": value})
    (found,) = compare("a case", [contestant], repeats=3)
    assert found.notes == {"told": 2.0}


def test_ratios_are_to_the_first() -> None:
    """Of medians."""
    found = [Result("a", "b", (1.0, 2.0, 9.0)), Result("a", "c", (6.0, 6.0))]
    assert harnesses.ratios(found) == [1.0, 3.0]


def test_peak_memory_sees_what_is_gone_again() -> None:
    """64 MB that are dropped before the end of the block."""
    with PeakMemory() as memory:
        np.ones(1 << 23)
    if memory.nbytes is None:
        pytest.skip("this system does not tell a process its peak")
    assert memory.nbytes > 60e6
    with PeakMemory() as memory:
        pass
    assert memory.nbytes is not None
    assert memory.nbytes < 10e6


def test_peak_memory_is_unknown_on_other_systems(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """It says so, and the benchmark goes on."""
    monkeypatch.setattr(memories, "_CLEAR", tmp_path / "no" / "such" / "file")
    with PeakMemory() as memory:
        pass
    assert memory.nbytes is None


# --- records ------------------------------------------------------------------------------------


def record(case: str, seconds: float, contestant: str = "clvox") -> Record:
    """A result of some machine."""
    return Record(
        "2026-01-02",
        SOMEWHERE,
        Result(case, contestant, (seconds,), (2 * seconds,), 10**6, {"n": 1.0}),
    )


def test_records_come_back(tmp_path: Path) -> None:
    """Line by line, each complete."""
    path = tmp_path / "some.jsonl"
    records = [record("one", 0.5), record("two", 1.25)]
    write_records(path, records)
    assert len(path.read_text().splitlines()) == 2
    assert read_records(path) == records
    assert read_records(tmp_path / "none.jsonl") == []


def test_saving_replaces_the_same_cases_only(tmp_path: Path) -> None:
    """In the file that bears the processor's name."""
    results.save([record("one", 1.0), record("two", 2.0)], tmp_path)
    path = results.save([record("two", 3.0)], tmp_path)
    assert path.name == "a-r-processor.jsonl"
    assert [(each.result.case, each.result.median) for each in read_records(path)] == [
        ("one", 1.0),
        ("two", 3.0),
    ]


def test_table_tells_each_result_beside_the_first_of_its_case(tmp_path: Path) -> None:
    """And where it was measured."""
    results.save([record("one", 0.5), record("one", 1.0, "a peer")], tmp_path)
    table = results.tables(tmp_path)
    assert "A (R) Processor, 2 cores; a device" in table
    assert "| one | clvox | 0.5000 (0.5000 to 0.5000) | 1 | 1.00 | 1.0000 | 1 | n 1 |" in table
    assert "|  | a peer | 1.0000 (1.0000 to 1.0000) | 1 | 2.00 | 2.0000 | 1 | n 1 |" in table


def test_kept_results_can_be_read(capsys: pytest.CaptureFixture[str]) -> None:
    """Those in the repository make a table, with clvox first in each case that has peers."""
    assert main(["--table"]) == 0
    printed = capsys.readouterr().out
    kept = [each for path in results.FOLDER.glob("*.jsonl") for each in read_records(path)]
    assert all(each.result.case in printed for each in kept)


def test_machine_says_what_is_needed(session: Session) -> None:
    """The processor, the device and the versions; a library that is not there is left out."""
    here = machine(session, ["numpy", "no-such-library"])
    assert set(here) == set(SOMEWHERE)
    assert here["device"] == str(session.device)
    assert here["versions"]["numpy"] == np.__version__
    assert "no-such-library" not in here["versions"]
    assert 1 <= here["cores"] <= (os.cpu_count() or 1)
    assert here["os"].startswith(platform.system())
    assert platform.release() not in here["os"]


def test_slug_is_a_file_name() -> None:
    """Of any processor's name."""
    assert slug("Intel(R) Xeon(R) @ 2.4GHz") == "intel-r-xeon-r-2-4ghz"


# --- meshes and passes --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "triangles"),
    [
        (meshes.trefoil, 22_320),
        (lambda: meshes.trefoil(24, 5), 240),
        (lambda: meshes.sphere(2), 320),
        (lambda: meshes.bumpy_sphere(3), 1_280),
    ],
)
def test_meshes_are_closed_and_the_right_way_out(
    make: Callable[[], object], triangles: int
) -> None:
    """No warning: not open, not inside out, nothing dropped."""
    surface = check(make())  # type: ignore[arg-type]
    assert len(surface.faces) == triangles
    assert (surface.closed, surface.oriented, surface.warnings) == (True, True, ())


def test_bumpy_sphere_is_bumpy() -> None:
    """By about a tenth either way."""
    radii = np.linalg.norm(meshes.bumpy_sphere(4).vertices, axis=1)
    assert 0.9 <= radii.min() < 0.95
    assert 1.05 < radii.max() <= 1.1


@pytest.mark.parametrize("words", [4, 252, 256, 260, 4096])
def test_copy_copies(session: Session, words: int) -> None:
    """Every word, and nothing beyond."""
    source = np.arange(words, dtype=np.uint32)
    target = session.zeros(words + 4, np.uint32)
    kernel = session.kernel("buffers/copy.cl", "copy")
    session.run(kernel, words // 4, np.uint64(words // 4), session.upload(source), target)
    np.testing.assert_array_equal(target.get(), np.append(source, [0, 0, 0, 0]))


def test_copy_counts_what_it_reads_and_writes(session: Session) -> None:
    """Four bytes a word, twice."""
    run, nbytes = copy(session, 1024)
    run()
    assert nbytes == 2 * 4 * 1024


# --- the benchmarks -----------------------------------------------------------------------------


@pytest.mark.parametrize("name", CASES)
def test_every_benchmark_runs(session: Session, name: str) -> None:
    """At its smallest size; and voxels that are compared are the same, up to rounding."""
    found = list(CASES[name](Plan(session, repeats=1, quick=True)))
    assert found
    for result in found:
        assert len(result.seconds) == 1
        assert result.notes.get("voxels that differ", 0) <= 8, result.contestant


def test_command_line_prints_rows_and_says_who_is_missing(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A peer that is not installed is no error."""
    monkeypatch.setattr(peers, "MISSING", {"A peer": "it is not installed"})
    assert main(["--quick", "--case", "scan"]) == 0
    printed = capsys.readouterr().out
    assert "| scan 1,000 | clvox | " in printed
    assert "A peer did not take part: it is not installed" in printed


def test_fewer_than_one_repeat_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    """With the number that was given."""
    with pytest.raises(SystemExit):
        main(["--repeats", "0"])
    assert "--repeats must be at least 1, got 0" in capsys.readouterr().err
