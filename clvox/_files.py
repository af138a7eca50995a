"""Files that are written whole or not at all."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def whole(target: Path, *, keep: bool = True) -> Iterator[Path]:
    """Lend an empty file beside *target* that takes its place at the end, or goes after an error.

    It always goes, and *target* is left alone, if it is not to be kept.

    Raises
    ------
    OSError
        No file can be made there, or *target* cannot be replaced.
    """
    partial = target.with_name(f"{target.name}.partial")
    try:
        partial.touch()
        yield partial
        if keep:
            partial.replace(target)
    finally:
        partial.unlink(missing_ok=True)
