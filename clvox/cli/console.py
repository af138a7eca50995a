"""What is printed: results on the standard output; bars, warnings and errors on the other."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeAlias

Progress: TypeAlias = Callable[[int, int], object]

LABEL = 13
"""Characters of the column of labels."""


class Console:
    """Speaks to a person, or gathers one JSON object for a program.

    Attributes
    ----------
    record : dict
        What is printed at the end, if JSON was asked for.
    seconds : dict
        Of each stage that is over; part of the record if there are any.
    """

    def __init__(self, *, as_json: bool, quiet: bool) -> None:
        self.as_json = as_json
        self.quiet = quiet
        self.record: dict[str, Any] = {}
        self.seconds: dict[str, float] = {}

    def say(self, label: str, text: str) -> None:
        """Print a line of the result, for a person only."""
        if not self.as_json:
            print(f"{label:{LABEL}}{text}", flush=True)

    def complain(self, text: str) -> None:
        """Print a warning or an error."""
        print(f"clvox: {text}", file=sys.stderr, flush=True)

    def warn(self, warnings: tuple[str, ...]) -> None:
        """Print warnings, and record them."""
        self.record["warnings"] = list(warnings)
        for warning in warnings:
            self.complain(f"warning: {warning}")

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time a stage of the work."""
        start = time.perf_counter()
        yield
        self.seconds[name] = time.perf_counter() - start

    @contextmanager
    def bar(self, name: str) -> Iterator[Progress | None]:
        """Draw a bar on a terminal while the work lasts; otherwise there is nobody to tell."""
        if self.quiet or not sys.stderr.isatty():
            yield None
            return
        from tqdm import tqdm

        with tqdm(desc=name, unit_scale=True, leave=False) as drawn:

            def tell(done: int, total: int) -> None:
                drawn.total = total
                drawn.update(done - drawn.n)

            yield tell

    def close(self) -> None:
        """Say how long the stages took; print the record, if that was asked for."""
        if self.seconds:
            self.record["seconds"] = self.seconds
            stages = ", ".join(f"{name} {spent:.2f}" for name, spent in self.seconds.items())
            self.say("seconds", f"{stages}; {sum(self.seconds.values()):.2f} in all")
        if self.as_json:
            print(json.dumps(self.record, indent=2, allow_nan=False))
        sys.stdout.flush()
