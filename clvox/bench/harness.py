"""Times contestants fairly: in one process, in turns, many times."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from statistics import median
from typing import Any

from clvox.bench.memory import PeakMemory

PATIENCE = 10.0
"""Seconds; a contestant whose warm-up takes longer is not run again, and the warm-up counts."""


@dataclass(frozen=True)
class Contestant:
    """One way to do a job.

    Attributes
    ----------
    name : str
    run : callable
        The timed part.  It ends with the device idle: whatever it queues, it waits for.
    describe : callable
        From what `run` returned to numbers worth keeping, such as the seconds of each stage; of
        each the median over all runs is kept.  Not timed.
    """

    name: str
    run: Callable[[], Any]
    describe: Callable[[Any], Mapping[str, float]] = field(default=lambda _: {})


@dataclass(frozen=True)
class Result:
    """What one contestant needed.

    Attributes
    ----------
    case, contestant : str
    seconds : tuple of float
        Of each run, in their order; the warm-up is left out.
    cpu_seconds : tuple of float
        Likewise, the processor's seconds of all threads together: much the steadier figure where
        others use the machine, and without meaning on a GPU.
    peak_nbytes : int or None
        Most by which a run, warm-up included, let the process grow; None if that is not known.
    notes : dict
        Numbers from `Contestant.describe`.
    """

    case: str
    contestant: str
    seconds: tuple[float, ...]
    cpu_seconds: tuple[float, ...] = ()
    peak_nbytes: int | None = None
    notes: dict[str, float] = field(default_factory=dict)

    @property
    def median(self) -> float:
        """Median of the seconds."""
        return median(self.seconds)


def compare(
    case: str,
    contestants: Sequence[Contestant],
    *,
    repeats: int = 5,
    patience: float = PATIENCE,
) -> list[Result]:
    """Return what each contestant needed for one job.

    Each is run once to warm up, which builds programs and fills caches, and then *repeats* times:
    in rounds, so that a machine that is busy for a while is busy for all of them, and beginning
    with another one each round, so that none always runs behind the same one.

    Parameters
    ----------
    case : str
        Name of the job.
    contestants : sequence of Contestant
        The first is the one that others are compared with: see `ratios`.
    repeats : int
        At least 1.
    patience : float
        Seconds.  A contestant whose warm-up takes longer is not run again: one run is known.

    Returns
    -------
    list of Result
        In the order of *contestants*.
    """
    runs = [_Runs(contestant) for contestant in contestants]
    for each in runs:
        each.once()
    quick = [each for each in runs if each.seconds[0] <= patience]
    for each in quick:
        each.seconds.clear()
        each.cpu_seconds.clear()
        each.notes.clear()
    for turn in range(repeats):
        first = turn % max(1, len(quick))
        for each in quick[first:] + quick[:first]:
            each.once()
    return [each.result(case) for each in runs]


def ratios(results: Sequence[Result]) -> list[float]:
    """Return each median over that of the first: above 1 is slower than the first."""
    return [result.median / results[0].median for result in results]


@dataclass
class _Runs:
    """The runs of one contestant so far."""

    contestant: Contestant
    seconds: list[float] = field(default_factory=list)
    cpu_seconds: list[float] = field(default_factory=list)
    notes: list[Mapping[str, float]] = field(default_factory=list)
    peak: int | None = None

    def once(self) -> None:
        with PeakMemory() as memory:
            start, cpu_start = time.perf_counter(), time.process_time()
            outcome = self.contestant.run()
            self.seconds.append(time.perf_counter() - start)
            self.cpu_seconds.append(time.process_time() - cpu_start)
        self.notes.append(self.contestant.describe(outcome))
        if memory.nbytes is not None:
            self.peak = max(self.peak or 0, memory.nbytes)

    def result(self, case: str) -> Result:
        names = dict.fromkeys(name for notes in self.notes for name in notes)
        notes = {name: median(each[name] for each in self.notes if name in each) for name in names}
        seconds, cpu_seconds = tuple(self.seconds), tuple(self.cpu_seconds)
        return Result(case, self.contestant.name, seconds, cpu_seconds, self.peak, notes)
