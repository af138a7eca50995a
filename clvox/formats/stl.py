"""STL, binary and ASCII."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from clvox.errors import FormatError
from clvox.formats.common import CHUNK, Contents, floats, shown

_STL = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_STL_HEADER = 84

_STL_NAME = re.compile(rb"^[ \t]*(?:end[ \t]*)?solid\b[^\r\n]*", re.MULTILINE | re.IGNORECASE)
_STL_WORDS = {
    0: b"facet", 1: b"normal", 5: b"outer", 6: b"loop", 7: b"vertex", 11: b"vertex",
    15: b"vertex", 19: b"endloop", 20: b"endfacet",
}  # fmt: skip
_STL_TOKENS = 21


def read_stl(data: bytes) -> Contents:
    """Return the triangles of an STL file, three vertices each."""
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


def _read_ascii_stl(text: bytes) -> Contents:
    if b"\n" not in text:
        text = text.replace(b"\r", b"\n")
    last = text[text.rstrip().rfind(b"\n") + 1 :]
    if not _STL_NAME.match(last) or last.split()[0].lower()[:3] != b"end":
        raise FormatError("the file does not end with 'endsolid'; it was cut short")
    body = _STL_NAME.sub(b"", text).lower()
    parts: list[NDArray[np.float64]] = []
    count = start = 0
    while start < len(body):
        # Tokens take far more memory than text: split a piece at a time, at the end of a facet.
        stop = body.find(b"endfacet", start + CHUNK)
        stop = len(body) if stop < 0 else stop + len(b"endfacet")
        parts.append(_facets(body[start:stop].split(), count))
        count += len(parts[-1])
        start = stop
    return _soup(np.concatenate(parts) if parts else np.empty((0, 3, 3)))


def _facets(tokens: list[bytes], before: int) -> NDArray[np.float64]:
    """The corners of the facets that *tokens* spell, the first of them number *before*."""
    for place, word in _STL_WORDS.items():
        found = tokens[place::_STL_TOKENS]
        if found.count(word) != len(found) or len(tokens) % _STL_TOKENS:
            _refuse_facet(tokens, before)
    axes = [floats(tokens[place::_STL_TOKENS]) for place in (8, 9, 10, 12, 13, 14, 16, 17, 18)]
    return np.stack(axes, axis=1).reshape(-1, 3, 3)


def _refuse_facet(tokens: list[bytes], before: int) -> None:
    for index, token in enumerate(tokens):
        row, place = divmod(index, _STL_TOKENS)
        word = _STL_WORDS.get(place)
        if word is not None and token != word:
            raise FormatError(
                f"triangle {before + row} is malformed: {shown(token)} stands where "
                f"'{word.decode()}' should; each has exactly three vertices of three numbers"
            )
    raise FormatError(f"triangle {before + len(tokens) // _STL_TOKENS} is cut short")


def _soup(corners: NDArray[np.float64]) -> Contents:
    if not len(corners):
        raise FormatError("the file holds no triangles")
    vertices = corners.reshape(-1, 3)
    return Contents(vertices, np.arange(len(vertices)).reshape(-1, 3))
