"""The pixels of a picture that are worth more rays: `cl_kernels/raymarch/choose.cl`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pyopencl.array as cla

from clvox.device import Session
from clvox.ops.beams import Beams
from clvox.ops.layout import int2

_CHOOSE = "raymarch/choose.cl"

TILE = 4
"""Pixels along the side of a tile, if it is not known which tiles show nothing."""


@dataclass(frozen=True)
class Chosen:
    """Some pixels of a picture: *count* of `numbers`, uint32, from entry *first* on."""

    numbers: cla.Array
    first: int
    count: int


def choose_pixels(
    session: Session, canvas: cla.Array, least: int, beams: Beams | None = None, rounds: int = 0
) -> Iterator[Chosen]:
    """Yield the pixels that differ from one of the eight around them by *least* or more in a byte.

    Then, up to *rounds* times, those of others that differ so from one that was yielded last: they
    have been drawn again until then.  In no particular order, none of them twice.

    canvas: (rows, columns, 4) uint8.  beams: where they meet nothing no pixel is chosen at first.
    """
    rows, columns, _ = canvas.shape
    size, listed = int2(columns, rows), session.zeros(1, np.uint32)
    numbers = session.empty(rows * columns, np.uint32)
    marks = session.zeros(-(-rows * columns // 32), np.uint32)
    tile = TILE if beams is None else beams.tile
    defines = {"TILE": tile, "STARTS": int(beams is not None)}
    starts = marks if beams is None else beams.starts
    kernel = session.kernel(_CHOOSE, "choose", **defines)
    found = marks, listed, numbers
    items = -(-rows // tile) * -(-columns // tile)
    session.run(kernel, items, size, np.uint32(least), starts, canvas, *found, steps=2 * tile**2)
    first, last = 0, int(listed.get()[0])
    while first < last:
        yield Chosen(numbers, first, last - first)
        if rounds == 0:
            return
        rounds -= 1
        kernel = session.kernel(_CHOOSE, "choose_beside", **defines)
        some = np.uint32(first), np.uint32(last - first)
        session.run(kernel, last - first, *some, size, np.uint32(least), canvas, *found, steps=9)
        first, last = last, int(listed.get()[0])
