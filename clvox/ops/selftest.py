"""What a device must be able to do, tried on its own: kernels in `cl_kernels/selftest`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from clvox.device import Session


def contend(session: Session, count: int) -> NDArray[np.uint32]:
    """Return six words that *count* work-items updated at once: see `reference.selftest`."""
    words = session.upload(np.array([0, 0, 0, 0, 0, 2**32 - 1], np.uint32))
    session.run(session.kernel("selftest/contend.cl", "contend"), count, np.uint64(count), words)
    return np.asarray(words.get())


def calculate(session: Session, a: NDArray[np.uint64], b: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return seven results for each pair of 64-bit integers: see `reference.selftest`."""
    return _each(session, "calculate", (a, b), 7, np.uint64)


def round_off(
    session: Session, a: NDArray[np.float32], b: NDArray[np.float32], c: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Return two results for each triple of floats: see `reference.selftest`."""
    return _each(session, "round_off", (a, b, c), 2, np.float32)


def _each(
    session: Session, name: str, inputs: tuple[NDArray[Any], ...], width: int, kind: type
) -> NDArray[Any]:
    count = len(inputs[0])
    found = session.empty((count, width), kind)
    if count:
        kernel = session.kernel("selftest/calculate.cl", name)
        arrays = [session.upload(array) for array in inputs]
        session.run(kernel, count, np.uint64(count), *arrays, found)
    return np.asarray(found.get())
