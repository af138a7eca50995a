"""What the kernels of the self-test must answer, in Python's integers and NumPy's float32."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_MASK = 2**64 - 1


def contend(count: int) -> NDArray[np.uint32]:
    """Return six words after *count* updates each, in whatever order.

    They are counted, added, xored, ored, and the greatest and the least of ``2654435761 * i``
    modulo 2**32, for i from 0 on; what is ored is the bit that its five highest bits number.
    """
    words = [0, 0, 0, 0, 0, 2**32 - 1]
    for index in range(count):
        value = index * 2654435761 % 2**32
        words[0] += 1
        words[1] = (words[1] + value) % 2**32
        words[2] ^= value
        words[3] |= 1 << (value >> 27)
        words[4] = max(words[4], value)
        words[5] = min(words[5], value)
    return np.array(words, np.uint32)


def calculate(a: NDArray[np.uint64], b: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return seven numbers for each pair x, y, (n, 7).

    The product modulo 2**64; x shifted by y % 64 to the left, to the right, and to the right with
    its sign; the set bits of x; whether x is less than y, and whether it is with both signed.
    """
    rows = []
    for x, y in zip(a.tolist(), b.tolist(), strict=True):
        by = y % 64
        signed_x, signed_y = (n - 2**64 if n >> 63 else n for n in (x, y))
        row = [x * y, x << by, x >> by, signed_x >> by, x.bit_count(), x < y, signed_x < signed_y]
        rows.append([int(value) & _MASK for value in row])
    return np.array(rows, np.uint64).reshape(-1, 7)


def round_off(
    a: NDArray[np.float32], b: NDArray[np.float32], c: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Return (n, 2): a to the nearest integer, halves to the even one; a * b + c, rounded twice."""
    return np.stack([np.rint(a), a * b + c], axis=1)
