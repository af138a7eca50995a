"""How much memory a piece of work takes."""

from __future__ import annotations

import gc
from pathlib import Path
from types import TracebackType
from typing import Self

_STATUS = Path("/proc/self/status")
_CLEAR = Path("/proc/self/clear_refs")
_CLEAR_PEAK = "5"


class PeakMemory:
    """Growth of this process's memory while the block runs, at its peak.

    It is resident memory, which holds what libraries in other languages allocate, too, and on a
    processor also the device's.  Memory that the process had kept from earlier work and used again
    does not show, so the first run says most.

    Attributes
    ----------
    nbytes : int or None
        Bytes; None before the end of the block, and on systems other than Linux.
    """

    nbytes: int | None = None

    def __enter__(self) -> Self:
        gc.collect()
        try:
            _CLEAR.write_text(_CLEAR_PEAK)
            self._start = _resident("VmRSS")
        except OSError:
            # Another system, or one that does not let a process reset its peak.
            self._start = None
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._start is not None:
            self.nbytes = max(0, (_resident("VmHWM") or 0) - self._start)

    _start: int | None = None


def _resident(name: str) -> int | None:
    for line in _STATUS.read_text().splitlines():
        if line.startswith(f"{name}:"):
            return int(line.split()[1]) * 1024
    return None
