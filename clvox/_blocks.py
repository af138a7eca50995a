"""Rows of large arrays, worked on block by block and by two threads."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

BLOCK = 1 << 13
"""Rows worked on at a time: intermediate arrays stay in the cache, and in memory that is reused;
larger ones come fresh from the system each time, which costs more than the work on them."""

SMALL = 1 << 16
"""Below this many rows a second thread costs more than it saves."""


def in_halves(work: Callable[[int, int], None], count: int) -> None:
    """Call *work* for both halves of range(count) at once; NumPy lets go of the interpreter."""
    if count < SMALL:
        work(0, count)
        return
    half = count // 2
    with ThreadPoolExecutor(1) as other:
        second = other.submit(work, half, count)
        work(0, half)
        second.result()


def in_blocks(work: Callable[[int, int], None], count: int) -> None:
    """Call *work* for each block of range(count), two of them at once."""

    def blocks(start: int, stop: int) -> None:
        for at in range(start, stop, BLOCK):
            work(at, min(at + BLOCK, stop))

    in_halves(blocks, count)
