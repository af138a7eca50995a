"""Where the rays of a grid cross a mesh: twin of the crossings kernels.

All geometry is on the lattice: the centre of voxel k lies at ``k * 2**bits`` along each axis.
Every sample is its voxel's centre moved by (e, e**2, e**3) along (x, y, z), for an e > 0 smaller
than anything it is compared with; a ray is the line through the moved samples of a row of voxels.
So a number is a polynomial in e, written as its coefficients from the constant upwards, and its
sign is that of the first coefficient that is not zero.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from fractions import Fraction
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clvox.grid import Axis, Shape

Point: TypeAlias = tuple[int, int, int]
Corners: TypeAlias = tuple[Point, Point, Point]

AXES: dict[Axis, int] = {"x": 0, "y": 1, "z": 2}


class Crossing(NamedTuple):
    """Where a ray crosses a triangle.

    Attributes
    ----------
    u, v : int
        The ray: its voxel index along the earlier and along the later of the two other axes;
        (j, k) for rays along x, (i, k) along y, (i, j) along z.
    depth : Fraction
        Along the ray through the centres, not moved, in voxels; 0 is the centre of voxel 0.
    slot : int
        The first k such that the moved sample of voxel k comes after the crossing; not clipped,
        so 0 or less is before the grid's first sample.
    triangle : int
    sign : int
        +1 where the triangle's normal points against the ray (going in), -1 along it (going out).
    late : bool
        The moved crossing comes after a moved sample that lies, not moved, at its very depth.
    """

    u: int
    v: int
    depth: Fraction
    slot: int
    triangle: int
    sign: int
    late: bool


def crossings(
    vertices: ArrayLike, faces: ArrayLike, bits: int, shape: Shape, axis: Axis
) -> list[Crossing]:
    """Return every crossing of the grid's rays along *axis* with the mesh, wherever along the ray.

    Parameters
    ----------
    vertices : (n, 3) int
        Lattice positions.
    faces : (m, 3) int
        Vertex numbers; the normal points to where the three are seen counter-clockwise.
    bits : int
        A voxel is ``2**bits`` steps wide.
    shape : (3,) int
        Voxels along x, y and z.
    axis : 'x', 'y' or 'z'

    Returns
    -------
    list of Crossing
        Ordered by triangle, then v, then u.
    """
    found = []
    for hit in _hits(vertices, faces, bits, shape, axis):
        rows = zip(
            hit.u.tolist(), hit.v.tolist(), hit.numerator.tolist(), hit.slot.tolist(), strict=True
        )
        for u, v, numerator, slot in rows:
            depth = Fraction(numerator, hit.denominator)
            found.append(Crossing(u, v, depth, slot, hit.triangle, hit.sign, hit.late))
    return found


def count_crossings(
    vertices: ArrayLike, faces: ArrayLike, bits: int, shape: Shape, axis: Axis
) -> NDArray[np.uint32]:
    """Return how many triangles each ray along *axis* crosses; parameters as in `crossings`.

    Returns
    -------
    (nv, nu) uint32
        The grid's array shape without *axis*: (nz, ny) along x, (nz, nx) along y, (ny, nx) along z.
    """
    u_axis, v_axis = _across(axis)
    counts = np.zeros((shape[v_axis], shape[u_axis]), dtype=np.uint32)
    for hit in _hits(vertices, faces, bits, shape, axis):
        counts[hit.v, hit.u] += 1
    return counts


def fill_parity(
    vertices: ArrayLike, faces: ArrayLike, bits: int, shape: Shape, axis: Axis
) -> NDArray[np.bool_]:
    """Return which voxels have an odd number of crossings before their sample on their ray.

    Parameters as in `crossings`.

    Returns
    -------
    (nz, ny, nx) bool
        On a closed mesh the same for every *axis*.
    """
    u_axis, v_axis = _across(axis)
    count = shape[AXES[axis]]
    # One more than there are samples: the crossings that lie beyond the last.
    flips = np.zeros((shape[v_axis], shape[u_axis], count + 1), dtype=np.bool_)
    for hit in _hits(vertices, faces, bits, shape, axis):
        flips[hit.v, hit.u, np.clip(hit.slot, 0, count).astype(np.int64)] ^= True
    inside = np.logical_xor.accumulate(flips[..., :count], axis=2)
    # Array dimensions are (z, y, x), so axis a is dimension 2 - a.
    return np.ascontiguousarray(np.moveaxis(inside, 2, 2 - AXES[axis]))


def fixed_depth(crossing: Crossing, fraction_bits: int) -> int:
    """Return the stored depth of *crossing*: fixed point in voxels, rounded up.

    It is the slot that the crossing had if samples lay ``2**-fraction_bits`` voxels apart, each
    moved alike.  Hence ``ceil(fixed_depth / 2**fraction_bits)`` is the slot.
    """
    scaled = crossing.depth * (1 << fraction_bits)
    return math.floor(scaled) + 1 if crossing.late else math.ceil(scaled)


def crossing_at(
    corners: Corners, u: int, v: int, bits: int, axis: Axis
) -> tuple[Fraction, int, int] | None:
    """Return (depth, slot, sign) of one ray's crossing with one triangle, or None.

    This is the definition, a ray and a triangle at a time; `crossings` says the same of arrays.
    """
    w_axis = AXES[axis]
    u_axis, v_axis = _across(axis)
    step = 2**bits
    sides = set()
    for start, end in zip(corners, corners[1:] + corners[:1], strict=True):
        along_u, along_v = end[u_axis] - start[u_axis], end[v_axis] - start[v_axis]
        side = [0, 0, 0, 0]
        side[0] = along_u * (v * step - start[v_axis]) - along_v * (u * step - start[u_axis])
        side[1 + v_axis] = along_u
        side[1 + u_axis] = -along_v
        sides.add(_sign(side))
    if len(sides) != 1 or sides == {0}:
        return None

    normal = _normal(corners)
    facing = _sign([normal[w_axis]])
    corner = corners[0]

    def after(k: int) -> bool:
        """Whether moved sample k is on the side of the plane that the ray comes to last."""
        sample = [0, 0, 0]
        sample[u_axis], sample[v_axis], sample[w_axis] = u * step, v * step, k * step
        height = sum(n * (s - c) for n, s, c in zip(normal, sample, corner, strict=True))
        return _sign([height, *normal]) == facing

    across = normal[u_axis] * (u * step - corner[u_axis])
    across += normal[v_axis] * (v * step - corner[v_axis])
    depth = (corner[w_axis] - Fraction(across, normal[w_axis])) / step
    slot = math.floor(depth)
    while not after(slot):
        slot += 1
    return depth, slot, -facing


class _Hits(NamedTuple):
    """The rays that cross one triangle, as arrays; depth is numerator / denominator."""

    triangle: int
    u: NDArray[np.int64]
    v: NDArray[np.int64]
    numerator: NDArray[Any]
    denominator: int
    slot: NDArray[Any]
    sign: int
    late: bool


def _hits(
    vertices: ArrayLike, faces: ArrayLike, bits: int, shape: Shape, axis: Axis
) -> Iterator[_Hits]:
    points = np.asarray(vertices).tolist()
    for triangle, (a, b, c) in enumerate(np.asarray(faces).tolist()):
        hits = _hits_of(triangle, (points[a], points[b], points[c]), bits, shape, axis)
        if hits is not None:
            yield hits


def _hits_of(triangle: int, corners: Corners, bits: int, shape: Shape, axis: Axis) -> _Hits | None:
    w_axis = AXES[axis]
    u_axis, v_axis = _across(axis)
    normal = _normal(corners)
    if normal[w_axis] == 0:
        return None
    step = 2**bits
    # A moved point is in a triangle only if the point itself is in the closed triangle.
    u_range = _between([p[u_axis] for p in corners], step, shape[u_axis])
    v_range = _between([p[v_axis] for p in corners], step, shape[v_axis])

    # Python integers where int64 might not do.  Every difference below is within 2 * far, so that
    # sides are within 2 * (2 * far)**2, numerators within 2 * far * the sum of |normal|.
    far = max(abs(x) for p in corners for x in p) + step
    most = 2 * far * max(4 * far, sum(abs(n) for n in normal))
    dtype = np.int64 if most < 2**62 else object
    v, u = (w.ravel() for w in np.meshgrid(v_range, u_range, indexing="ij"))
    pu, pv = u.astype(dtype) * step, v.astype(dtype) * step

    covered = np.ones(len(u), dtype=np.bool_)
    facing = _sign([normal[w_axis]])
    # (y, z) and (x, y) turn as the normal's x and z say, (x, z) turns against its y.
    turn = -facing if axis == "y" else facing
    for start, end in zip(corners, corners[1:] + corners[:1], strict=True):
        along_u, along_v = end[u_axis] - start[u_axis], end[v_axis] - start[v_axis]
        side = along_u * (pv - start[v_axis]) - along_v * (pu - start[u_axis])
        tie = [0, 0, 0]
        tie[u_axis], tie[v_axis] = -along_v, along_u
        covered &= (side * turn > 0) | ((side == 0) & (_sign(tie) == turn))
    u, v, pu, pv = u[covered], v[covered], pu[covered], pv[covered]

    across = normal[u_axis] * (pu - corners[0][u_axis]) + normal[v_axis] * (pv - corners[0][v_axis])
    numerator = facing * (normal[w_axis] * corners[0][w_axis] - across)
    denominator = abs(normal[w_axis]) * step
    late = _sign(normal) != facing
    below = numerator // denominator
    slot = below + ((numerator != below * denominator) | late)
    return _Hits(triangle, u, v, numerator, denominator, slot, -facing, late)


def _across(axis: Axis) -> tuple[int, int]:
    """Numbers of the earlier and of the later of the other two axes."""
    u_axis, v_axis = (a for a in range(3) if a != AXES[axis])
    return u_axis, v_axis


def _sign(polynomial: list[int] | Point) -> int:
    """Sign of a polynomial in an infinitesimal, from its coefficients, the constant first."""
    first = next((c for c in polynomial if c != 0), 0)
    return (first > 0) - (first < 0)


def _normal(corners: Corners) -> Point:
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = corners
    px, py, pz, qx, qy, qz = bx - ax, by - ay, bz - az, cx - ax, cy - ay, cz - az
    return py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx


def _between(positions: list[int], step: int, count: int) -> NDArray[np.int64]:
    """Indices of the centres from the least to the greatest of *positions*, within the grid."""
    first = max(-(-min(positions) // step), 0)
    last = min(max(positions) // step, count - 1)
    return np.arange(first, last + 1)
