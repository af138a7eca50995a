"""What the readers share: the result, numbers in text, polygons, and the limits on expansion."""

from __future__ import annotations

import gzip
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from clvox.errors import FormatError

UNPACKED_FLOOR = 2**24
UNPACKED_RATIO = 50
"""Compressed data may expand to the floor, and beyond it by this ratio to the file's length."""

PLACED_FLOOR = 2**26
PLACED_RATIO = 100
"""The same for bodies that a file draws many times, in bytes of their arrays."""

CHUNK = 2**22
"""Bytes that are worked on at a time: split into words they take many times their length."""


_MANY = 2**16
"""Words that are kept as such."""


@dataclass(frozen=True)
class Contents:
    """What a file holds.

    Attributes
    ----------
    vertices : (n, 3) float64
    faces : (m, 3) int64
    bodies : (m,) int32 or None
        The number of the body that each triangle belongs to, from 0 on; None for a format
        without bodies.
    units : str or None
        What a length of 1 means, in the singular; None if the file does not say.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    bodies: NDArray[np.int32] | None = None
    units: str | None = None


@dataclass
class Body:
    """One body among several: a mesh where it is placed."""

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]


def moved(body: Body, turn: NDArray[np.float64], shift: NDArray[np.float64]) -> Body:
    """Return *body* with its vertices at ``v @ turn + shift``.

    A mirror image has its triangles turned round, so that its outside stays outside.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        vertices = body.vertices @ turn + shift
        mirrored = np.linalg.det(turn) < 0
    return Body(vertices, body.faces[:, ::-1] if mirrored else body.faces)


def joined(bodies: Sequence[Body], units: str) -> Contents:
    """Return several bodies as one mesh."""
    if not sum(len(body.faces) for body in bodies):
        raise FormatError("the file holds no triangles")
    counts = [len(body.vertices) for body in bodies]
    shifts = np.cumsum([0, *counts[:-1]])
    faces = [body.faces + shift for body, shift in zip(bodies, shifts, strict=True)]
    sizes = [len(body.faces) for body in bodies]
    return Contents(
        np.concatenate([body.vertices for body in bodies]),
        np.concatenate(faces),
        np.repeat(np.arange(len(bodies), dtype=np.int32), sizes),
        units,
    )


@dataclass
class Budget:
    """The bytes that the bodies of a file may take."""

    length: int
    spent: int = 0

    def spend(self, nbytes: int) -> None:
        """Refuse a file whose bodies take more than they may."""
        self.spent += nbytes
        limit = PLACED_FLOOR + PLACED_RATIO * self.length
        if self.spent > limit:
            raise FormatError(
                f"the bodies of this file of {self.length} bytes take more than {limit}, because "
                "they are repeated. If it is sound, convert it first."
            )


def unpacked_limit(length: int) -> int:
    """Return the bytes that a compressed file of *length* bytes may expand to."""
    return UNPACKED_FLOOR + UNPACKED_RATIO * length


def unpacked(path: Path) -> bytes:
    """Return what a gzip file holds."""
    length = path.stat().st_size
    limit = unpacked_limit(length)
    parts = []
    total = 0
    try:
        with gzip.open(path) as stream:
            while part := stream.read(CHUNK):
                total += len(part)
                if total > limit:
                    raise FormatError(
                        f"{length} bytes expand to more than {limit}; meshes never do. If this "
                        "file is sound, unpack it first."
                    )
                parts.append(part)
    except (gzip.BadGzipFile, EOFError, zlib.error) as error:
        raise FormatError(f"the gzip data are damaged: {error}") from None
    return b"".join(parts)


def shown(token: bytes | str) -> str:
    """A piece of a file, fit to print."""
    if isinstance(token, str):
        token = token[:25].encode("utf-8", "surrogatepass")
    text = token[:24].decode("ascii", "backslashreplace")
    return repr(text + "..." if len(token) > 24 else text)


def floats(tokens: Sequence[bytes]) -> NDArray[np.float64]:
    """The numbers that *tokens* spell; FormatError names the first that is none."""
    try:
        # Python reads 1_000 as a number; no file format does.
        if b"_" not in b" ".join(tokens):
            return np.array(list(map(float, tokens)), dtype=np.float64)
    except ValueError:
        pass
    bad = next(token for token in tokens if not _is_number(token))
    raise FormatError(f"{shown(bad)} stands where a number should")


def _is_number(token: bytes) -> bool:
    try:
        float(token)
    except ValueError:
        return False
    return b"_" not in token


class Numbers:
    """Numbers as words of a file, turned into arrays before they are many."""

    def __init__(self) -> None:
        self._words: list[bytes] = []
        self._parts = [np.empty(0)]

    def add(self, words: Sequence[bytes]) -> None:
        """Append the numbers that *words* spell."""
        self._words += words
        if len(self._words) > _MANY:
            self._convert()

    def array(self) -> NDArray[np.float64]:
        """Return all of them, one after another."""
        self._convert()
        return np.concatenate(self._parts)

    def _convert(self) -> None:
        self._parts.append(floats(self._words))
        self._words = []


def fans(corners: NDArray[np.int64], counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """Polygons of *counts* corners each, cut into triangles that share their first corner.

    The boundary of a fan is its polygon's, so a closed surface stays closed; where a flat
    polygon is not convex, the parts of the fan outside of it cover each other twice.
    """
    if counts.max() == 3:
        return corners.reshape(-1, 3)
    starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
    polygon = np.repeat(np.arange(len(counts)), counts - 2)
    begins = np.cumsum(counts - 2) - (counts - 2)
    step = np.arange(len(polygon)) - begins[polygon]
    first = starts[polygon]
    found: NDArray[np.int64] = corners[
        np.stack([first, first + step + 1, first + step + 2], axis=1)
    ]
    return found
