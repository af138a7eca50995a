"""Solids as pieces of rays, and their combinations: `cl_kernels/dexels`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from enum import IntEnum
from typing import NamedTuple

import numpy as np
import pyopencl.array as cla

from clvox.device import Session
from clvox.device.session import Argument
from clvox.grid import Shape
from clvox.ops.combine import Operation
from clvox.ops.lists import CrossingLists
from clvox.ops.scan import prefix_sum

RAYS_PER_LAUNCH = 1 << 20

RUN = 64
"""Ends in a row that one work-item looks at."""

CAP = 0x7FFFFFFF
"""Triangle of an end where the face of the grid's box cuts the solid: `dexels/ends.h`."""


class Rule(IntEnum):
    """What is inside: RULE of `dexels/resolve_rows.cl`."""

    PARITY = 0
    NONZERO = 1
    POSITIVE = 2


class Frame(NamedTuple):
    """The rays along an axis of a grid of *shape* voxels, and the unit of depths on them."""

    shape: Shape
    axis: int
    fraction_bits: int

    @property
    def across(self) -> tuple[int, int]:
        """Rays along the earlier of the other axes, in which neighbours follow, and the later."""
        first, second = (count for a, count in enumerate(self.shape) if a != self.axis)
        return first, second

    @property
    def rays(self) -> int:
        """Number of rays."""
        first, second = self.across
        return first * second

    @property
    def box(self) -> tuple[np.int32, np.int32]:
        """Depths at which rays enter and leave the grid's box."""
        half = 1 << (self.fraction_bits - 1)
        return np.int32(-half), np.int32((self.shape[self.axis] << self.fraction_bits) - half)


def resolve(session: Session, frame: Frame, lists: CrossingLists, rule: Rule) -> CrossingLists:
    """Return the ends of the pieces that are inside by *rule*, within the box.

    Rows alternate between ends that go in and ends that go out, of increasing depth.
    """
    defines = {"RULE": int(rule)}
    arguments = *frame.box, lists.offsets, lists.depth, lists.side
    return make_rows(session, frame, "dexels/resolve_rows.cl", "resolve_rows", defines, arguments)


def combine(
    session: Session,
    frame: Frame,
    a: CrossingLists,
    b: CrossingLists,
    operation: Operation,
    renumbering: Sequence[tuple[int, int]] = (),
) -> CrossingLists:
    """Return the combination of two resolved sets of rows.

    renumbering: for each mesh of *b* its first triangle, and by how much the numbers of its
    triangles grow; none if they stay as they are.
    """
    arguments = *_moved(session, renumbering), *_rows(a), *_rows(b)
    defines = {"OP": int(operation)}
    return make_rows(session, frame, "dexels/combine_rows.cl", "combine_rows", defines, arguments)


def differ(session: Session, frame: Frame, a: CrossingLists, b: CrossingLists) -> bool:
    """Return whether two resolved sets of rows are different solids."""
    arguments = *_moved(session, ()), *_rows(a), *_rows(b)
    defines = {"OP": int(Operation.XOR)}
    made = _count(session, frame, "dexels/combine_rows.cl", "combine_rows", defines, arguments)
    return made[1] != 0


def complement(session: Session, frame: Frame, lists: CrossingLists) -> CrossingLists:
    """Return the box without the pieces of resolved rows."""
    arguments = *frame.box, *_rows(lists)
    defines = {"OP": int(Operation.DIFFERENCE)}
    return make_rows(
        session, frame, "dexels/combine_rows.cl", "complement_rows", defines, arguments
    )


def used_meshes(session: Session, lists: CrossingLists, starts: Sequence[int]) -> list[bool]:
    """Return for each mesh, given its first triangle, whether an end comes from it."""
    used = session.zeros(len(starts), np.uint32)
    if lists.count:
        kernel = session.kernel("dexels/renumber.cl", "mark_meshes", RUN=RUN)
        meshes = np.uint32(len(starts)), session.upload(np.array(starts, np.uint64))
        ends = np.uint64(lists.count)
        items = -(-lists.count // RUN)
        session.run(kernel, items, ends, *meshes, lists.side, used, steps=RUN)
    return [bool(mark) for mark in used.get().tolist()]


def renumber(
    session: Session, lists: CrossingLists, renumbering: Sequence[tuple[int, int]]
) -> None:
    """Give the triangles of *lists* other numbers, in place, as `combine` does."""
    if lists.count:
        kernel = session.kernel("dexels/renumber.cl", "renumber", RUN=RUN)
        ends = np.uint64(lists.count)
        items = -(-lists.count // RUN)
        meshes = _moved(session, renumbering)
        session.run(kernel, items, ends, *meshes, lists.side, steps=RUN)


def make_rows(
    session: Session,
    frame: Frame,
    file: str,
    name: str,
    defines: dict[str, int],
    arguments: tuple[Argument, ...],
) -> CrossingLists:
    """Count the ends of each ray, then write them."""
    offsets, count = _count(session, frame, file, name, defines, arguments)
    depth, side = session.empty(count, np.int32), session.empty(count, np.int32)
    if count:
        kernel = session.kernel(file, name, **defines, PASS=1)
        for span in launches(frame.rays):
            items = int(span[1] - span[0])
            session.run(kernel, items, *span, *arguments, offsets, depth, side)
    return CrossingLists(offsets, depth, side, frame.fraction_bits)


def _count(
    session: Session,
    frame: Frame,
    file: str,
    name: str,
    defines: dict[str, int],
    arguments: tuple[Argument, ...],
) -> tuple[cla.Array, int]:
    """Where the ends of each ray begin, and how many there are."""
    # One count more than there are rays, so that the last offset is the end of the last row.
    counts = session.zeros(frame.rays + 1, np.uint32)
    kernel = session.kernel(file, name, **defines, PASS=0)
    for span in launches(frame.rays):
        session.run(kernel, int(span[1] - span[0]), *span, *arguments, counts)
    return prefix_sum(session, counts, bits=64)


def _rows(lists: CrossingLists) -> tuple[Argument, ...]:
    return lists.offsets, lists.depth, lists.side


def _moved(session: Session, renumbering: Sequence[tuple[int, int]]) -> tuple[Argument, ...]:
    """Arguments `meshes`, `mesh_starts` and `moved`; unread entries if there are none."""
    pairs = list(renumbering) or [(0, 0)]
    starts = session.upload(np.array([start for start, _ in pairs], np.uint64))
    moved = session.upload(np.array([by for _, by in pairs], np.int32))
    return np.uint32(len(renumbering)), starts, moved


def launches(count: int) -> Iterator[tuple[np.uint64, np.uint64]]:
    """Cut [0, count) into spans, so that no launch takes long."""
    for first in range(0, count, RAYS_PER_LAUNCH):
        yield np.uint64(first), np.uint64(min(first + RAYS_PER_LAUNCH, count))
