"""Flipped bits by winding number, into a dense grid or bricks: `cl_kernels/fill`."""

from __future__ import annotations

from enum import IntEnum

import numpy as np
import pyopencl.array as cla

from clvox.device import Session
from clvox.device.session import Argument
from clvox.grid import Shape
from clvox.ops.crossings import Window, fraction_bits
from clvox.ops.facets import Mesh, Progress
from clvox.ops.layout import Bricks, Cells, words_for
from clvox.ops.sorting import LIST_BYTES, sorted_windows

_FILE = "fill/flip_rule.cl"
_DENSE, _BRICKS = 1, 2

_CROSSINGS = 16
"""Crossings of a ray, more or less."""


class Winding(IntEnum):
    """Which winding numbers are inside: RULE of `fill/flip_rule.cl`."""

    NONZERO = 0
    POSITIVE = 1


def flip_dense(
    session: Session,
    facets: Mesh,
    bits: int,
    shape: Shape,
    rule: Winding,
    voxels: cla.Array,
    beyond: cla.Array,
    *,
    progress: Progress | None = None,
    list_bytes: int = LIST_BYTES,
) -> None:
    """Flip, wherever *rule* begins or ceases to hold on a ray along y, the bit of the next voxel.

    The arrays are those of `clvox.ops.crossings.flip_dense`.
    """
    sink = np.int32(shape[1]), np.int32(words_for(shape[0])), voxels, beyond
    defines, window = {"SINK": _DENSE}, Window.whole(shape, 1)
    _flip(session, facets, bits, window, rule, sink, defines, progress, list_bytes)


def flip_bricks(
    session: Session,
    facets: Mesh,
    bits: int,
    cells: Cells,
    rule: Winding,
    bricks: Bricks,
    *,
    progress: Progress | None = None,
    list_bytes: int = LIST_BYTES,
) -> None:
    """Flip, wherever *rule* begins or ceases to hold on a ray along y, the bit of the next voxel.

    The arrays are those of `clvox.ops.crossings.flip_bricks`.
    """
    defines, window = {"SINK": _BRICKS, **cells.defines}, Window.of_slab(cells, bricks.slab)
    sink = bricks.sink(cells)
    _flip(session, facets, bits, window, rule, sink, defines, progress, list_bytes)


def _flip(
    session: Session,
    facets: Mesh,
    bits: int,
    window: Window,
    rule: Winding,
    sink: tuple[Argument, ...],
    defines: dict[str, int],
    progress: Progress | None,
    list_bytes: int,
) -> None:
    kernel = session.kernel(
        _FILE, "flip_rule", RULE=int(rule), FRACTION_BITS=fraction_bits(bits), **defines
    )
    done, triangles = 0, facets.triangles
    for rows in sorted_windows(session, facets, bits, window, list_bytes):
        rays = rows.window.rays
        listed = rows.window.box, rows.offsets, rows.crossings
        session.run(kernel, rays, *listed, *sink, steps=_CROSSINGS)
        done += rays
        if progress is not None:
            session.finish()
            progress(triangles * done // window.rays, triangles)
