"""Prefix sums equal those of Python integers, at all sizes about the edges of groups and chunks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from numpy.typing import NDArray

from clvox.device.source import read_source
from clvox.ops.scan import RUN, prefix_sum
from clvox.reference import multilevel as twin
from tests.kernels.cases import build

if TYPE_CHECKING:
    from clvox.device import Session

GROUPS = [1, 2, 8, 64]
SIZES = [0, 1, 31, 32, 33]


def check(session: Session, counts: NDArray[np.uint32], bits: int, group: int) -> int:
    """Compare with the twin; return the total."""
    sums, total = prefix_sum(session, session.upload(counts), bits=bits, group=group)
    expected, expected_total = twin.prefix_sum(counts)
    assert total == expected_total
    width = np.uint32 if bits == 32 else np.uint64
    np.testing.assert_array_equal(sums.get(), expected.astype(width), strict=True)
    return total


@pytest.mark.parametrize("bits", [32, 64])
@pytest.mark.parametrize("group", GROUPS)
def test_sizes_about_the_edges_of_runs_and_chunks(session: Session, group: int, bits: int) -> None:
    rng = np.random.default_rng(group)
    chunk = group * RUN
    # Two chunks and a bit; and more chunks than the one group of the second launch has items.
    more = chunk * (group + 1) + 1 if group < 64 else 3 * chunk + 5
    for size in [*SIZES, chunk - 1, chunk, chunk + 1, 2 * chunk + 7, more]:
        check(session, rng.integers(0, 1000, size).astype(np.uint32), bits, group)


@pytest.mark.parametrize("group", GROUPS)
def test_totals_beyond_32_bits(session: Session, group: int) -> None:
    counts = np.full(2 * group * RUN + 3, 0xFFFFFFFF, np.uint32)
    assert check(session, counts, 64, group) > 2**32


def test_totals_just_below_33_bits(session: Session) -> None:
    """All that 32-bit sums hold."""
    assert check(session, np.array([2**31, 2**31 - 1], np.uint32), 32, 8) == 2**32 - 1


def test_the_total_has_64_bits_where_sums_have_32(session: Session) -> None:
    """So that whoever numbers things can see that there are too many."""
    _, total = prefix_sum(session, session.upload(np.full(70, 2**31, np.uint32)), bits=32, group=8)
    assert total == 70 * 2**31


def test_many_chunks(session: Session) -> None:
    """The one group of the second launch then sums runs of chunks."""
    counts = np.random.default_rng(1).integers(0, 9, 8 * RUN * 70 + 1).astype(np.uint32)
    check(session, counts, 32, 8)


COLLECTIVE = """
__kernel void collective(
    const __global ulong *values, __global ulong *sums, __global ulong *totals)
{
    __local ulong scratch[GROUP];
    const size_t id = get_global_id(0);
    ulong total;
    sums[id] = group_scan(scratch, values[id], &total);
    totals[id] = total;
}
"""


@pytest.mark.parametrize("group", [1, 2, 4, 16, 64, 128])
def test_the_collective_alone(session: Session, group: int) -> None:
    """Every item of every group gets the sum before it, and the total of its own group."""
    if group > session.device.handle.max_work_group_size:
        pytest.skip(f"groups have {session.device.handle.max_work_group_size} items at most")
    source = read_source("common/group_scan.h") + COLLECTIVE
    collective = build(session, source, "collective", GROUP=group)
    values = np.random.default_rng(group).integers(0, 2**56, (3, group)).astype(np.uint64)
    sums, totals = session.empty(values.shape, np.uint64), session.empty(values.shape, np.uint64)
    session.run(collective, values.size, session.upload(values), sums, totals, group=group)
    for row, found, total in zip(values, sums.get(), totals.get(), strict=True):
        expected, whole = twin.prefix_sum(row)
        np.testing.assert_array_equal(found, expected, strict=True)
        assert total.tolist() == [whole] * group
