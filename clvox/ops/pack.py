"""An array of voxels as a two-level model: `cl_kernels/pack`."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pyopencl.array as cla
from numpy.typing import NDArray

from clvox.device import Session
from clvox.grid import Shape
from clvox.ops.layout import VoxelArrays, brick_defines, cell_shape, int4, words_for
from clvox.ops.multilevel import BITS, rank_cells

_FILE = "pack/pack_voxels.cl"

SLAB_BYTES = 1 << 26
"""About how much of the array is on the device at once."""


def pack_voxels(session: Session, voxels: NDArray[np.bool_], brick: Shape) -> VoxelArrays:
    """Return the model whose voxels are *voxels*, [z, y, x]; cells that are mixed get a brick."""
    nz, ny, nx = voxels.shape
    shape = (nx, ny, nz)
    cells = cell_shape(shape, brick)
    words = words_for(cells[0])
    boundary = session.empty((cells[2], cells[1], words), np.uint32)
    inside = session.empty(boundary.shape, np.uint32)
    defines = brick_defines(brick)
    kernel = session.kernel(_FILE, "pack_cells", **defines)
    for layer, layers, slab in _slabs(session, voxels, cells, brick):
        span = np.int32(layer), np.int32(layers), int4(cells), int4(shape)
        items, looks = words * cells[1] * layers, BITS * math.prod(brick)
        session.run(kernel, items, *span, slab, boundary, inside, steps=looks)
    ranked = rank_cells(session, boundary, cells, brick)
    bricks = session.empty((ranked.count, ranked.brick_words), np.uint32)
    kernel = session.kernel(_FILE, "pack_bricks", **defines)
    for layer, layers, slab in _slabs(session, voxels, cells, brick):
        span = np.int32(layer), np.int32(layers), int4(cells), int4(shape)
        items, looks = words * cells[1] * layers, BITS * math.prod(brick)
        session.run(kernel, items, *span, slab, boundary, ranked.rank, bricks, steps=looks)
    return VoxelArrays(shape, bricks, ranked, inside)


def pack_dense(session: Session, voxels: NDArray[np.bool_]) -> VoxelArrays:
    """Return the one-level model whose voxels are *voxels*, [z, y, x]."""
    nz, ny, nx = voxels.shape
    words = words_for(nx)
    packed = np.zeros((nz, ny, 4 * words), np.uint8)
    rows = np.packbits(voxels, axis=2, bitorder="little")
    packed[..., : rows.shape[2]] = rows
    return VoxelArrays((nx, ny, nz), session.upload(packed.view("<u4")))


def _slabs(
    session: Session, voxels: NDArray[np.bool_], cells: Shape, brick: Shape
) -> Iterator[tuple[int, int, cla.Array]]:
    """First layer of cells, number of layers, and their voxels as bytes on the device."""
    _, ny, nx = voxels.shape
    most = max(1, SLAB_BYTES // (ny * nx * brick[2]))
    for layer in range(0, cells[2], most):
        layers = min(most, cells[2] - layer)
        planes = voxels[layer * brick[2] : (layer + layers) * brick[2]]
        yield layer, layers, session.upload(planes.view(np.uint8))
