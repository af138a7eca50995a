"""Whatever is changed in a sound file: a mesh comes back, or one of our errors, before long."""

from __future__ import annotations

import contextlib
import gzip
import re
import struct
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from clvox.errors import ClvoxError
from clvox.mesh import load
from tests import mesh_files

ROUNDS = 150
MOST = 2**24
"""Bytes of memory that such small files may take."""

STL = bytes(80) + struct.pack("<I", 4)
for _sides in mesh_files.SIDES:
    _corners = [mesh_files.TETRAHEDRON[i] for i in _sides]
    STL += struct.pack("<12fH", 0, 0, 1, *(x for corner in _corners for x in corner), 0)
ASCII_STL = "solid a\n" + "".join(
    "facet normal 0 0 1\nouter loop\n"
    + "".join("vertex {} {} {}\n".format(*mesh_files.TETRAHEDRON[i]) for i in side)
    + "endloop\nendfacet\n"
    for side in mesh_files.SIDES
) + "endsolid a\n"  # fmt: skip
OBJ = "".join("v {} {} {}\n".format(*point) for point in mesh_files.TETRAHEDRON) + "".join(
    f"f {a + 1}/1 {b + 1} {c - 4}\n" for a, b, c in mesh_files.SIDES
)
PLY = (
    "ply\nformat {} 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 4\nproperty list uchar int vertex_indices\nend_header\n"
)
ASCII_PLY = PLY.format("ascii") + mesh_files.OFF.partition("4 4 6\n")[2]
BINARY_PLY = PLY.format("binary_little_endian").encode() + mesh_files.POINTS
for _sides in mesh_files.SIDES:
    BINARY_PLY += struct.pack("<B3i", 3, *_sides)

SOUND: dict[str, bytes] = {
    "a.stl": STL,
    "ascii.stl": ASCII_STL.encode(),
    "a.obj": OBJ.encode(),
    "a.ply": BINARY_PLY,
    "ascii.ply": ASCII_PLY.encode(),
    "a.off": mesh_files.OFF.encode(),
    "a.glb": mesh_files.glb(
        nodes=[{"children": [1, 2], "scale": [2, 1, 1]}, {"mesh": 0}, {"mesh": 0}]
    ),
    "a.gltf": mesh_files.gltf(),
    "a.3mf": mesh_files.threemf(),
}
MODEL = mesh_files.model(
    mesh_files.thing(1) + mesh_files.thing(2, '<components><component objectid="1"/></components>'),
    '<item objectid="2" transform="1 0 0 0 1 0 0 0 1 5 5 5"/><item objectid="1"/>',
).encode()

NUMBER = re.compile(rb"-?[0-9]+(\.[0-9]+)?")
STRANGE = [b"-1", b"0", b"1e999", b"nan", b"4294967296", b"9" * 30, b"9" * 5000, b"", b"0.5", b"7"]


def garbled(data: bytes, rng: np.random.Generator) -> bytes:
    """Return *data* with a few bytes flipped, cut, repeated or put in, or numbers replaced."""
    found = bytearray(data)
    for _ in range(rng.integers(1, 4)):
        at = int(rng.integers(len(found) + 1))
        length = int(rng.integers(1, 9))
        match int(rng.integers(6)):
            case 0:
                found[at : at + 1] = bytes(b ^ 1 << rng.integers(8) for b in found[at : at + 1])
            case 1:
                del found[at:]
            case 2:
                found[at : at + length] = rng.bytes(length)
            case 3:
                found[at:at] = found[at : at + 8 * length]
            case 4:
                del found[at : at + length]
            case _:
                numbers = [*NUMBER.finditer(found)]
                if numbers:
                    one = numbers[int(rng.integers(len(numbers)))]
                    found[one.start() : one.end()] = STRANGE[int(rng.integers(len(STRANGE)))]
    return bytes(found)


def load_or_refuse(path: Path, data: bytes) -> bool:
    """Whether *data* are a sound file; any other error than ours leaves here, and fails."""
    path.write_bytes(data)
    tracemalloc.start()
    try:
        with contextlib.suppress(ClvoxError):
            return len(load(path).faces) > 0
        return False
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < MOST


@pytest.mark.timeout(60)
@pytest.mark.parametrize("name", SOUND)
def test_garbled_file_is_read_or_refused(tmp_path: Path, name: str) -> None:
    rng = np.random.default_rng(len(name))
    assert load_or_refuse(tmp_path / name, SOUND[name])
    outcomes = [load_or_refuse(tmp_path / name, garbled(SOUND[name], rng)) for _ in range(ROUNDS)]
    # Neither is everything refused, nor does nothing matter.
    assert {True, False} == set(outcomes)


@pytest.mark.timeout(60)
@pytest.mark.parametrize("name", ["3D/3dmodel.model", "_rels/.rels"])
def test_garbled_part_of_a_sound_archive_is_read_or_refused(tmp_path: Path, name: str) -> None:
    """Flipped bytes of an archive end at its checksums: the XML has to be garbled before."""
    rng = np.random.default_rng(7)
    words = "<!--" + " something that does not matter" * 9 + "-->"
    links = mesh_files.relationships("3D/3dmodel.model") + words
    parts = {"_rels/.rels": links.encode(), "3D/3dmodel.model": MODEL}
    path = tmp_path / "a.3mf"
    assert load_or_refuse(path, mesh_files.archive({**parts}))
    outcomes = [
        load_or_refuse(path, mesh_files.archive({**parts, name: garbled(parts[name], rng)}))
        for _ in range(ROUNDS)
    ]
    assert {True, False} == set(outcomes)


@pytest.mark.timeout(60)
def test_garbled_file_inside_gzip_is_read_or_refused(tmp_path: Path) -> None:
    rng = np.random.default_rng(8)
    for round_ in range(ROUNDS):
        name = [*SOUND][round_ % len(SOUND)]
        load_or_refuse(tmp_path / f"{name}.gz", gzip.compress(garbled(SOUND[name], rng)))
        load_or_refuse(tmp_path / f"{name}.gz", garbled(gzip.compress(SOUND[name]), rng))
