"""Solids as pieces of rays: twin of the dexels kernels.

A row is what one ray meets, in order.  As a list of crossings it may hold anything; resolved, it
alternates between ends that go in and ends that go out, each deeper than the one before.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence
from fractions import Fraction
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clvox.reference.fill import FillRule
from clvox.reference.lists import Lists

CAP = -1
"""Triangle of an end where the grid's box cuts the solid."""

OperationName: TypeAlias = Literal["union", "intersection", "difference", "xor"]

_INSIDE: dict[FillRule, Callable[[int], bool]] = {
    "parity": lambda winding: winding % 2 == 1,
    "nonzero": lambda winding: winding != 0,
    "positive": lambda winding: winding > 0,
}
_OPERATIONS: dict[OperationName, Callable[[bool, bool], bool]] = {
    "union": lambda a, b: a or b,
    "intersection": lambda a, b: a and b,
    "difference": lambda a, b: a and not b,
    "xor": lambda a, b: a != b,
}


class End(NamedTuple):
    """A crossing, or one end of a piece.

    depth: fixed point in voxels; sign: +1 going in, -1 going out.
    """

    depth: int
    triangle: int
    sign: int


Row: TypeAlias = Sequence[End]


def box_of(count: int, fraction_bits: int) -> tuple[int, int]:
    """Return the depths at which a ray enters and leaves the box of a grid, *count* voxels long."""
    half = 1 << (fraction_bits - 1)
    return -half, (count << fraction_bits) - half


def rows_of(lists: Lists) -> list[Row]:
    """Return the rows of *lists*, one for each ray."""
    ends = [
        End(*end)
        for end in zip(
            lists.depth.tolist(), lists.triangle.tolist(), lists.sign.tolist(), strict=True
        )
    ]
    spans = lists.offsets.astype(np.int64).tolist()
    return [ends[first:last] for first, last in itertools.pairwise(spans)]


def lists_of(rows: Iterable[Row]) -> Lists:
    """Return the lists whose rows are *rows*."""
    held = list(rows)
    offsets = np.zeros(len(held) + 1, dtype=np.uint64)
    offsets[1:] = np.cumsum([len(row) for row in held])
    ends = np.array([end for row in held for end in row], dtype=np.int32)
    depth, triangle, sign = ends.reshape(-1, 3).T
    return Lists(offsets, depth, triangle, sign)


def resolve(row: Row, rule: FillRule, box: tuple[int, int]) -> Row:
    """Return the ends of the pieces of a ray that are inside by *rule* and in the box.

    Crossings of one depth act together, those beyond the box at its face.  An end keeps the
    lowest triangle that is crossed there its way; if there is none, the lowest crossed the other
    way; and if the box cuts the solid there, none.  A piece still open where the ray leaves the
    box, which an open mesh can leave behind, ends there.
    """
    low, high = box
    found: list[End] = []
    inside = False
    for depth in sorted({min(max(end.depth, low), high) for end in row}):
        before = [end for end in row if min(max(end.depth, low), high) <= depth]
        winding = len(before) if rule == "parity" else sum(end.sign for end in before)
        now = depth < high and _INSIDE[rule](winding)
        if now != inside:
            # A crossing at the upper face may have been rounded up to a unit beyond it.
            here = [
                end
                for end in before
                if min(max(end.depth, low), high) == depth and low <= end.depth <= high + 1
            ]
            sign = 1 if now else -1
            best = min(here, key=lambda end: (end.sign != sign, end.triangle), default=None)
            found.append(End(depth, CAP if best is None else best.triangle, sign))
        inside = now
    if inside:
        found.append(End(high, CAP, -1))
    return found


def holds(row: Row, depth: int) -> bool:
    """Whether a resolved row is inside from *depth* on."""
    return sum(end.depth <= depth for end in row) % 2 == 1


def combine(a: Row, b: Row, operation: OperationName) -> Row:
    """Return the combination of two resolved rows.

    An end keeps the triangle of the row that ends or begins there: of *a*, if both do, unless it
    is the box's face.
    """
    decide = _OPERATIONS[operation]
    found: list[End] = []
    inside = False
    for depth in sorted({end.depth for end in (*a, *b)}):
        now = decide(holds(a, depth), holds(b, depth))
        if now != inside:
            here = [end.triangle for end in (*a, *b) if end.depth == depth]
            real = [triangle for triangle in here if triangle != CAP]
            found.append(End(depth, (real or here)[0], 1 if now else -1))
        inside = now
    return found


def complement(row: Row, box: tuple[int, int]) -> Row:
    """Return the box without the pieces of a resolved row."""
    low, high = box
    whole = [End(low, CAP, 1), End(high, CAP, -1)]
    return combine(whole, row, "difference")


def to_voxels(rows: Sequence[Row], fraction_bits: int, count: int) -> NDArray[np.bool_]:
    """Return which samples are inside, (rays, count), of resolved rows."""
    found = np.zeros((len(rows), count), dtype=np.bool_)
    for number, row in enumerate(rows):
        slots = [-(-end.depth >> fraction_bits) for end in row]
        for first, last in zip(slots[::2], slots[1::2], strict=True):
            found[number, max(first, 0) : max(last, 0)] = True
    return found


def from_voxels(samples: NDArray[np.bool_], fraction_bits: int) -> list[Row]:
    """Return the rows, ending half-way between samples, of samples (rays, count)."""
    half = 1 << (fraction_bits - 1)
    rows: list[Row] = []
    for ray in samples:
        padded = np.concatenate([[False], ray, [False]]).astype(np.int8)
        slots = np.flatnonzero(np.diff(padded)).tolist()
        rows.append(
            [
                End((slot << fraction_bits) - half, CAP, -1 if number % 2 else 1)
                for number, slot in enumerate(slots)
            ]
        )
    return rows


def lengths_in_cells(row: Row, box: tuple[int, int], width: int) -> list[int]:
    """Return how much of each cell of the box, *width* units long, is inside a resolved row."""
    low, high = box
    pieces = list(zip(row[::2], row[1::2], strict=True))
    return [
        sum(
            max(0, min(leave.depth, start + width, high) - max(enter.depth, start))
            for enter, leave in pieces
        )
        for start in range(low, high, width)
    ]


def moments(
    rows: Sequence[Row], across: tuple[int, int], fraction_bits: int
) -> tuple[Fraction, ...]:
    """Return integrals over the pieces, as bars of one voxel's section, in voxels.

    rows: resolved, of the rays (i, j), i fastest; across: how many along i and along j.

    Returns
    -------
    tuple of Fraction
        Of 1, i, j, w, i i, j j, w w, i j, i w and j w, with 0 at the centre of the first voxel.
    """
    sums = [Fraction(0)] * 10
    twelfth = Fraction(1, 12)
    for number, row in enumerate(rows):
        j, i = divmod(number, across[0])
        for enter, leave in zip(row[::2], row[1::2], strict=True):
            e, w = (Fraction(end.depth, 1 << fraction_bits) for end in (enter, leave))
            length, first, second = w - e, (w**2 - e**2) / 2, (w**3 - e**3) / 3
            for at, term in enumerate(
                [
                    length, length * i, length * j, first,
                    length * (i * i + twelfth), length * (j * j + twelfth), second,
                    length * i * j, first * i, first * j,
                ]
            ):  # fmt: skip
                sums[at] += term
    return tuple(sums)


def examine(crossings: Sequence[Row], pieces: Sequence[Row]) -> tuple[int, int, int, int, int]:
    """Return what `clvox.ops.dexel_measure.examine` returns, of crossings and resolved rows.

    The length of the shortest piece and its ray, 0 and -1 if there is none; most crossings of a
    ray, and that ray; and how many rays have an odd number of them.
    """
    lengths = [
        (leave.depth - enter.depth, ray)
        for ray, row in enumerate(pieces)
        for enter, leave in zip(row[::2], row[1::2], strict=True)
    ]
    thinnest = min(lengths, default=(0, -1))
    depth = max(len(row) for row in crossings)
    deepest = next(ray for ray, row in enumerate(crossings) if len(row) == depth)
    odd = sum(len(row) % 2 for row in crossings)
    return *thinnest, depth, deepest, odd
