"""Files that are written: looked at before the work; and how large they are."""

from __future__ import annotations

import errno
import os
from pathlib import Path

from clvox._files import whole
from clvox.errors import FormatError

MODELS = (".npz",)
MESHES = (".ply", ".stl", ".obj")
PICTURES = (".png",)


def writable(path: str | os.PathLike[str], kinds: tuple[str, ...], source: str = "") -> Path:
    """Return *path*, to which a file of one of *kinds* can be written.

    Asked before long work, so that it is not lost to a misspelt folder.  Nothing is changed.

    Raises
    ------
    FormatError
        The suffix is none of *kinds*, or the file is *source*, which is read.
    OSError
        There is no such folder, or no file can be made in it, or *path* is a folder.
    """
    target = Path(path)
    if target.suffix.lower() not in kinds:
        raise FormatError(
            f"{target}: the suffix must be {' or '.join(kinds)}, got {target.suffix or 'none'}"
        )
    if target.is_dir():
        raise IsADirectoryError(errno.EISDIR, "is a folder; a file is expected", str(target))
    if not target.parent.is_dir():
        raise FileNotFoundError(errno.ENOENT, "there is no such folder", str(target.parent))
    if source and target.exists() and Path(source).exists() and target.samefile(source):
        raise FormatError(f"{target} is the file that is read; write to another one")
    with whole(target, keep=False):
        return target


def size_of(path: Path) -> str:
    """Return the size of a file, for a person."""
    return bytes_in_words(path.stat().st_size)


def bytes_in_words(count: float) -> str:
    """Return a number of bytes, for a person: 1.2 MB."""
    for unit in ("bytes", "kB", "MB", "GB"):
        if count < 1000 or unit == "GB":
            break
        count /= 1000
    return f"{count:.0f} {unit}" if unit == "bytes" else f"{count:.1f} {unit}"
