"""PLY, binary and ASCII: elements of properties, as the header says."""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import accumulate
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clvox.errors import FormatError
from clvox.formats.common import CHUNK, Contents, fans, floats, shown

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2",
    "ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_FACES = ("vertex_indices", "vertex_index")
_HEADER = 2**16
"""Longest header."""

_UNIFORM = 64
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


def read_ply(data: bytes) -> Contents:
    """Return the triangles of a PLY file: its polygons as fans."""
    order, elements, start = _header(data)
    source = _Bytes(data, order, start) if order else _Numbers(_all_numbers(data[start:]))
    vertices = faces = None
    for element in elements:
        names = [one.name for one in element.properties]
        if element.name == "vertex":
            if not {"x", "y", "z"} <= set(names):
                raise FormatError(f"vertices need x, y and z; the header says {', '.join(names)}")
            columns = dict(zip(names, _rows(source, element), strict=True))
            with np.errstate(invalid="ignore"):
                axes = [columns[axis][0].astype(np.float64) for axis in "xyz"]
            vertices = np.stack(axes, axis=1)
        elif element.name == "face":
            columns = dict(zip(names, _rows(source, element), strict=True))
            lists = [columns[name] for name in _FACES if name in columns]
            if not lists:
                raise FormatError("faces need a list vertex_indices; the header has none")
            faces = lists[0]
        elif element.properties:
            _rows(source, element)
    if vertices is None or faces is None or not len(faces[1]):
        raise FormatError("the file holds no faces")
    return Contents(vertices, _triangles(*faces, len(vertices)))


def _header(data: bytes) -> tuple[str, list[_Element], int]:
    """The byte order (none for ASCII), the elements, and where the body begins."""
    first = re.match(rb"ply[ \t]*\r?\n", data)
    last = re.compile(rb"^end_header[ \t]*\r?\n", re.MULTILINE).search(data[:_HEADER])
    if first is None or last is None:
        raise FormatError("no PLY file: it does not begin with 'ply' and a header")
    order: str | None = None
    elements: list[_Element] = []
    for line in data[first.end() : last.start()].decode("latin-1").split("\n"):
        match line.split():
            case [] | ["comment" | "obj_info", *_]:
                pass
            case ["format", name, "1.0"] if name in _ORDERS:
                order = _ORDERS[name]
            case ["element", name, count] if re.fullmatch("[0-9]{1,18}", count):
                elements.append(_Element(name, int(count), []))
            case ["property", kind, name] if elements and kind in _TYPES:
                elements[-1].properties.append(_Property(name, _TYPES[kind], None))
            case ["property", "list", length, kind, name] if (
                elements and kind in _TYPES and _TYPES.get(length, "f")[0] in "iu"
            ):
                one = _Property(name, _TYPES[kind], _TYPES[length])
                elements[-1].properties.append(one)
            case _:
                words = shown(line.encode("latin-1"))
                raise FormatError(f"the PLY header has a line that means nothing: {words}")
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
        stop = body.find(b"\n", start + CHUNK) + 1 or len(body)
        parts.append(floats(body[start:stop].split()))
        start = stop
    return np.concatenate(parts)


def _rows(source: _Bytes | _Numbers, element: _Element) -> list[Column]:
    """Return the values of each property, row after row, and how many each row has."""
    if not element.count:
        return [(np.empty(0), np.empty(0, np.int64)) for _ in element.properties]
    start = source.at
    columns: list[tuple[str, int]] = []
    least: list[tuple[str, int]] = []
    for one in element.properties:
        count = 1
        if one.length is not None:
            count = _length(source.take(one.length, 1))
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
    if max(count for _, count in columns) <= _UNIFORM and source.holds(columns, element.count):
        found = _uniform(source, element, columns)
        if found is not None:
            return found
    return _mixed(source, element)


def _uniform(
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


def _mixed(source: _Bytes | _Numbers, element: _Element) -> list[Column]:
    """Row by row."""
    values: list[list[NDArray[Any]]] = [[] for _ in element.properties]
    for _ in range(element.count):
        for one, column in zip(element.properties, values, strict=True):
            count = 1 if one.length is None else _length(source.take(one.length, 1))
            column.append(source.take(one.kind, count))
    return [(np.concatenate(column), np.array(list(map(len, column)))) for column in values]


def _length(value: NDArray[Any]) -> int:
    length = float(value[0])
    if not (length >= 0 and length.is_integer()):
        raise FormatError(f"a list in the file has the length {length:g}")
    return int(length)


def _triangles(values: NDArray[Any], counts: NDArray[np.int64], vertices: int) -> NDArray[np.int64]:
    if counts.min() < 3:
        raise FormatError(f"face {counts.argmin()} has {counts.min()} vertices")
    # In this form a NaN, which an ASCII file can hold, is out of range as well.
    bad = ~((values >= 0) & (values < vertices)) | (values != np.trunc(values))
    if bad.any():
        raise FormatError(
            f"a face uses vertex {values[bad.argmax()]:g}; the file holds {vertices}, from 0 on"
        )
    return fans(values.astype(np.int64), counts)
