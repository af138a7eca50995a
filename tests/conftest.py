"""What all tests share: the device, the data, and how many examples hypothesis draws."""

from __future__ import annotations

import os
from collections.abc import Callable, Generator
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import hypothesis
import pytest

if TYPE_CHECKING:
    from clvox.device import Session

# Every run draws the same examples, so that a failure can be had again; no test may depend on
# the speed of a machine.
hypothesis.settings.register_profile(
    "default", derandomize=True, deadline=None, print_blob=True, max_examples=50
)
hypothesis.settings.register_profile(
    "ci", hypothesis.settings.get_profile("default"), max_examples=200
)
# A second compiled implementation, after one that draws all examples.
hypothesis.settings.register_profile(
    "second", hypothesis.settings.get_profile("default"), max_examples=20
)
# Oclgrind interprets: some thousand times slower, and looking at accesses rather than values.
hypothesis.settings.register_profile(
    "oclgrind",
    hypothesis.settings.get_profile("default"),
    max_examples=3,
    suppress_health_check=[hypothesis.HealthCheck.too_slow],
)
hypothesis.settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "default"))

if "OCLGRIND_LOG" in os.environ and "PYTEST_XDIST_WORKER" in os.environ:
    # Each of several processes has a log of its own: Oclgrind begins it anew.
    os.environ["OCLGRIND_LOG"] += "." + os.environ["PYTEST_XDIST_WORKER"]


@pytest.fixture(scope="session")
def session() -> Session:
    """The device under test: that of CLVOX_DEVICE, or else the default one."""
    from clvox.device import open_session

    opened = open_session()
    if "OCLGRIND_LOG" in os.environ:
        opened._pool = cast("Any", ExactAllocator(opened._queue))
    return opened


class ExactAllocator:
    """Stands in for a session's memory pool while Oclgrind watches.

    A pool gives out more memory than was asked for, and gives it out again, written: accesses
    beyond the end of an array and reads of what nobody wrote would go unseen.  Nor is memory freed:
    Oclgrind takes what is written to an address that was in use before for uninitialised.
    """

    active_bytes = managed_bytes = active_blocks = held_blocks = 0

    def __init__(self, queue: Any) -> None:
        from pyopencl.tools import ImmediateAllocator

        self._allocate = ImmediateAllocator(queue)
        self._kept: list[Any] = []

    def __call__(self, size: int) -> Any:
        """Return a new buffer of exactly *size* bytes."""
        self._kept.append(self._allocate(size))
        return self._kept[-1]

    def free_held(self) -> None:
        """Nothing is held."""

    def bin_number(self, size: int) -> int:
        """Sizes are not rounded."""
        return size

    def alloc_size(self, number: int) -> int:
        """Return the size itself."""
        return number


@pytest.fixture(scope="session")
def data_file() -> Callable[[str], Path]:
    """Find a file of the test data by its path below CLVOX_DATA; skip the test without it."""

    def find(name: str) -> Path:
        folder = os.environ.get("CLVOX_DATA")
        if not folder:
            pytest.skip(f"CLVOX_DATA is not set: {name} is not at hand")
        path = Path(folder) / name
        assert path.exists(), f"CLVOX_DATA={folder} holds no {name}"
        return path

    return find


OCLGRIND_CASES = 3
"""Oclgrind runs so many of the cases of a test, spread over all of them."""


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Under Oclgrind, which takes a thousand times as long, leave out most cases of each test."""
    if "OCLGRIND_LOG" not in os.environ:
        return
    cases: dict[str, list[pytest.Item]] = {}
    for item in items:
        cases.setdefault(item.nodeid.partition("[")[0], []).append(item)
    kept: set[str] = set()
    for same in cases.values():
        # From the simplest to the most involved, both included.
        last, count = len(same) - 1, min(len(same), OCLGRIND_CASES)
        kept |= {same[last * n // max(count - 1, 1)].nodeid for n in range(count)}
    left_out = [item for item in items if item.nodeid not in kept]
    config.hook.pytest_deselected(items=left_out)
    items[:] = [item for item in items if item.nodeid in kept]


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call() -> Generator[None, None, None]:
    """Fail the test during which Oclgrind reports anything."""
    before = len(_reports())
    yield
    news = _reports()[before:]
    if news:
        pytest.fail(f"Oclgrind reports:\n{news[:4000]}", pytrace=False)


def _reports() -> str:
    log = Path(os.environ.get("OCLGRIND_LOG", ""))
    return log.read_text() if log.is_file() else ""
