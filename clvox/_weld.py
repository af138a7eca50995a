"""Merge the vertices of a mesh, drop what encloses nothing, and count the uses of each edge.

All of it is decided exactly.  A hash only ever says where to look: rows whose hashes agree are
compared in full, and edges are sorted by the numbers of their vertices.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from clvox._blocks import SMALL, in_blocks, in_halves


@dataclass(frozen=True)
class Mesh:
    """Vertices, triangles, and the caller's numbers of the vertices (None: as they are here)."""

    points: NDArray[np.float64]
    triangles: NDArray[np.int32]
    numbers: NDArray[np.int64] | None

    def limited(self, used: NDArray[np.bool_]) -> Mesh:
        """The mesh with only those vertices that are *used*."""
        return self if used.all() else self._only(used, self.triangles)

    def merged(self, first: NDArray[np.intp]) -> Mesh:
        """Each vertex replaced by vertex *first* of it, which is its own first."""
        used = first == np.arange(len(first))
        return self._only(used, first.astype(np.int32)[self.triangles])

    def _only(self, used: NDArray[np.bool_], triangles: NDArray[np.int32]) -> Mesh:
        kept = np.flatnonzero(used)
        new = np.cumsum(used, dtype=np.int32) - np.int32(1)
        numbers = kept if self.numbers is None else self.numbers[kept]
        return Mesh(self.points[kept], new[triangles], numbers)

    def of(self, index: int) -> int:
        return index if self.numbers is None else int(self.numbers[index])


# --- equal rows ---------------------------------------------------------------------------------


def _hash(rows: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """A 64-bit number for each row of three words."""
    # float32 values leave the low half of a double empty, so the high half is folded in.
    folded = rows ^ (rows >> np.uint64(32))
    keys: NDArray[np.uint64] = folded[:, 0] * np.uint64(0x9E3779B97F4A7C15)
    keys += folded[:, 1] * np.uint64(0xC2B2AE3D27D4EB4F)
    keys += folded[:, 2] * np.uint64(0x165667B19E3779F9)
    return keys


def first_equal(rows: NDArray[Any]) -> NDArray[np.intp] | None:
    """The number of the first row with the same bits as each row; None if all rows differ.

    *rows*: (n, 3), eight bytes each, C-contiguous.
    """
    words = rows.view(np.uint64)
    count = len(words)
    bits = np.uint64(max(count - 1, 1).bit_length())
    low = (np.uint64(1) << bits) - np.uint64(1)

    # The number of the row takes the low bits of its hash: sorting whole words is far faster
    # than argsort, and rows of one hash come in the order of their numbers.
    keys = np.empty(count, np.uint64)

    def fill(at: int, end: int) -> None:
        part = _hash(words[at:end])
        keys[at:end] = (part & ~low) | np.arange(at, end, dtype=np.uint64)

    in_blocks(fill, count)
    _sort(keys)
    same = np.zeros(count, bool)
    np.equal(keys[1:] >> bits, keys[:-1] >> bits, out=same[1:])
    if not same.any():
        return None
    order = (keys & low).astype(np.intp)
    starts = np.flatnonzero(~same)
    first = np.empty(count, np.intp)
    first[order] = np.repeat(order[starts], np.diff(starts, append=count))

    clash = np.zeros(count, bool)

    def compare(at: int, end: int) -> None:
        clash[at:end] = (words[at:end] != words.take(first[at:end], axis=0)).any(axis=1)

    in_blocks(compare, count)
    if clash.any():
        # Different rows, equal hashes: everything that shares such a hash is sorted in full.
        bad = np.zeros(count, bool)
        bad[first[clash]] = True
        members = np.flatnonzero(bad[first])
        exact = words[members]
        turn = np.lexsort((members, exact[:, 2], exact[:, 1], exact[:, 0]))
        members, exact = members[turn], exact[turn]
        begins = np.ones(len(members), bool)
        begins[1:] = (exact[1:] != exact[:-1]).any(axis=1)
        first[members] = members[np.flatnonzero(begins)[np.cumsum(begins) - 1]]
        if (first == np.arange(count)).all():
            return None
    return first


def first_near(
    points: NDArray[np.float64], candidates: NDArray[np.int32], length: float
) -> NDArray[np.intp] | None:
    """Like `first_equal`, for the *candidates* among the points, and within *length*.

    Points that differ by at most *length* along each axis are merged for certain, points that
    differ by twice as much or more only by way of others.  The cells of eight shifted grids do
    this at a bounded cost, however many points crowd into a cell.
    """
    if length == 0:
        return None
    places = points[candidates]
    scaled = (places - places.min(axis=0)) / (2 * length)
    pairs = []
    for shift in np.ndindex(2, 2, 2):
        first = first_equal(np.floor(scaled + np.array(shift) / 2))
        if first is not None:
            moved = np.flatnonzero(first != np.arange(len(first)))
            pairs.append(np.stack([moved, first[moved]], axis=1))
    if not pairs:
        return None
    joined: Any = trimesh.graph.connected_component_labels  # it has no annotations
    labels = joined(np.concatenate(pairs), len(candidates))
    # The candidates ascend, so the first of a component is the lowest-numbered.
    _, lowest = np.unique(labels, return_index=True)
    result = np.arange(len(points))
    result[candidates] = candidates[lowest[labels]]
    return result


# --- edges --------------------------------------------------------------------------------------


@dataclass
class Rest:
    """What is left of the triangles, and the edges that spoil it."""

    kept: NDArray[np.int64]
    repeated: int
    duplicates: int
    cancelled: int
    odd: NDArray[np.int32]
    uneven: NDArray[np.int32]
    crowded: int


_BACKWARD = np.int64(-(2**63))


def resolve(mesh: Mesh) -> Rest:
    """Drop what encloses nothing, and count the uses of each edge."""
    count = len(mesh.points)
    none = np.empty((0, 2), np.int32)
    kept = np.arange(len(mesh.triangles))
    triangles = mesh.triangles
    keys, flawed = _edge_keys(triangles, count)
    if flawed:
        a, b, c = triangles.T
        kept = np.flatnonzero((a != b) & (b != c) & (c != a))
        triangles = triangles[kept]
        keys, _ = _edge_keys(triangles, count)
    repeated = len(mesh.triangles) - len(kept)
    if _is_simple(keys, count):
        return Rest(kept, repeated, 0, 0, none, none, 0)

    single, paired = _distinct(triangles)
    duplicates = len(kept) - len(single)
    if duplicates or len(paired) < len(single):
        kept, triangles = kept[paired], triangles[paired]
        keys, _ = _edge_keys(triangles, count)
    odd, uneven, crowded = _flawed_edges(keys, count)
    return Rest(kept, repeated, duplicates, len(single) - len(paired), odd, uneven, crowded)


def _widths(count: int) -> tuple[int, int]:
    """Bits for the number of a vertex, and bits left over in an edge's key."""
    bits = max(count - 1, 1).bit_length()
    return bits, 63 - 2 * bits


def _edge_keys(triangles: NDArray[np.int32], count: int) -> tuple[NDArray[np.int64], bool]:
    """A key for each side of each triangle, and whether some triangle uses a vertex twice.

    From the top: set if the side runs from the higher vertex number to the lower; the lower
    number; the higher; as many low bits as fit of the third vertex.
    """
    bits, spare = _widths(count)
    low = np.int64((1 << min(bits, spare)) - 1)
    keys = np.empty((3, len(triangles)), np.int64)
    flaws: list[bool] = []

    def fill(at: int, end: int) -> None:
        corners = triangles[at:end].T.astype(np.int64, order="C")
        # The fields are put in place before they are compared: that changes no order.
        lower, higher = corners << np.int64(bits + spare), corners << np.int64(spare)
        thirds = corners & low
        for p, q, r in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            ahead = corners[q] - corners[p]
            if not ahead.all():
                flaws.append(True)
            ahead &= _BACKWARD  # what is left is the sign
            ahead |= np.minimum(lower[p], lower[q])
            ahead |= np.maximum(higher[p], higher[q])
            np.bitwise_or(ahead, thirds[r], out=keys[p, at:end])

    in_blocks(fill, len(triangles))
    return keys.reshape(-1), any(flaws)


def _is_simple(keys: NDArray[np.int64], count: int) -> bool:
    """Whether each edge is used once each way, by triangles of different vertices.

    Then the surface is oriented, hence closed, and no two triangles have the same vertices: two
    of one orientation would share a side, two of opposite orientation an edge and the third
    vertex.  Where the third vertex does not fit, its low bits may say no to such a surface.
    """
    if len(keys) % 2 or not len(keys):
        return False
    _sort(keys)
    half = len(keys) // 2
    backward, forward = keys[:half], keys[half:]
    if backward[-1] >= 0 or forward[0] < 0:
        return False
    rest = np.int64(_widths(count)[1])
    flaws: list[bool] = []

    def compare(at: int, end: int) -> None:
        there = forward[at:end]
        apart = there ^ backward[at:end] ^ _BACKWARD
        after = forward[at + 1 : end + 1]
        again = (after ^ there[: len(after)]) >> rest
        if (apart >> rest).any() or not apart.all() or not again.all():
            flaws.append(True)
            return

    in_blocks(compare, half)
    return not any(flaws)


def _distinct(triangles: NDArray[np.int32]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """The triangles that are no copies, and those of them that have no opposite either."""
    a, b, c = triangles.T.astype(np.int64)
    low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
    turned = (a < b).astype(np.int64) + (b < c) + (c < a) == 1
    middle = a + b + c - low - high
    single = np.arange(len(triangles))
    first = first_equal(np.stack([low, middle, 2 * high + turned], axis=1))
    if first is not None:
        single = np.flatnonzero(first == single)
    first = first_equal(np.stack([low, middle, high], axis=1)[single])
    if first is None:
        return single, single
    uses = np.bincount(first, minlength=len(single))
    return single, single[uses[first] == 1]


def _flawed_edges(
    keys: NDArray[np.int64], count: int
) -> tuple[NDArray[np.int32], NDArray[np.int32], int]:
    """The edges with an odd number of triangles, and those not used equally often both ways.

    Third, the number of edges that belong to more than two triangles.
    """
    bits, spare = _widths(count)
    backward = (keys < 0).astype(np.int64)
    # An edge needs at most 62 bits: there is room for its direction below.
    sides = ((keys & ~_BACKWARD) >> np.int64(spare) << np.int64(1)) | backward
    _sort(sides)
    edges = sides >> np.int64(1)
    starts = np.flatnonzero(np.concatenate([[True], edges[1:] != edges[:-1]])[: len(edges)])
    uses = np.diff(starts, append=len(edges))
    back = np.add.reduceat(sides & np.int64(1), starts) if len(starts) else uses
    edges = edges[starts]
    pairs = np.stack([edges >> np.int64(bits), edges & np.int64((1 << bits) - 1)], axis=1)
    pairs = pairs.astype(np.int32)
    return pairs[uses % 2 == 1], pairs[2 * back != uses], int((uses > 2).sum())


# --- two threads --------------------------------------------------------------------------------


def _sort(keys: NDArray[Any]) -> None:
    """Sort in place."""
    count = len(keys)
    if count < SMALL:
        keys.sort()
        return
    keys.partition(count // 2)
    in_halves(lambda start, stop: keys[start:stop].sort(), count)
