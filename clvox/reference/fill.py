"""Which voxels are inside, by winding number or by touch: twin of the fill kernels."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clvox.grid import Axis, Shape
from clvox.reference.boundary import touched
from clvox.reference.crossings import AXES, crossings

FillRule: TypeAlias = Literal["parity", "nonzero", "positive"]

_INSIDE: dict[str, Callable[[NDArray[np.int64]], NDArray[Any]]] = {
    "parity": lambda winding: winding % 2 == 1,
    "nonzero": lambda winding: winding != 0,
    "positive": lambda winding: winding > 0,
}


def winding_numbers(
    vertices: ArrayLike, faces: ArrayLike, bits: int, shape: Shape, axis: Axis
) -> NDArray[np.int64]:
    """Return the sum of the signs of the crossings before each voxel's sample, on its ray.

    Parameters as in `clvox.reference.crossings.crossings`.

    Returns
    -------
    (nz, ny, nx) int64
        On an oriented mesh the same for every *axis*.
    """
    w_axis = AXES[axis]
    across = tuple(count for a, count in enumerate(shape) if a != w_axis)
    count = shape[w_axis]
    steps = np.zeros((across[1], across[0], count + 1), dtype=np.int64)
    for crossing in crossings(vertices, faces, bits, shape, axis):
        steps[crossing.v, crossing.u, min(max(crossing.slot, 0), count)] += crossing.sign
    winding = steps.cumsum(axis=2)[..., :count]
    return np.ascontiguousarray(np.moveaxis(winding, 2, 2 - w_axis))


def fill(
    vertices: ArrayLike,
    faces: ArrayLike,
    bits: int,
    shape: Shape,
    rule: FillRule,
    axis: Axis = "y",
) -> NDArray[np.bool_]:
    """Return the voxels inside, (nz, ny, nx): those whose winding number *rule* takes."""
    inside = _INSIDE[rule](winding_numbers(vertices, faces, bits, shape, axis))
    return inside.astype(np.bool_)


def fill_surface(
    vertices: ArrayLike, faces: ArrayLike, bits: int, shape: Shape
) -> NDArray[np.bool_]:
    """Return the voxels that some triangle touches, (nz, ny, nx)."""
    return touched(vertices, faces, bits, shape, (1, 1, 1))
