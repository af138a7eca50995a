"""A model's voxels as an array, layer by layer, since the device may not hold them all."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clvox.device import Session
from clvox.errors import GridError
from clvox.grid import Shape
from clvox.ops import query
from clvox.ops.layout import VoxelArrays
from clvox.ops.query import Rule

if TYPE_CHECKING:
    import pyopencl.array as cla

RuleName: TypeAlias = Literal["centre", "touch", "within"]
_RULES = {"centre": Rule.CENTRE, "touch": Rule.TOUCH, "within": Rule.WITHIN}

SLAB_BYTES = 1 << 26
"""About how much of an expanded model is on the device at once."""


def find_rule(name: str) -> Rule:
    """Return the rule of that name.

    Raises
    ------
    GridError
        There is none.
    """
    if name not in _RULES:
        raise GridError(f"rule must be one of {', '.join(map(repr, _RULES))}, got {name!r}")
    return _RULES[name]


def check_bounds(bounds: ArrayLike | None, shape: Shape) -> tuple[Shape, Shape]:
    """Return the first voxel and the one after the last; of the whole grid if *bounds* is None.

    Raises
    ------
    GridError
        The bounds are not two triples of integers, or reach beyond a grid of *shape*.
    """
    if bounds is None:
        return (0, 0, 0), shape
    try:
        box = np.array(bounds)
    except ValueError:
        box = np.array(None)
    if box.shape != (2, 3) or box.dtype.kind not in "iu":
        raise GridError(f"bounds must be two triples of integers, got {bounds!r}")
    if (box < 0).any() or (box > shape).any() or (box[0] > box[1]).any():
        raise GridError(f"bounds must lie within (0, 0, 0) and {shape}, got {box.tolist()}")
    (x0, y0, z0), (x1, y1, z1) = box.tolist()
    return (x0, y0, z0), (x1, y1, z1)


def expand_layers(
    session: Session,
    arrays: VoxelArrays,
    start: Shape,
    stop: Shape,
    rule: Rule,
    edge: cla.Array | None,
    into: NDArray[np.bool_] | None = None,
) -> Iterator[tuple[int, NDArray[np.bool_]]]:
    """Yield the voxels from *start* to before *stop* in layers along z: first k, and [z, y, x].

    The layers are parts of *into*, if it is given.
    """
    (x0, y0, z0), (x1, y1, z1) = start, stop
    thick = max(1, SLAB_BYTES // max(1, (x1 - x0) * (y1 - y0)))
    for k in range(z0, max(z1, z0 + 1), thick):
        above = min(k + thick, z1)
        slab = None if into is None else into[k - z0 : above - z0].view(np.uint8)
        box = (x0, y0, k), (x1, y1, above)
        yield k, query.expand(session, arrays, *box, rule, edge, slab).view(np.bool_)
