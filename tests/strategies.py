"""Closed, oriented meshes on the lattice, with ties as common as not.

Each family is written once, against `Source`, and is drawn from by `closed_meshes` (hypothesis)
and by `adversarial_meshes` (a seed).  Meshes may cross themselves, be flat, or lie outside of the
grid, partly or wholly: all that holds is that every edge is used equally often both ways.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Protocol, TypeAlias

import numpy as np
from hypothesis import strategies as st
from numpy.typing import ArrayLike, NDArray

from clvox.grid import MAX_SPAN, Shape

Mesh: TypeAlias = tuple[NDArray[np.int64], NDArray[np.int32]]
"""Lattice positions (n, 3) and vertex numbers (m, 3)."""


class Source(Protocol):
    """Where a family takes its choices from."""

    bits: int
    shape: Shape

    def integer(self, low: int, high: int) -> int:
        """Return an integer from *low* to *high*, both included."""

    def order(self, count: int) -> list[int]:
        """Return the numbers below *count* in some order."""


class Seeded:
    """Choices of a random generator."""

    def __init__(self, rng: np.random.Generator, bits: int, shape: Shape) -> None:
        self.rng, self.bits, self.shape = rng, bits, shape

    def integer(self, low: int, high: int) -> int:
        return int(self.rng.integers(low, high + 1))

    def order(self, count: int) -> list[int]:
        return [int(i) for i in self.rng.permutation(count)]


class Drawn:
    """Choices of hypothesis, which it can make simpler."""

    def __init__(self, draw: st.DrawFn, bits: int, shape: Shape) -> None:
        self.draw, self.bits, self.shape = draw, bits, shape

    def integer(self, low: int, high: int) -> int:
        return self.draw(st.integers(low, high))

    def order(self, count: int) -> list[int]:
        return self.draw(st.permutations(range(count)))


def limits(bits: int, count: int) -> tuple[int, int]:
    """Return the least and the greatest coordinate on an axis of *count* voxels.

    They are MAX_SPAN apart and hold the grid in their middle.
    """
    low = -(1 << bits >> 1) - (MAX_SPAN - (count << bits)) // 2
    return low, low + MAX_SPAN


def position(source: Source, axis: int) -> int:
    """Return a coordinate near the grid: a half voxel more often than not, or a step beside one."""
    voxel, count = 1 << source.bits, source.shape[axis]
    halves = source.integer(-4, 2 * count + 3) * voxel // 2
    match source.integer(0, 7):
        case 0 | 1:
            found = halves
        case 2 | 3:
            found = source.integer(-1, count) * voxel
        case 4:
            found = source.integer(-1, count + 1) * voxel - voxel // 2
        case 5:
            found = halves + 1
        case 6:
            found = halves - 1
        case _:
            found = source.integer(-2 * voxel, (count + 2) * voxel)
    low, high = limits(source.bits, count)
    return min(max(found, low), high)


def points(source: Source, count: int) -> NDArray[np.int64]:
    """Return *count* positions near the grid."""
    return np.array(
        [[position(source, axis) for axis in range(3)] for _ in range(count)], dtype=np.int64
    )


def tetrahedron(source: Source) -> Mesh:
    """Any four points."""
    return points(source, 4), TETRAHEDRON


def double_pyramid(source: Source) -> Mesh:
    """Two points over a rim of any points."""
    rim = source.integer(3, 7)
    here = np.arange(rim)
    there = (here + 1) % rim
    up = np.stack([np.full(rim, rim), here, there], axis=1)
    down = np.stack([np.full(rim, rim + 1), there, here], axis=1)
    return points(source, rim + 2), _faces(np.concatenate([up, down]))


def box(source: Source) -> Mesh:
    """An axis-aligned box, perhaps a flat one."""
    one, other = points(source, 2)
    return _box(one, other)


def prism(source: Source) -> Mesh:
    """A polygon of any points, and the same moved; its sides are parallelograms."""
    rim = source.integer(3, 6)
    base = points(source, rim)
    shift = np.array([source.integer(-4, 4) << source.bits >> 1 for _ in range(3)])
    faces = []
    for i in range(rim):
        j = (i + 1) % rim
        faces += [[i, j, j + rim], [i, j + rim, i + rim]]
    for i in range(1, rim - 1):
        faces += [[0, i + 1, i], [rim, rim + i, rim + i + 1]]
    return _within(source, np.concatenate([base, base + shift])), _faces(faces)


def crumpled(source: Source) -> Mesh:
    """An icosahedron whose corners are anywhere."""
    return points(source, 12), ICOSAHEDRON


def ball(source: Source) -> Mesh:
    """A ball of 80 triangles, snapped to a coarser lattice, so that ties are many."""
    ball_points, faces = BALL
    coarse = 1 << max(source.bits - source.integer(0, 2), 0)
    center = points(source, 1)
    radii = [source.integer(1, 2 * count) << source.bits >> 1 for count in source.shape]
    whole = np.rint(ball_points * radii / coarse).astype(np.int64) * coarse
    return _within(source, center + whole), faces


def sliver(source: Source) -> Mesh:
    """A tetrahedron whose corners are pairwise a step apart at most."""
    ends = points(source, 2)
    beside = np.array([[source.integer(-1, 1) for _ in range(3)] for _ in range(2)])
    return _within(source, np.concatenate([ends, ends + beside])), TETRAHEDRON


def needle(source: Source) -> Mesh:
    """A far point over a triangle of a few steps."""
    ends = points(source, 2)
    beside = np.array([[source.integer(-2, 2) for _ in range(3)] for _ in range(2)])
    return _within(source, np.concatenate([ends, ends[:1] + beside])), TETRAHEDRON


def rod(source: Source) -> Mesh:
    """A box along the whole of the grid, from a step to a voxel thick."""
    along = source.integer(0, 2)
    low = points(source, 1)[0]
    high = low + [source.integer(0, 1 << source.bits) for _ in range(3)]
    low[along] = -2 << source.bits
    high[along] = (source.shape[along] + 2) << source.bits
    return _box(*_within(source, np.stack([low, high])))


def wall(source: Source) -> Mesh:
    """Two triangles over all of the grid and a point beside them: large, and nearly flat."""
    across = source.integer(0, 2)
    corners = np.array([[-1, -1], [2, -1], [2, 2], [-1, 2]]) * 2
    flat = np.zeros((5, 3), dtype=np.int64)
    for column, axis in enumerate(axis for axis in range(3) if axis != across):
        flat[:4, axis] = corners[:, column] * (source.shape[axis] << source.bits) // 2
    flat[:4, across] = position(source, across)
    flat[source.integer(0, 3), across] += source.integer(-1, 1)
    flat[4] = points(source, 1)[0]
    faces = [[0, 1, 2], [0, 2, 3], [1, 0, 4], [2, 1, 4], [3, 2, 4], [0, 3, 4]]
    return _within(source, flat), _faces(faces)


def wide(source: Source) -> Mesh:
    """A tetrahedron between the corners of all that the lattice allows."""
    corners = []
    for count in source.shape:
        low, high = limits(source.bits, count)
        ends = [low, low + 1, high - 1, high, 0]
        corners.append([ends[source.integer(0, 4)] for _ in range(4)])
    return np.array(corners, dtype=np.int64).T.copy(), TETRAHEDRON


def touching_boxes(source: Source) -> Mesh:
    """Two boxes that share a face."""
    low, high = np.sort(points(source, 2), axis=0)
    along = source.integer(0, 2)
    first, second = high.copy(), low.copy()
    first[along] = second[along] = (low[along] + high[along]) // 2
    return join([_box(low, first), _box(second, high)])


def twice(source: Source) -> Mesh:
    """A body and the same again, perhaps turned inside out, on vertices of its own."""
    vertices, faces = solid(source)
    again = faces[:, ::-1] if source.integer(0, 1) else faces
    return join([(vertices, faces), (vertices, again)])


def collapsed(source: Source) -> Mesh:
    """A body with vertices put on its edges, held shut by triangles without area."""
    vertices, faces = solid(source)
    spots, kept = vertices.tolist(), faces.tolist()
    for _ in range(source.integer(1, 4)):
        a, b, c = kept.pop(source.integer(0, len(kept) - 1))
        middle = [(p + q) // 2 for p, q in zip(spots[a], spots[b], strict=True)]
        exact = all((p + q) % 2 == 0 for p, q in zip(spots[a], spots[b], strict=True))
        m = len(spots)
        spots.append(middle if exact else spots[a])
        kept += [[a, m, c], [m, b, c], [a, b, m]]
    return np.array(spots, dtype=np.int64), _faces(kept)


def bodies(source: Source) -> Mesh:
    """Two or three bodies, which may overlap or turn their insides out."""
    found = []
    for _ in range(source.integer(2, 3)):
        vertices, faces = solid(source)
        found.append((vertices, faces[:, ::-1] if source.integer(0, 3) == 0 else faces))
    return join(found)


SOLIDS: dict[str, Callable[[Source], Mesh]] = {
    family.__name__: family
    for family in (
        tetrahedron, double_pyramid, box, prism, crumpled, ball, sliver, needle, rod, wall,
    )
}  # fmt: skip
"""Families of one body."""

FAMILIES = SOLIDS | {
    family.__name__: family for family in (wide, touching_boxes, twice, collapsed, bodies)
}
"""All families."""


def solid(source: Source) -> Mesh:
    """A mesh of any family of one body."""
    families = list(SOLIDS.values())
    return families[source.integer(0, len(families) - 1)](source)


def any_mesh(source: Source, families: Iterable[str] = FAMILIES) -> Mesh:
    """A mesh of any of *families*, its triangles in any order and begun at any corner."""
    names = list(families)
    vertices, faces = FAMILIES[names[source.integer(0, len(names) - 1)]](source)
    return vertices, np.roll(faces, source.integer(0, 2), axis=1)[source.order(len(faces))]


def closed_meshes(
    bits: int, shape: Shape, families: Iterable[str] = FAMILIES
) -> st.SearchStrategy[Mesh]:
    """Strategy of closed, oriented meshes around a grid of *shape* voxels of ``2**bits`` steps."""

    @st.composite
    def meshes(draw: st.DrawFn) -> Mesh:
        return any_mesh(Drawn(draw, bits, shape), families)

    return meshes()


def adversarial_meshes(
    seed: int,
    count: int,
    bits: int = 8,
    shape: Shape = (9, 8, 7),
    families: Iterable[str] = FAMILIES,
) -> list[Mesh]:
    """Return *count* meshes, of each family in turn, and the same for the same *seed*."""
    source = Seeded(np.random.default_rng(seed), bits, shape)
    names = list(families)
    return [any_mesh(source, [names[i % len(names)]]) for i in range(count)]


def join(meshes: Iterable[Mesh]) -> Mesh:
    """Return several meshes as one."""
    vertices, faces, count = [], [], 0
    for some, triangles in meshes:
        vertices.append(some)
        faces.append(triangles + np.int32(count))
        count += len(some)
    return np.concatenate(vertices), np.concatenate(faces)


def _box(one: NDArray[np.int64], other: NDArray[np.int64]) -> Mesh:
    low, high = np.minimum(one, other), np.maximum(one, other)
    corners = [[(high if i >> axis & 1 else low)[axis] for axis in range(3)] for i in range(8)]
    return np.array(corners, dtype=np.int64), BOX


def _within(source: Source, vertices: NDArray[np.int64]) -> NDArray[np.int64]:
    ends = np.array([limits(source.bits, count) for count in source.shape])
    return np.clip(vertices, ends[:, 0], ends[:, 1])


def _faces(faces: ArrayLike) -> NDArray[np.int32]:
    return np.array(faces, dtype=np.int32)


def _ball() -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """A unit icosahedron with every triangle cut in four."""
    golden = (1 + 5**0.5) / 2
    corners = [(0.0, p, q * golden) for q in (-1, 1) for p in (-1, 1)]
    turned = [c[-i:] + c[:-i] for i in range(3) for c in corners]
    spots = [np.array(c) / np.linalg.norm(c) for c in turned]
    middles: dict[tuple[int, int], int] = {}

    def middle(a: int, b: int) -> int:
        key = (min(a, b), max(a, b))
        if key not in middles:
            middles[key] = len(spots)
            halfway = spots[a] + spots[b]
            spots.append(halfway / np.linalg.norm(halfway))
        return middles[key]

    faces = []
    for a, b, c in ICOSAHEDRON.tolist():
        ab, bc, ca = middle(a, b), middle(b, c), middle(c, a)
        faces += [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]
    return np.array(spots), _faces(faces)


def _icosahedron() -> NDArray[np.int32]:
    """Faces, seen from outside counter-clockwise, on the corners that `_ball` begins with."""
    golden = (1 + 5**0.5) / 2
    corners = [(0.0, p, q * golden) for q in (-1, 1) for p in (-1, 1)]
    spots = np.array([c[-i:] + c[:-i] for i in range(3) for c in corners])
    faces = []
    for a in range(12):
        for b in range(a + 1, 12):
            for c in range(b + 1, 12):
                sides = [spots[b] - spots[a], spots[c] - spots[b], spots[a] - spots[c]]
                if all(np.isclose(np.linalg.norm(side), 2) for side in sides):
                    outside = np.dot(np.cross(sides[0], sides[1]), spots[a]) > 0
                    faces.append([a, b, c] if outside else [a, c, b])
    return _faces(faces)


TETRAHEDRON = _faces([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
BOX = _faces(
    [
        [0, 2, 3], [0, 3, 1], [4, 5, 7], [4, 7, 6],
        [0, 1, 5], [0, 5, 4], [2, 6, 7], [2, 7, 3],
        [0, 4, 6], [0, 6, 2], [1, 3, 7], [1, 7, 5],
    ]
)  # fmt: skip
ICOSAHEDRON = _icosahedron()
BALL = _ball()
