"""Read triangles from STL, OBJ and PLY files, none of which is trusted.

A size that a header claims is held against the length of the file before anything of that size
is allocated; what does not add up is refused and never repaired.  General readers are lenient
here, each in its own way, and a solid that was quietly mended is no longer the one in the file.
"""

from __future__ import annotations

import gzip
import re
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clvox.errors import FormatError

Arrays: TypeAlias = tuple[NDArray[np.float64], NDArray[np.int64]]
"""Vertices (n, 3) and faces (m, 3)."""

GZIP_FLOOR = 64 * 2**20
GZIP_RATIO = 100
"""A compressed file may expand to the floor, and beyond it by this ratio to its own length."""

_CHUNK = 2**22


def read(path: Path) -> Arrays:
    """Return the vertices and faces in the file at *path*; raise FormatError where it is none."""
    suffixes = [suffix.lower() for suffix in path.suffixes]
    packed = suffixes[-1:] == [".gz"]
    kind = "".join(suffixes[-2:-1] if packed else suffixes[-1:])
    reader = READERS.get(kind)
    if reader is None:
        names = ", ".join(name[1:].upper() for name in READERS)
        found = f"the suffix {''.join(suffixes[-2:] if packed else suffixes[-1:])!r}"
        if not suffixes:
            found = "no suffix"
        raise FormatError(f"cannot read a file with {found}; clvox reads {names}, also as .gz")
    data = _unpacked(path) if packed else path.read_bytes()
    if not data:
        raise FormatError("the file is empty")
    return reader(data)


def _unpacked(path: Path) -> bytes:
    limit = GZIP_FLOOR + GZIP_RATIO * path.stat().st_size
    parts = []
    total = 0
    try:
        with gzip.open(path) as stream:
            while part := stream.read(_CHUNK):
                total += len(part)
                if total > limit:
                    raise FormatError(
                        f"{path.stat().st_size} bytes expand to more than {limit}; meshes never "
                        "do. If this file is sound, unpack it first."
                    )
                parts.append(part)
    except (gzip.BadGzipFile, EOFError, zlib.error) as error:
        raise FormatError(f"the gzip data are damaged: {error}") from None
    return b"".join(parts)


def _shown(token: bytes) -> str:
    """A token of a file, fit to print."""
    text = token[:24].decode("ascii", "backslashreplace")
    return repr(text + "..." if len(token) > 24 else text)


def _floats(tokens: list[bytes]) -> NDArray[np.float64]:
    """The numbers that *tokens* spell; FormatError names the first that is none."""
    try:
        # Python reads 1_000 as a number; no file format does.
        if b"_" not in b" ".join(tokens):
            return np.array(list(map(float, tokens)), dtype=np.float64)
    except ValueError:
        pass
    bad = next(token for token in tokens if not _is_number(token))
    raise FormatError(f"{_shown(bad)} stands where a number should")


def _is_number(token: bytes) -> bool:
    try:
        float(token)
    except ValueError:
        return False
    return b"_" not in token


# --- STL ----------------------------------------------------------------------------------------

_STL = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_STL_HEADER = 84

_STL_NAME = re.compile(rb"^[ \t]*(?:end[ \t]*)?solid\b[^\r\n]*", re.MULTILINE | re.IGNORECASE)
_STL_WORDS = {
    0: b"facet", 1: b"normal", 5: b"outer", 6: b"loop", 7: b"vertex", 11: b"vertex",
    15: b"vertex", 19: b"endloop", 20: b"endfacet",
}  # fmt: skip
_STL_TOKENS = 21


def _read_stl(data: bytes) -> Arrays:
    count = int.from_bytes(data[80:_STL_HEADER], "little")
    # Many binary files begin with "solid", too, so the length decides and not the first word.
    if len(data) >= _STL_HEADER and len(data) == _STL_HEADER + count * _STL.itemsize:
        corners = np.frombuffer(data, _STL, offset=_STL_HEADER)["corners"]
        with np.errstate(invalid="ignore"):  # a signalling NaN
            return _soup(corners.astype(np.float64))
    text = data.lstrip()
    if text[:5].lower() == b"solid" and b"\0" not in text[:1024]:
        return _read_ascii_stl(text)
    if len(data) < _STL_HEADER:
        raise FormatError(
            f"no STL file: it has {len(data)} bytes and does not begin with 'solid'; "
            f"a binary one has at least {_STL_HEADER}"
        )
    raise FormatError(
        f"no sound STL file: its header says {count} triangles, which take "
        f"{_STL_HEADER + count * _STL.itemsize} bytes, but it has {len(data)}. "
        "It was cut short, or bytes were added."
    )


def _read_ascii_stl(text: bytes) -> Arrays:
    if b"\n" not in text:
        text = text.replace(b"\r", b"\n")
    last = text[text.rstrip().rfind(b"\n") + 1 :]
    if not _STL_NAME.match(last) or last.split()[0].lower()[:3] != b"end":
        raise FormatError("the file does not end with 'endsolid'; it was cut short")
    body = _STL_NAME.sub(b"", text).lower()
    parts: list[NDArray[np.float64]] = []
    start = 0
    while start < len(body):
        # Tokens take far more memory than text: split a piece at a time, at the end of a facet.
        stop = body.find(b"endfacet", start + _CHUNK)
        stop = len(body) if stop < 0 else stop + len(b"endfacet")
        parts.append(_facets(body[start:stop].split(), sum(len(part) for part in parts)))
        start = stop
    return _soup(np.concatenate(parts) if parts else np.empty((0, 3, 3)))


def _facets(tokens: list[bytes], before: int) -> NDArray[np.float64]:
    """The corners of the facets that *tokens* spell, the first of them number *before*."""
    for place, word in _STL_WORDS.items():
        found = tokens[place::_STL_TOKENS]
        if found.count(word) != len(found) or len(tokens) % _STL_TOKENS:
            _refuse_facet(tokens, before)
    axes = [_floats(tokens[place::_STL_TOKENS]) for place in (8, 9, 10, 12, 13, 14, 16, 17, 18)]
    return np.stack(axes, axis=1).reshape(-1, 3, 3)


def _refuse_facet(tokens: list[bytes], before: int) -> None:
    for index, token in enumerate(tokens):
        row, place = divmod(index, _STL_TOKENS)
        word = _STL_WORDS.get(place)
        if word is not None and token != word:
            raise FormatError(
                f"triangle {before + row} is malformed: {_shown(token)} stands where "
                f"'{word.decode()}' should; each has exactly three vertices of three numbers"
            )
    raise FormatError(f"triangle {before + len(tokens) // _STL_TOKENS} is cut short")


def _soup(corners: NDArray[np.float64]) -> Arrays:
    if not len(corners):
        raise FormatError("the file holds no triangles")
    vertices = corners.reshape(-1, 3)
    return vertices, np.arange(len(vertices)).reshape(-1, 3)


# --- OBJ ----------------------------------------------------------------------------------------


def _read_obj(data: bytes) -> Arrays:
    if b"\0" in data[:1024]:
        raise FormatError("no OBJ file: it is binary")
    places: list[bytes] = []
    counts: list[int] = []
    corners: list[int] = []
    triangles = True
    for number, line in enumerate(
        data.replace(b"\\\n", b" ").replace(b"\\\r\n", b" ").split(b"\n")
    ):
        words = line.split()
        if not words:
            continue
        if words[0] == b"v":
            if len(words) < 4:
                raise FormatError(f"line {number + 1}: a vertex needs three coordinates")
            # A weight or a colour may follow.
            places += words[1:4]
        elif words[0] == b"f":
            if len(words) < 4:
                raise FormatError(f"line {number + 1}: a face needs at least three vertices")
            triangles &= len(words) == 4
            counts.append(len(words) - 1)
            corners += _obj_corners(words[1:], len(places) // 3, number + 1)
    if not counts:
        raise FormatError("the file holds no faces")
    vertices = _floats(places).reshape(-1, 3)
    flat = np.array(corners, dtype=np.int64)
    if flat.max() >= len(vertices):
        raise FormatError(f"a face uses vertex {flat.max() + 1} of {len(vertices)}")
    return vertices, flat.reshape(-1, 3) if triangles else _fans(flat, np.array(counts))


def _obj_corners(words: list[bytes], known: int, line: int) -> list[int]:
    """The vertices, from 0, of a face in *line*, with *known* vertices before it."""
    found = []
    for word in words:
        head = word.partition(b"/")[0]
        digits = head[1:] if head[:1] == b"-" else head
        # 18 digits fit into an int64.
        if not digits.isdigit() or len(digits) > 18:
            raise FormatError(f"line {line}: {_shown(word)} is no vertex of a face")
        index = int(head)
        if index == 0 or index < -known:
            raise FormatError(
                f"line {line}: {index} is no vertex; they count from 1, or from -1 backwards, "
                f"and {known} came before"
            )
        found.append(index - 1 if index > 0 else known + index)
    return found


def _fans(corners: NDArray[np.int64], counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """Polygons of *counts* corners each, cut into triangles that share their first corner.

    The boundary of a fan is its polygon's, so a closed surface stays closed; where a flat
    polygon is not convex, the parts of the fan outside of it cover each other twice.
    """
    starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
    polygon = np.repeat(np.arange(len(counts)), counts - 2)
    begins = np.cumsum(counts - 2) - (counts - 2)
    step = np.arange(len(polygon)) - begins[polygon]
    first = starts[polygon]
    fans: NDArray[np.int64] = corners[np.stack([first, first + step + 1, first + step + 2], axis=1)]
    return fans


# --- PLY ----------------------------------------------------------------------------------------

_PLY_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2",
    "ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
_PLY_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_PLY_FACES = ("vertex_indices", "vertex_index")
_PLY_HEADER = 2**16
"""Longest header."""

_PLY_UNIFORM = 64
"""Lists up to this length are read at once, if all of them are as long as the first."""

Column: TypeAlias = tuple[NDArray[Any], NDArray[np.int64]]
"""The values of a property, row after row, and how many of them each row has."""


@dataclass
class _Property:
    name: str
    kind: str
    length: str | None
    """Type of the number that stands before a list; None for a single value."""


@dataclass
class _Element:
    name: str
    count: int
    properties: list[_Property]


@dataclass
class _Bytes:
    """The body of a binary PLY file, read from *at* on."""

    data: bytes
    order: str
    at: int

    def holds(self, columns: list[tuple[str, int]], rows: int) -> bool:
        """Whether so many rows are left, with *count* values of *kind* in each column."""
        size = rows * sum(int(kind[1]) * count for kind, count in columns)
        return size <= len(self.data) - self.at

    def take(self, kind: str, count: int) -> NDArray[Any]:
        """Return the next *count* values."""
        if not self.holds([(kind, count)], 1):
            raise FormatError(_CUT)
        values = np.frombuffer(self.data, self.order + kind, count, self.at)
        self.at += values.nbytes
        return values

    def table(self, columns: list[tuple[str, int]], rows: int) -> list[NDArray[Any]]:
        """Return the next rows: an array (rows, count) for each column."""
        fields = [(str(i), self.order + kind, (count,)) for i, (kind, count) in enumerate(columns)]
        table = np.frombuffer(self.data, np.dtype(fields), rows, self.at)
        self.at += table.nbytes
        return [table[name] for name, _, _ in fields]


@dataclass
class _Numbers:
    """The body of an ASCII PLY file, as the numbers in it, read from *at* on."""

    values: NDArray[np.float64]
    at: int = 0

    def holds(self, columns: list[tuple[str, int]], rows: int) -> bool:
        """Whether so many rows are left, with *count* values in each column."""
        return rows * sum(count for _, count in columns) <= len(self.values) - self.at

    def take(self, kind: str, count: int) -> NDArray[Any]:
        """Return the next *count* values."""
        if not self.holds([(kind, count)], 1):
            raise FormatError(_CUT)
        self.at += count
        return self.values[self.at - count : self.at]

    def table(self, columns: list[tuple[str, int]], rows: int) -> list[NDArray[Any]]:
        """Return the next rows: an array (rows, count) for each column."""
        ends = list(accumulate(count for _, count in columns))
        table = self.take("", rows * ends[-1]).reshape(rows, ends[-1])
        return np.split(table, ends[:-1], axis=1)


_CUT = "the file is shorter than its header says; it was cut short, or a count is wrong"


def _read_ply(data: bytes) -> Arrays:
    order, elements, start = _ply_header(data)
    source = _Bytes(data, order, start) if order else _Numbers(_all_numbers(data[start:]))
    vertices = faces = None
    for element in elements:
        names = [one.name for one in element.properties]
        if element.name == "vertex":
            if not {"x", "y", "z"} <= set(names):
                raise FormatError(f"vertices need x, y and z; the header says {', '.join(names)}")
            columns = dict(zip(names, _ply_rows(source, element), strict=True))
            with np.errstate(invalid="ignore"):
                axes = [columns[axis][0].astype(np.float64) for axis in "xyz"]
            vertices = np.stack(axes, axis=1)
        elif element.name == "face":
            columns = dict(zip(names, _ply_rows(source, element), strict=True))
            lists = [columns[name] for name in _PLY_FACES if name in columns]
            if not lists:
                raise FormatError("faces need a list vertex_indices; the header has none")
            faces = lists[0]
        elif element.properties:
            _ply_rows(source, element)
    if vertices is None or faces is None or not len(faces[1]):
        raise FormatError("the file holds no faces")
    return vertices, _ply_triangles(*faces, len(vertices))


def _ply_header(data: bytes) -> tuple[str, list[_Element], int]:
    """The byte order (none for ASCII), the elements, and where the body begins."""
    first = re.match(rb"ply[ \t]*\r?\n", data)
    last = re.compile(rb"^end_header[ \t]*\r?\n", re.MULTILINE).search(data[:_PLY_HEADER])
    if first is None or last is None:
        raise FormatError("no PLY file: it does not begin with 'ply' and a header")
    order: str | None = None
    elements: list[_Element] = []
    for line in data[first.end() : last.start()].decode("latin-1").split("\n"):
        match line.split():
            case [] | ["comment" | "obj_info", *_]:
                pass
            case ["format", name, "1.0"] if name in _PLY_ORDERS:
                order = _PLY_ORDERS[name]
            case ["element", name, count] if re.fullmatch("[0-9]{1,18}", count):
                elements.append(_Element(name, int(count), []))
            case ["property", kind, name] if elements and kind in _PLY_TYPES:
                elements[-1].properties.append(_Property(name, _PLY_TYPES[kind], None))
            case ["property", "list", length, kind, name] if (
                elements and kind in _PLY_TYPES and _PLY_TYPES.get(length, "f")[0] in "iu"
            ):
                one = _Property(name, _PLY_TYPES[kind], _PLY_TYPES[length])
                elements[-1].properties.append(one)
            case _:
                shown = _shown(line.encode("latin-1"))
                raise FormatError(f"the PLY header has a line that means nothing: {shown}")
    if order is None:
        raise FormatError("the PLY header names no format")
    groups = [[one.name for one in element.properties] for element in elements]
    for names in (*groups, [element.name for element in elements]):
        if len(set(names)) < len(names):
            raise FormatError(f"the PLY header names something twice: {', '.join(names)[:60]}")
    return order, elements, last.end()


def _all_numbers(body: bytes) -> NDArray[np.float64]:
    parts = [np.empty(0)]
    start = 0
    while start < len(body):
        stop = body.find(b"\n", start + _CHUNK) + 1 or len(body)
        parts.append(_floats(body[start:stop].split()))
        start = stop
    return np.concatenate(parts)


def _ply_rows(source: _Bytes | _Numbers, element: _Element) -> list[Column]:
    """Return the values of each property, row after row, and how many each row has."""
    if not element.count:
        return [(np.empty(0), np.empty(0, np.int64)) for _ in element.properties]
    start = source.at
    columns: list[tuple[str, int]] = []
    least: list[tuple[str, int]] = []
    for one in element.properties:
        count = 1
        if one.length is not None:
            count = _ply_length(source.take(one.length, 1))
            columns.append((one.length, 1))
        columns.append((one.kind, count))
        least.append((one.kind, 1) if one.length is None else (one.length, 1))
        source.take(one.kind, count)
    source.at = start
    if not source.holds(least, element.count):
        raise FormatError(
            f"the header says {element.count} rows of {element.name}, more than the rest of the "
            "file can hold; it was cut short, or the count is wrong"
        )
    if max(count for _, count in columns) <= _PLY_UNIFORM and source.holds(columns, element.count):
        found = _ply_uniform(source, element, columns)
        if found is not None:
            return found
    return _ply_mixed(source, element)


def _ply_uniform(
    source: _Bytes | _Numbers, element: _Element, columns: list[tuple[str, int]]
) -> list[Column] | None:
    """All rows at once; None, and nothing read, if some list has another length."""
    start = source.at
    arrays = iter(source.table(columns, element.count))
    found: list[Column] = []
    for one in element.properties:
        lengths = None if one.length is None else next(arrays)
        values = next(arrays)
        if lengths is not None and (lengths != values.shape[1]).any():
            source.at = start
            return None
        found.append((values.reshape(-1), np.full(element.count, values.shape[1])))
    return found


def _ply_mixed(source: _Bytes | _Numbers, element: _Element) -> list[Column]:
    """Row by row."""
    values: list[list[NDArray[Any]]] = [[] for _ in element.properties]
    for _ in range(element.count):
        for one, column in zip(element.properties, values, strict=True):
            count = 1 if one.length is None else _ply_length(source.take(one.length, 1))
            column.append(source.take(one.kind, count))
    return [(np.concatenate(column), np.array(list(map(len, column)))) for column in values]


def _ply_length(value: NDArray[Any]) -> int:
    length = float(value[0])
    if not (length >= 0 and length.is_integer()):
        raise FormatError(f"a list in the file has the length {length:g}")
    return int(length)


def _ply_triangles(
    values: NDArray[Any], counts: NDArray[np.int64], vertices: int
) -> NDArray[np.int64]:
    if counts.min() < 3:
        raise FormatError(f"face {counts.argmin()} has {counts.min()} vertices")
    # In this form a NaN, which an ASCII file can hold, is out of range as well.
    bad = ~((values >= 0) & (values < vertices)) | (values != np.trunc(values))
    if bad.any():
        raise FormatError(
            f"a face uses vertex {values[bad.argmax()]:g}; the file holds {vertices}, from 0 on"
        )
    corners = values.astype(np.int64)
    return corners.reshape(-1, 3) if counts.max() == 3 else _fans(corners, counts)


READERS: dict[str, Callable[[bytes], Arrays]] = {
    ".stl": _read_stl,
    ".obj": _read_obj,
    ".ply": _read_ply,
}
"""What turns the bytes of a file into arrays, by suffix."""
