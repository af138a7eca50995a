"""One piece of work on a device: what it may take, and who says whether it shall go on."""

from __future__ import annotations

import itertools
import weakref
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeAlias, cast

from clvox.errors import OutOfMemoryError

if TYPE_CHECKING:
    import pyopencl.array as cla

Tick: TypeAlias = Callable[[], object]
"""Called between launches; may raise, to end the work."""


class Job:
    """The arrays that one piece of work has on a device, and the most that they may take.

    Others of the same session, models that are there already above all, do not count.

    Attributes
    ----------
    most : int
        Bytes that its arrays may take at once.
    nbytes, peak_nbytes : int
        Bytes that they take, and the most that they took at once.
    refused : int
        Bytes that were too many, if any were.
    """

    def __init__(self, most: int, tick: Tick | None = None) -> None:
        self.most = most
        self.nbytes = 0
        self.peak_nbytes = 0
        self.refused = 0
        self._tick = tick
        self._numbers = itertools.count()
        self._arrays: dict[int, weakref.ref[cla.Array]] = {}

    @property
    def left(self) -> int:
        """Bytes that may still be taken."""
        return self.most - self.nbytes

    def refuse(self, nbytes: int) -> None:
        """Raise if so many bytes more are too many.

        Raises
        ------
        OutOfMemoryError
            They are.
        """
        if nbytes > self.left:
            self.refused = nbytes
            raise OutOfMemoryError(
                f"{nbytes:,} bytes more are needed at once; {self.nbytes:,} are in use of the "
                f"{self.most:,} that the work may take. Use a coarser pitch, or a larger "
                "memory_budget."
            )

    def hold(self, array: cla.Array, nbytes: int) -> None:
        """Count an array, until it is gone."""
        number = next(self._numbers)
        self._arrays[number] = weakref.ref(array, lambda _: self._drop(number, nbytes))
        self.nbytes += nbytes
        self.peak_nbytes = max(self.peak_nbytes, self.nbytes)

    def _drop(self, number: int, nbytes: int) -> None:
        del self._arrays[number]
        self.nbytes -= nbytes

    def tick(self) -> None:
        """Let whoever started the work have a word, between two launches."""
        if self._tick is not None:
            self._tick()

    def close(self) -> None:
        """Count no longer: what is there is the result."""
        self._arrays.clear()

    def abandon(self) -> None:
        """Give all its memory back, though names, and frames of a traceback, may still hold it."""
        for reference in list(self._arrays.values()):
            array = reference()
            if array is not None and array.base_data is not None:
                cast("Any", array.base_data).release()
        self._arrays.clear()
