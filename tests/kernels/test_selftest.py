"""Kernels of the self-test: equal to their twins."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from clvox.device import GROUP, Session
from clvox.ops import selftest as ops
from clvox.reference import selftest as reference

COUNTS = [0, 1, GROUP - 1, GROUP, GROUP + 1, 1000]
whole = st.integers(0, 2**64 - 1) | st.sampled_from([0, 1, 2**32, 2**63, 2**63 - 1, 2**64 - 1])
halves = st.integers(-40, 40).map(lambda k: k / 2)
reals = halves | st.floats(-4096, 4096, width=32)


@pytest.mark.parametrize("count", [1, *COUNTS[2:]])
def test_contended_words(session: Session, count: int) -> None:
    np.testing.assert_array_equal(ops.contend(session, count), reference.contend(count))


@given(pairs=hnp.arrays(np.uint64, st.tuples(st.just(2), st.integers(0, 70)), elements=whole))
def test_integers(session: Session, pairs: NDArray[np.uint64]) -> None:
    found = ops.calculate(session, *pairs)
    np.testing.assert_array_equal(found, reference.calculate(*pairs))


@given(triples=hnp.arrays(np.float32, st.tuples(st.just(3), st.integers(0, 70)), elements=reals))
def test_rounding(session: Session, triples: NDArray[np.float32]) -> None:
    found = ops.round_off(session, *triples)
    np.testing.assert_array_equal(found, reference.round_off(*triples))


def test_rounding_twice_differs_from_rounding_once() -> None:
    """Or else a fused multiply-add would pass."""
    x = np.float32(1 + 2**-12)
    (row,) = reference.round_off(np.array([x]), np.array([x]), np.array([-1 - 2**-11], np.float32))
    assert row[1] == 0 != float(x) * float(x) - 1 - 2**-11
