"""Kernel sources, joined on the host into one text.

Includes are expanded here and not by the driver: so no driver can serve a stale header from its
cache, no include path is needed, and a zipped package works.  `#line` directives keep the
compiler's messages pointing at the files that were written.
"""

from __future__ import annotations

import re
from functools import cache
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path

_INCLUDE = re.compile(r'\s*#\s*include\s+"([^"]+)"')


def _kernel_folder() -> Traversable:
    """The folder of kernel sources: installed, or beside `clvox` in a checkout."""
    try:
        return files("clvox.cl_kernels")
    except ModuleNotFoundError:
        return Path(__file__).parents[2] / "cl_kernels"


@cache
def read_source(file: str) -> str:
    """Return the text of kernel *file* ("crossings/cast_rays.cl"), its includes expanded.

    An include names a file from the root of the kernels' folder.  A file that must not be
    expanded twice guards itself, as in C.
    """
    lines = [f'#line 1 "{file}"']
    text = _kernel_folder().joinpath(*file.split("/")).read_text(encoding="utf-8")
    for number, line in enumerate(text.splitlines(), start=1):
        include = _INCLUDE.match(line)
        if include:
            lines += [read_source(include[1]).rstrip("\n"), f'#line {number + 1} "{file}"']
        else:
            lines.append(line)
    return "\n".join(lines) + "\n"
