"""What the tests of kernels share: meshes, how many of them, and a mesh on the device."""

from __future__ import annotations

import os
import warnings
from typing import TYPE_CHECKING

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from clvox.grid import Shape
from clvox.ops.facets import Facets, upload_facets
from tests.strategies import Mesh, Seeded, adversarial_meshes, limits, position

if TYPE_CHECKING:
    from clvox.device import Session

INTERPRETED = os.environ.get("HYPOTHESIS_PROFILE") == "oclgrind"
"""Whether kernels run some thousand times slower, under a checker of accesses and not of values."""


SHARES = {"oclgrind": 30, "second": 3}
"""On a second compiled implementation the same cases are not all tried again."""


def some(count: int, least: int = 2) -> int:
    """How many cases to try: *count*, or a part of them as the profile of the run says."""
    share = SHARES.get(os.environ.get("HYPOTHESIS_PROFILE", ""), 1)
    return max(min(least, count), count // share)


_programs: list[cl.Program] = []


def build(session: Session, source: str, name: str, **defines: int) -> cl.Kernel:
    """Return kernel *name* of a text of a test's own."""
    program = cl.Program(session._context, source)
    with warnings.catch_warnings():
        # Some compilers say that they are done.
        warnings.simplefilter("ignore", cl.CompilerWarning)
        program.build(["-cl-std=CL1.2", *(f"-D{key}={value}" for key, value in defines.items())])
    # Oclgrind confuses a program with one that was freed before.
    _programs.append(program)
    return cl.Kernel(program, name)


def facets_of(session: Session, mesh: Mesh) -> Facets:
    """Return the mesh on the device."""
    vertices, faces = mesh
    return upload_facets(session, vertices.astype(np.int32), faces)


def slivers(seed: int, count: int, bits: int, shape: Shape) -> Mesh:
    """Return so many triangles across all of a grid, some steps wide or some voxels.

    Some lie along the axes, or end on the centres of voxels.
    """
    rng = np.random.default_rng(seed)
    ends = rng.integers(0, np.array(shape) << bits, (count, 2, 3))
    ends[::3] &= -1 << bits
    level, axes = np.arange(1, count, 4), rng.integers(0, 3, len(range(1, count, 4)))
    ends[level, 1, axes] = ends[level, 0, axes]
    widths = 1 << rng.integers(0, bits + 2, (count, 1))
    others = ends[:, rng.integers(0, 2)] + rng.integers(-widths, widths + 1, (count, 3))
    vertices = np.concatenate([ends, others[:, None]], axis=1).reshape(-1, 3)
    return vertices, np.arange(3 * count, dtype=np.int32).reshape(-1, 3)


def soup(seed: int, count: int, bits: int, shape: Shape) -> Mesh:
    """Return *count* triangles that share no vertex, near the grid: about half of them in ties."""
    source = Seeded(np.random.default_rng(seed), bits, shape)
    spots = [[position(source, axis) for axis in range(3)] for _ in range(3 * count)]
    faces = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    return np.array(spots, dtype=np.int64), faces


def large_tetrahedra(seed: int, count: int, bits: int, shape: Shape) -> list[Mesh]:
    """Return tetrahedra from a few voxels to all of the lattice wide, about the grid's middle.

    Sizes are log-uniform, each axis by itself, so that boxes of all sizes and aspects occur.
    """
    rng = np.random.default_rng(seed)
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], dtype=np.int32)
    ends = np.array([limits(bits, side) for side in shape])
    middle = rng.integers(0, np.array(shape) << bits, (count, 1, 3))
    reach = np.exp2(rng.uniform(bits + 1, 24, (count, 1, 3)))
    spots = middle + np.rint(reach * rng.uniform(-1, 1, (count, 4, 3))).astype(np.int64)
    # A few corners on rays, so that ties are met on triangles of every size.
    on_ray = rng.random((count, 4, 3)) < 0.3
    spots = np.where(on_ray, (spots >> bits) << bits, spots)
    return [(part, faces) for part in np.clip(spots, ends[:, 0], ends[:, 1])]


def meshes_for(seed: int, count: int, bits: int, shape: Shape) -> list[Mesh]:
    """Return closed meshes of all families and sizes, and a soup of triangles, which is open."""
    count = some(count)
    return [
        *adversarial_meshes(seed, count, bits, shape),
        *large_tetrahedra(seed, max(count // 2, 1), bits, shape),
        soup(seed, count, bits, shape),
    ]


def flat_triangles(seed: int, count: int, bits: int, shape: Shape) -> Mesh:
    """Return *count* triangles without area: points, and segments with the third corner on them."""
    source = Seeded(np.random.default_rng(seed), bits, shape)
    vertices, faces = [], []
    for i in range(count):
        a, b = ([position(source, axis) for axis in range(3)] for _ in range(2))
        if i % 3 == 0:
            # Along one axis, or in the plane of two.
            for axis in source.order(3)[: source.integer(1, 2)]:
                b[axis] = a[axis]
        if i % 11 == 0:
            b = a
        between = [
            [(p * (4 - part) + q * part) // 4 for p, q in zip(a, b, strict=True)]
            for part in range(5)
            if all(p * (4 - part) + q * part & 3 == 0 for p, q in zip(a, b, strict=True))
        ]
        corners = [a, b, between[source.integer(0, len(between) - 1)]]
        faces.append([3 * i + corner for corner in source.order(3)])
        vertices += corners
    return np.array(vertices, dtype=np.int64), np.array(faces, dtype=np.int32)


def bricks_at(
    voxels: NDArray[np.bool_], boundary: NDArray[np.bool_], brick: Shape
) -> NDArray[np.bool_]:
    """Return the voxels of each boundary cell, (bricks, n1z, n1y, n1x); the padding is False."""
    sides = brick[::-1]
    whole = [count * side for count, side in zip(boundary.shape, sides, strict=True)]
    padded = np.zeros(whole, dtype=np.bool_)
    padded[tuple(slice(count) for count in voxels.shape)] = voxels
    (nz, ny, nx), (n1z, n1y, n1x) = boundary.shape, sides
    blocks = padded.reshape(nz, n1z, ny, n1y, nx, n1x).transpose(0, 2, 4, 1, 3, 5)
    return np.ascontiguousarray(blocks[boundary])
