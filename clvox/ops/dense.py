"""A dense grid of bits, from flipped to solid: `cl_kernels/dense`."""

from __future__ import annotations

import numpy as np
import pyopencl.array as cla

from clvox.device import Session
from clvox.ops.layout import int4

SPAN = 16
"""Words that one work-item walks side by side."""


def fill(session: Session, voxels: cla.Array, beyond: cla.Array) -> int:
    """Resolve the flipped bits of *voxels*, in place; return the number of rays that end inside.

    voxels: (nz, ny, words) uint32; beyond: (nz, words) uint32.
    """
    nz, ny, words = voxels.shape
    odd = session.zeros(1, np.uint32)
    kernel = session.kernel("dense/fill.cl", "fill", SPAN=SPAN)
    spans = -(-words // SPAN)
    shape = int4((words, ny, nz))
    session.run(kernel, spans * nz, shape, voxels, beyond, odd, steps=SPAN * ny)
    return int(odd.get()[0])
