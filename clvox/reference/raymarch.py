"""What each ray of a picture meets, by looking at all voxels."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from clvox.picture_rays import PLANE_BITS, TIME_BITS, Integers, Plane, Rays


class Visits(NamedTuple):
    """The voxels that a ray visits, of those given, in order.

    which: their rows; since, until: moments at which it enters and leaves, times 3 plus the axis;
    whole: moments in one direction.
    """

    which: NDArray[np.int64]
    since: NDArray[np.object_]
    until: NDArray[np.object_]
    whole: int


def first_voxels(
    voxels: NDArray[np.bool_],
    rays: Rays,
    size: tuple[int, int],
    low: Integers = (0, 0, 0),
    high: Integers | None = None,
    cut: Plane | None = None,
) -> NDArray[np.int32]:
    """Return the first voxel that is inside along each ray.

    Planes between voxels are met at moments (see `Rays`), equal ones in the order of their axes,
    x first.  A ray visits the voxels all of whose three entering planes it meets before any of
    the three leaving ones; if rays begin, those that it leaves after the moment 0, and after all
    planes that it meets at that moment.  Along an axis on which it stands still a voxel owns its
    lower face.

    Parameters
    ----------
    voxels : (nz, ny, nx) bool
    rays : Rays
    size : (int, int)
        Columns and rows.
    low, high : (3,) int
        The voxels that are drawn: from *low* to before *high*.
    cut : Plane, optional
        What lies beyond it is not drawn: rays begin, or end, after the moment at which they meet
        it, and after all planes between voxels that they meet at that moment.

    Returns
    -------
    (rows, columns, 3) int32
        (i, j, k), or -1, three times.
    """
    columns, rows = size
    hits = np.full((rows, columns, 3), -1, np.int32)
    solid = _drawn(voxels, low, high)
    for row in range(rows):
        for column in range(columns):
            visits = _visits(solid, *_ray(rays, column, row), rays, cut)
            if len(visits.which):
                hits[row, column] = solid[visits.which[0]]
    return hits


def lengths(
    voxels: NDArray[np.bool_],
    rays: Rays,
    size: tuple[int, int],
    spacing: tuple[float, float, float],
    low: Integers = (0, 0, 0),
    high: Integers | None = None,
    cut: Plane | None = None,
) -> NDArray[np.float64]:
    """Return how far each ray runs within voxels that are inside, in the unit of *spacing*.

    Parameters as in `first_voxels`.  (rows, columns) float64.
    """
    columns, rows = size
    found = np.zeros((rows, columns))
    solid = _drawn(voxels, low, high)
    for row in range(rows):
        for column in range(columns):
            place, direction = _ray(rays, column, row)
            visits = _visits(solid, place, direction, rays, cut)
            moments = sum(
                until // 3 - since // 3 for since, until in zip(*visits[1:3], strict=True)
            )
            ahead = np.linalg.norm(np.array(direction) * spacing) / 2**rays.bits
            found[row, column] = float(moments) / visits.whole * ahead
    return found


def _drawn(voxels: NDArray[np.bool_], low: Integers, high: Integers | None) -> NDArray[np.object_]:
    solid = np.argwhere(voxels)[:, ::-1]
    kept = (solid >= low).all(axis=1) & (solid < (high or voxels.shape[::-1])).all(axis=1)
    drawn: NDArray[np.object_] = solid[kept].astype(object)
    return drawn


def _ray(rays: Rays, column: int, row: int) -> tuple[list[int], list[int]]:
    """Place and direction of a ray."""
    place = [
        (at + column * right + row * down) >> rays.fraction
        for at, right, down in zip(rays.start, rays.right, rays.down, strict=True)
    ]
    direction = [
        (part + column * right + row * down) >> rays.turn
        for part, right, down in zip(rays.direction, rays.turn_right, rays.turn_down, strict=True)
    ]
    return place, direction


def _visits(
    solid: NDArray[np.object_],
    place: list[int],
    direction: list[int],
    rays: Rays,
    cut: Plane | None = None,
) -> Visits:
    """What a ray visits; Python integers, so that nothing overflows."""
    one = 1 << rays.bits
    visited = np.ones(len(solid), bool)
    whole = int(np.prod([abs(part) for part in direction if part] or [1], dtype=object))
    entering, leaving = [np.full(len(solid), 2 if rays.begins else -(1 << 200), object)], []
    for axis, part in enumerate(direction):
        low, high = solid[:, axis] * one - place[axis], (solid[:, axis] + 1) * one - place[axis]
        if part == 0:
            visited &= (low <= 0) & (high > 0)
            continue
        pace = whole // abs(part)
        # A moment and its axis as one integer, in the order of both.
        near, far = (low * pace, high * pace) if part > 0 else (-high * pace, -low * pace)
        entering.append(near * 3 + axis)
        leaving.append(far * 3 + axis)
    if cut is not None:
        met, nearing = _moment_at(cut, place, direction, whole)
        visited &= nearing != 0 or met >= 0
        ends = np.full(len(solid), 3 * met + 2, object)
        if nearing < 0:
            entering.append(ends)
        elif nearing > 0:
            leaving.append(ends)
    since = np.max(np.array(entering), axis=0)
    until = np.min(np.array(leaving), axis=0) if leaving else since
    (found,) = np.nonzero(visited & (since < until))
    order = found[np.argsort(since[found], kind="stable")]
    return Visits(order, since[order], until[order], whole)


def _moment_at(cut: Plane, place: list[int], direction: list[int], whole: int) -> tuple[int, int]:
    """When a ray meets a plane (see `Plane`), and whether it leaves what is kept there.

    The second is 1 if it does, -1 if that is where it comes in, and 0 if it never meets it: then
    the first is below 0 if it is cut away.
    """
    nearing = sum(part * along for part, along in zip(cut.normal, direction, strict=True))
    rest = cut.most - sum(part * at for part, at in zip(cut.normal, place, strict=True))
    if nearing == 0:
        return rest, 0
    sign = 1 if nearing > 0 else -1
    turns, over = divmod(sign * rest, sign * nearing)
    never = 1 << TIME_BITS
    if abs(turns) >= never // whole:
        return (never if turns > 0 else -never), sign
    parts = (over << PLANE_BITS) // (sign * nearing)
    return whole * turns + (whole * parts >> PLANE_BITS), sign


def block_distances(occupied: NDArray[np.bool_], most: int) -> NDArray[np.uint8]:
    """Return how many blocks each block is away from the next one that is occupied.

    The largest of the distances along the axes, at most *most*; [z, y, x] uint8.  A block with a
    voxel that is inside, or that is known to be touched, is occupied.
    """
    found = np.full(occupied.shape, most, np.uint8)
    taken = np.argwhere(occupied)
    if len(taken):
        for block in np.ndindex(occupied.shape):
            found[block] = min(most, int(np.abs(taken - block).max(axis=1).min()))
    return found


def block_kinds(
    occupied: NDArray[np.bool_], full: NDArray[np.bool_], most: int
) -> NDArray[np.uint8]:
    """Return how many blocks each block is away from the next one of another kind.

    0 for a block that is occupied, and not *full*: all inside.  At most *most*, and 128 more for a
    full one; [z, y, x] uint8.
    """
    inner = block_distances(~full, most) + np.uint8(128)
    return np.where(full, inner, block_distances(occupied, most)).astype(np.uint8)


def brick_crumbs(voxels: NDArray[np.bool_]) -> int:
    """Return which of the 4 x 4 x 4 parts of a brick hold part of a voxel that is taken.

    voxels: of the brick, [z, y, x].  The parts are bits, x fastest.
    """
    found = 0
    for place in np.argwhere(voxels):
        first = place * 4 // voxels.shape
        last = ((place + 1) * 4 - 1) // voxels.shape
        for away in np.ndindex(*(last - first + 1)):
            found |= 1 << int((first + np.array(away)) @ (16, 4, 1))
    return found


def block_shares(
    voxels: NDArray[np.bool_],
    side: Integers,
    margin: int,
    plane: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0),
) -> NDArray[np.uint8]:
    """Return how much of each block of voxels is inside; 255 is all of it.

    Parameters
    ----------
    voxels : (nz, ny, nx) bool
    side : (3,) int
        Voxels along the sides of a block.
    margin : int
        Empty blocks around the grid.
    plane : (4,) float
        What lies beyond it does not count: blocks whose middle, in voxels, times its first three
        parts is above the fourth, in float32.

    Returns
    -------
    [z, y, x] uint8
    """
    counts = [-(-count // width) for count, width in zip(voxels.shape, side[::-1], strict=True)]
    shares = np.zeros([count + 2 * margin for count in counts], np.uint8)
    whole = math.prod(side)
    a, b, c, farthest = (np.float32(part) for part in plane)
    for block in np.ndindex(*counts):
        first = [at * width for at, width in zip(block, side[::-1], strict=True)]
        box = tuple(slice(at, at + n) for at, n in zip(first, side[::-1], strict=True))
        middle = [np.float32(at + n / 2) for at, n in zip(first, side[::-1], strict=True)]
        if a * middle[2] + b * middle[1] + c * middle[0] > farthest:
            continue
        share = (int(voxels[box].sum()) * 255 + whole // 2) // whole
        shares[tuple(at + margin for at in block)] = share
    return shares


def blurred(values: NDArray[np.uint8], weights: list[NDArray[np.int32]]) -> NDArray[np.uint8]:
    """Return *values*, [z, y, x], blurred along x, then y, then z, and each time rounded.

    weights: for each axis, of a place and of those on one side of it, in parts of 65536.
    """
    found = values.astype(np.int64)
    for axis, shares in zip((2, 1, 0), weights, strict=True):
        reach = len(shares) - 1
        kernel = np.concatenate([shares[:0:-1], shares]).astype(np.int64)
        padded = np.pad(found, [(reach, reach) if at == axis else (0, 0) for at in range(3)])
        windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1, axis=axis)
        found = (windows @ kernel + 32768) >> 16
    return found.astype(np.uint8)


def uneven_pixels(image: NDArray[np.uint8], least: int) -> NDArray[np.bool_]:
    """Return which pixels differ by *least* or more, in a byte, from one of those around them."""
    rows, columns, _ = image.shape
    padded = np.pad(image.astype(int), ((1, 1), (1, 1), (0, 0)), mode="edge")
    around = [padded[y : y + rows, x : x + columns] for y in range(3) for x in range(3)]
    uneven: NDArray[np.bool_] = (np.abs(np.array(around) - image).max(axis=(0, 3))) >= least
    return uneven


def pixels_beside(
    image: NDArray[np.uint8], some: NDArray[np.bool_], least: int
) -> NDArray[np.bool_]:
    """Return which pixels differ by *least* or more, in a byte, from one of *some* around them."""
    rows, columns, _ = image.shape
    found = np.zeros((rows, columns), bool)
    for row, column in np.argwhere(some):
        around = slice(max(row - 1, 0), row + 2), slice(max(column - 1, 0), column + 2)
        apart = np.abs(image[around].astype(int) - image[row, column]).max(axis=2)
        found[around] |= apart >= least
    return found & ~some


def places_of_rays(column: int, row: int, samples: int) -> list[tuple[int, int]]:
    """Return the columns and rows of places through which the rays of a pixel run.

    A pixel has samples**2 places along a side, and as many rays, one of them in each column and row
    of places.  That which is followed where one is enough comes first.
    """
    side = samples**2
    places = [
        (side * column + samples * i + samples - 1 - j, side * row + samples * j + i)
        for j in range(samples)
        for i in range(samples)
    ]
    first = ((samples + 1) * (column + samples // 2) + row) % side
    return places[first:] + places[:first]


def triangle_distances(
    place: NDArray[np.float64], corners: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return how far a place, (3,), is from triangles, (m, 3, 3): (m,) float64."""
    a, b, c = np.moveaxis(corners - place, 1, 0)
    found = np.full(len(corners), np.inf)
    for start, end in ((a, b), (b, c), (c, a)):
        along = end - start
        square = np.maximum((along * along).sum(axis=1), 1e-300)
        part = np.clip(-(start * along).sum(axis=1) / square, 0, 1)
        found = np.minimum(found, np.linalg.norm(start + along * part[:, None], axis=1))
    normal = np.cross(b - a, c - a)
    size = np.linalg.norm(normal, axis=1)
    above = size > 0
    for start, end in ((a, b), (b, c), (c, a)):
        above &= (np.cross(start, end) * normal).sum(axis=1) >= 0
    height = np.abs((a * normal).sum(axis=1)) / np.where(size > 0, size, 1)
    distances: NDArray[np.float64] = np.where(above, height, found)
    return distances
