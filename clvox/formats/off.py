"""OFF: a keyword, three counts, a line for each vertex, a line for each polygon."""

from __future__ import annotations

import io
import re
from array import array
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from clvox.errors import FormatError
from clvox.formats.common import Contents, Numbers, fans, shown

_KEYWORD = re.compile(rb"(ST)?(C)?(N)?OFF")
_COUNT = re.compile(rb"[0-9]{1,18}")


def read_off(data: bytes) -> Contents:
    """Return the triangles of an OFF file: its polygons as fans.

    Normals, colours and texture coordinates are passed over.
    """
    lines = _lines(data)
    number, words = _next(lines, "the keyword")
    keyword = _KEYWORD.fullmatch(words[0])
    if keyword is None:
        raise FormatError(
            f"no OFF file that clvox reads: it begins with {shown(words[0])}; expected OFF, "
            "or one of ST, C, N before it"
        )
    words = words[1:]
    if words[:1] == [b"BINARY"]:
        raise FormatError("the file is a binary OFF file; clvox reads those in text only")
    if not words:
        number, words = _next(lines, "the counts")
    if len(words) != 3 or not all(map(_COUNT.fullmatch, words)):
        raise FormatError(
            f"line {number}: {shown(b' '.join(words))} stands where the numbers of vertices, "
            "faces and edges should"
        )
    points, polygons = int(words[0]), int(words[1])
    if points + polygons > data.count(b"\n") + 1:
        raise FormatError(
            f"the header says {points} vertices and {polygons} faces, more than the rest of the "
            "file can hold; it was cut short, or a count is wrong"
        )
    if not polygons:
        raise FormatError("the file holds no faces")
    places, lengths = Numbers(), _lengths(keyword)
    for index in range(points):
        number, words = _next(lines, f"vertex {index} of {points}")
        if len(words) not in lengths:
            raise FormatError(
                f"line {number}: vertex {index} has {len(words)} numbers; in a file of the kind "
                f"{keyword[0].decode()} it has {' or '.join(map(str, lengths))}"
            )
        places.add(words[:3])
    faces = _fans(lines, polygons, points)
    number, words = next(lines, (0, []))
    if words:
        raise FormatError(
            f"line {number}: {shown(words[0])} follows the last face; a count is wrong, or "
            "something was added"
        )
    return Contents(places.array().reshape(-1, 3), faces)


def _lengths(keyword: re.Match[bytes]) -> list[int]:
    """How many numbers a vertex has: with a normal, a colour, texture coordinates."""
    texture, colour, normal = keyword.groups()
    least = 3 + 3 * bool(normal) + 2 * bool(texture)
    return [least + 3, least + 4] if colour else [least]


def _fans(
    lines: Iterator[tuple[int, list[bytes]]], polygons: int, points: int
) -> NDArray[np.int64]:
    counts, corners = array("q"), array("q")
    for index in range(polygons):
        number, words = _next(lines, f"face {index} of {polygons}")
        count = int(words[0]) if _COUNT.fullmatch(words[0]) else 0
        if count < 3:
            raise FormatError(
                f"line {number}: face {index} begins with {shown(words[0])}; expected the number "
                "of its vertices, 3 or more"
            )
        if len(words) <= count:
            raise FormatError(
                f"line {number}: face {index} is cut short: {len(words) - 1} of {count} vertices"
            )
        # A colour may follow.
        found = words[1 : count + 1]
        if not b"".join(found).isdigit() or max(map(len, found)) > 18:
            bad = next(word for word in found if not _COUNT.fullmatch(word))
            raise FormatError(f"line {number}: {shown(bad)} is no vertex of a face")
        corners.extend(map(int, found))
        counts.append(count)
    flat = np.array(corners, dtype=np.int64)
    if flat.max() >= points:
        raise FormatError(f"a face uses vertex {flat.max()}; the file holds {points}, from 0 on")
    return fans(flat, np.array(counts, dtype=np.int64))


def _lines(data: bytes) -> Iterator[tuple[int, list[bytes]]]:
    """The words of each line that has some, and its number."""
    for number, line in enumerate(io.BytesIO(data), start=1):
        words = line.partition(b"#")[0].split()
        if words:
            yield number, words


def _next(lines: Iterator[tuple[int, list[bytes]]], what: str) -> tuple[int, list[bytes]]:
    for found in lines:
        return found
    raise FormatError(f"the file ends where {what} should be; it was cut short")
