"""From pieces of rays to bits and back: `cl_kernels/dexels`."""

from __future__ import annotations

import numpy as np
import pyopencl.array as cla

from clvox.device import Session
from clvox.ops import dense
from clvox.ops.dexels import Frame, launches, make_rows
from clvox.ops.layout import words_for
from clvox.ops.lists import CrossingLists


def to_dense(session: Session, frame: Frame, pieces: CrossingLists) -> cla.Array:
    """Return the samples inside, (nz, ny, words) uint32, rows of bits."""
    nx, ny, nz = frame.shape
    words = words_for(nx)
    defines = {"FRACTION_BITS": frame.fraction_bits}
    ends = pieces.offsets, pieces.depth
    slots = np.int32(frame.shape[frame.axis])
    if frame.axis == 0:
        voxels = session.empty((nz, ny, words), np.uint32)
        kernel = session.kernel("dexels/rows_to_bits.cl", "fill_rows", **defines)
        for span in launches(frame.rays):
            items = int(span[1] - span[0])
            session.run(kernel, items, *span, slots, np.int32(words), *ends, voxels)
        return voxels
    voxels = session.zeros((nz, ny, words), np.uint32)
    kernel = session.kernel("dexels/rows_to_bits.cl", "flip_ends", **defines)
    by_axis = 1, words, ny * words
    strides = np.uint64(by_axis[3 - frame.axis]), np.uint64(by_axis[frame.axis])
    for span in launches(frame.rays):
        items = int(span[1] - span[0])
        session.run(kernel, items, *span, np.int32(nx), slots, *strides, *ends, voxels)
    # Layers along z are to words of layers what rows along y are to words of rows.
    shape = (nz, ny, words) if frame.axis == 1 else (1, nz, ny * words)
    beyond = session.zeros((shape[0], shape[2]), np.uint32)
    words_of_layers: cla.Array = voxels.reshape(shape)  # type: ignore[no-untyped-call]
    dense.fill(session, words_of_layers, beyond)
    return voxels


def from_dense(session: Session, frame: Frame, voxels: cla.Array) -> CrossingLists:
    """Return the pieces, ending half-way between samples, of bits (nz, ny, words)."""
    _, ny, words = voxels.shape
    by_axis = 1, 32 * words, 32 * words * ny
    first, second = (stride for a, stride in enumerate(by_axis) if a != frame.axis)
    strides = np.uint64(first), np.uint64(second), np.uint64(by_axis[frame.axis])
    rows = np.int32(frame.across[0]), np.int32(frame.shape[frame.axis])
    defines = {"FRACTION_BITS": frame.fraction_bits}
    arguments = *rows, *strides, voxels
    return make_rows(session, frame, "dexels/bits_to_rows.cl", "bits_to_rows", defines, arguments)
