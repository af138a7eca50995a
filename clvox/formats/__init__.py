"""Read triangles from mesh files, none of which is trusted.

A size that a header claims is held against the length of the file before anything of that size
is allocated, and what a small file may expand to is limited; what does not add up is refused and
never repaired.  General readers are lenient here, each in its own way, and a solid that was
quietly mended is no longer the one in the file.  Nothing is ever written.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from clvox.errors import FormatError
from clvox.formats.common import Contents, unpacked
from clvox.formats.gltf import read_glb, read_gltf
from clvox.formats.obj import read_obj
from clvox.formats.off import read_off
from clvox.formats.ply import read_ply
from clvox.formats.stl import read_stl
from clvox.formats.threemf import read_3mf

__all__ = ["READERS", "Contents", "read"]

READERS: dict[str, Callable[[bytes, Path], Contents]] = {
    ".stl": lambda data, _: read_stl(data),
    ".obj": lambda data, _: read_obj(data),
    ".ply": lambda data, _: read_ply(data),
    ".off": lambda data, _: read_off(data),
    ".glb": read_glb,
    ".gltf": read_gltf,
    ".3mf": lambda data, _: read_3mf(data),
}
"""What turns the bytes of a file, and the folder it lies in, into triangles, by suffix."""


def read(path: Path) -> Contents:
    """Return what is in the file at *path*; raise FormatError where it is no sound mesh file."""
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
    data = unpacked(path) if packed else path.read_bytes()
    if not data:
        raise FormatError("the file is empty")
    return reader(data, path.parent)
