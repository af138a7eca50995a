"""What whoever waits for a build is told."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from tqdm import tqdm

from clvox.device import Session
from clvox.ops.facets import Progress


class Told:
    """What was last told of the progress: done, of a whole of *total*."""

    def __init__(self, session: Session, tell: Progress | None, total: int) -> None:
        self._session = session
        self._tell = tell
        self._total = total
        self._done = 0

    def again(self) -> None:
        """Say that the work still goes on, and so let it be cancelled."""
        if self._tell is not None:
            # The caller's function may use other models, which are no part of the work.
            with self._session.apart():
                self._tell(self._done, self._total)

    def part(self, first: float, last: float) -> Progress | None:
        """Progress of a part of the work, from *first* to *last* of 1, as progress of the whole."""
        if self._tell is None:
            return None

        def tell(done: int, total: int) -> None:
            share = first + (last - first) * done / total
            self._done = max(self._done, round(share * self._total))
            self.again()

        return tell


@contextmanager
def drawn(
    *, progress: bool | Progress | None, verb: str = "voxelize", unit: str = "triangles"
) -> Iterator[Progress | None]:
    """Whom to tell of progress: the caller's function, a bar, or nobody."""
    if not isinstance(progress, bool):
        yield progress
    elif not progress:
        yield None
    else:
        with tqdm(unit=f" {unit}", unit_scale=True, desc=verb) as bar:

            def tell(done: int, total: int) -> None:
                bar.total = total
                bar.update(done - bar.n)

            yield tell
