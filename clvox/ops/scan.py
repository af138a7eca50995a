"""Exclusive prefix sums: kernels in `cl_kernels/scan`."""

from __future__ import annotations

import numpy as np
import pyopencl.array as cla

from clvox.device import GROUP, Session

RUN = 32
"""Counts that one work-item sums before it meets the others."""


def prefix_sum(
    session: Session, counts: cla.Array, *, bits: int = 32, group: int = GROUP
) -> tuple[cla.Array, int]:
    """Return the sum of all counts before each one, and the sum of all.

    Waits for the device, since the total comes back to the host.

    Parameters
    ----------
    counts : (n,) uint32
    bits : int
        32 or 64, of the sums.  With 32 they are right as long as the total is below 2**32.
    group : int
        Work-items per group, a power of two.

    Returns
    -------
    sums : (n,) uint32 or uint64, on the device
    total : int
        Of 64 bits in any case.
    """
    count = counts.size
    sums = session.empty(count, np.uint32 if bits == 32 else np.uint64)
    if count == 0:
        return sums, 0
    items = -(-count // RUN)
    chunks = -(-items // group)
    totals = session.empty(chunks + 1, np.uint64)

    def run(name: str, items: int, *arguments: cla.Array | np.generic) -> None:
        kernel = session.kernel("scan/prefix_sum.cl", name, GROUP=group, RUN=RUN, RESULT=bits)
        session.run(kernel, items, *arguments, group=group, steps=RUN)

    run("sum_chunks", items, np.uint64(count), counts, totals)
    run("scan_sums", group, np.uint64(chunks), totals)
    run("scan_chunks", items, np.uint64(count), totals, counts, sums)
    return sums, int(totals[chunks:].get()[0])
