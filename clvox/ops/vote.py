"""Voxels of an open mesh by the majority of rays along x, y and z.

Along one axis parity counts the crossings before a voxel, from the low end of its ray.  That is
what parity says of a closed mesh: the open one and a curtain, which runs from each odd edge along
the axis to beyond the grid, and is closed by a cap there.  Rays along the axis meet no curtain, and
the cap behind the last voxel.  Of a closed mesh, rays along every axis say the same, bit for bit;
so each of the three is cast along y, like any other closed mesh.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from clvox.device import Session
from clvox.grid import Shape
from clvox.ops.combine import Operation, combine
from clvox.ops.crossings import Window, add_counts, near
from clvox.ops.facets import Mesh, Progress, upload_facets
from clvox.ops.layout import VoxelArrays
from clvox.ops.parity import fill_parity, mark_tree, with_boundary

Send: TypeAlias = Callable[[NDArray[np.int32], NDArray[np.int32]], Mesh]
"""Gives vertices and faces to the device, at once or part by part."""

MOST_RAYS = 1 << 24
"""Rays that are counted at a time."""


def fill_vote(
    session: Session,
    vertices: NDArray[np.int32],
    faces: NDArray[np.int32],
    odd_edges: NDArray[np.int32],
    bits: int,
    shape: Shape,
    levels: tuple[Shape, ...],
    *,
    send: Send | None = None,
    progress: Progress | None = None,
) -> VoxelArrays:
    """Return the voxels that two of three axes, or all, take to be inside.

    Parameters
    ----------
    vertices : (n, 3) int32
        Lattice positions.
    faces : (m, 3) int32
    odd_edges : (k, 2) int32
        The edges, as rows of *vertices*, that belong to an odd number of triangles.
    bits, shape, levels
        Steps in a voxel, as a power of two; voxels; the model's levels.
    send : callable, optional
        Gives vertices and faces to the device; by default all at once.

    Returns
    -------
    VoxelArrays
        With bricks where a triangle touches a cell or its voxels differ.
    """
    send = send or partial(upload_facets, session)

    def fill_along(axis: int) -> VoxelArrays:
        closed = send(*add_curtain(vertices, faces, odd_edges, bits, shape, axis))
        arrays = fill_parity(session, closed, bits, shape, levels)
        if progress is not None:
            session.finish()
            progress(axis + 1, 4)
        return arrays

    x, y, z = map(fill_along, range(3))
    differ = combine(session, x, y, Operation.XOR)
    decided = combine(session, differ, z, Operation.INTERSECTION)
    agreed = combine(session, x, y, Operation.INTERSECTION)
    majority = combine(session, agreed, decided, Operation.UNION)
    if len(levels) == 1:
        return majority
    cells = mark_tree(session, send(vertices, faces), bits, shape, levels)
    return with_boundary(session, majority, cells)


def odd_rays(
    session: Session, facets: Mesh, bits: int, shape: Shape, most: int = MOST_RAYS
) -> list[NDArray[np.int64]]:
    """Return the rays along x, y and z that cross the mesh an odd number of times.

    most: rays that are counted at a time.

    Returns
    -------
    list of three (n, 2) int64
        Voxel indices of each ray along the two other axes, the earlier of x, y, z first; ordered
        by the later one.
    """
    return [_odd_along(session, facets, bits, shape, axis, most) for axis in range(3)]


def _odd_along(
    session: Session, facets: Mesh, bits: int, shape: Shape, axis: int, most: int
) -> NDArray[np.int64]:
    waiting, found = [Window.whole(shape, axis)], []
    while waiting:
        window = waiting.pop()
        if window.rays > most and window.rays > 1:
            waiting += window.halves()
            continue
        u, v = window.sides
        counts = session.zeros((u, v) if axis == 1 else (v, u), np.uint32)
        add_counts(session, near(facets, bits, axis, window), bits, axis, window, counts)
        later, earlier = np.nonzero(counts.get() & np.uint32(1))
        first = window[:2] if axis != 1 else window[1::-1]
        found.append(np.stack([earlier, later], axis=1) + first)
    rays = np.concatenate(found).astype(np.int64)
    return rays[np.lexsort(rays.T)]


def add_curtain(
    vertices: NDArray[np.int32],
    faces: NDArray[np.int32],
    odd_edges: NDArray[np.int32],
    bits: int,
    shape: Shape,
    axis: int,
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return the mesh closed by a curtain along *axis*, up to the end of the grid or its own.

    Each vertex belongs to an even number of odd edges, so the curtain's hem is closed, and any fan
    over it a cap.
    """
    if not len(odd_edges):
        return vertices, faces
    rim, ends = np.unique(odd_edges, return_inverse=True)
    hem = vertices[rim]
    end = (shape[axis] << bits) - (1 << bits >> 1)
    hem[:, axis] = max(end, int(vertices[:, axis].max()))
    a, b = odd_edges.T
    below, beside = ends.reshape(odd_edges.shape).T + len(vertices)
    apex = np.full(len(a), len(vertices))
    corners = [(a, b, beside), (a, beside, below), (apex, below, beside)]
    added = np.concatenate([np.stack(three, axis=1) for three in corners])
    # Of the fan, triangles at its own apex use a vertex twice: they enclose nothing.
    added = added[(added[:, 0] != added[:, 1]) & (added[:, 0] != added[:, 2])]
    return np.concatenate([vertices, hem]), np.concatenate([faces, added.astype(np.int32)])
