"""OBJ: its objects and groups as one mesh."""

from __future__ import annotations

import io
from array import array

import numpy as np

from clvox.errors import FormatError
from clvox.formats.common import Contents, Numbers, fans, shown


def read_obj(data: bytes) -> Contents:
    """Return the triangles of an OBJ file: its polygons as fans."""
    if b"\0" in data[:1024]:
        raise FormatError("no OBJ file: it is binary")
    places, known = Numbers(), 0
    counts, corners = array("q"), array("q")
    whole = data.replace(b"\\\n", b" ").replace(b"\\\r\n", b" ")
    for number, line in enumerate(io.BytesIO(whole), start=1):
        words = line.split()
        if not words:
            continue
        if words[0] == b"v":
            if len(words) < 4:
                raise FormatError(f"line {number}: a vertex needs three coordinates")
            # A weight or a colour may follow.
            places.add(words[1:4])
            known += 1
        elif words[0] == b"f":
            if len(words) < 4:
                raise FormatError(f"line {number}: a face needs at least three vertices")
            counts.append(len(words) - 1)
            corners.extend(_corners(words[1:], known, number))
    if not counts:
        raise FormatError("the file holds no faces")
    vertices = places.array().reshape(-1, 3)
    flat = np.array(corners, dtype=np.int64)
    if flat.max() >= len(vertices):
        raise FormatError(f"a face uses vertex {flat.max() + 1} of {len(vertices)}")
    return Contents(vertices, fans(flat, np.array(counts, dtype=np.int64)))


def _corners(words: list[bytes], known: int, line: int) -> list[int]:
    """The vertices, from 0, of a face in *line*, with *known* vertices before it."""
    found = []
    for word in words:
        head = word.partition(b"/")[0]
        digits = head[1:] if head[:1] == b"-" else head
        # 18 digits fit into an int64.
        if not digits.isdigit() or len(digits) > 18:
            raise FormatError(f"line {line}: {shown(word)} is no vertex of a face")
        index = int(head)
        if index == 0 or index < -known:
            raise FormatError(
                f"line {line}: {index} is no vertex; they count from 1, or from -1 backwards, "
                f"and {known} came before"
            )
        found.append(index - 1 if index > 0 else known + index)
    return found
