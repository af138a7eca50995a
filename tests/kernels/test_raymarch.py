"""The first voxel along each ray, against a look at all voxels."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from clvox.camera import Rays, View
from clvox.device import Session
from clvox.grid import Shape
from clvox.ops.layout import Cells, VoxelArrays, cell_shape
from clvox.ops.raymarch import march_surface
from clvox.reference.multilevel import pack_bits, pack_bricks, rank
from clvox.reference.raymarch import first_voxels

SIZE = 11, 9


@pytest.fixture(autouse=True)
def optimised(monkeypatch: pytest.MonkeyPatch) -> None:
    """Oclgrind crashes on this kernel unless it is optimised, on others if they are."""
    monkeypatch.delenv("PYOPENCL_BUILD_OPTIONS", raising=False)


BRICKS = (8, 8, 8), (2, 4, 3), (3, 5, 2), (4, 4, 4)


def solid(rng: np.random.Generator) -> NDArray[np.bool_]:
    """A box of voxels, some of them inside, few or many."""
    shape = rng.integers(1, 12, 3)
    voxels: NDArray[np.bool_] = rng.random(shape) < rng.choice([0.03, 0.2, 0.8, 1.0])
    return voxels


def dense(session: Session, voxels: NDArray[np.bool_]) -> VoxelArrays:
    return VoxelArrays(shape_of(voxels), session.upload(pack_bits(voxels)))


def two_levels(session: Session, voxels: NDArray[np.bool_], brick: Shape) -> VoxelArrays:
    """With a brick in some cells that need none; cells beyond the grid are what the rest is."""
    shape = shape_of(voxels)
    cells = cell_shape(shape, brick)
    padding = [(0, n * m - k) for n, m, k in zip(cells, brick, shape, strict=True)][::-1]
    sides = [side for pair in zip(cells[::-1], brick[::-1], strict=True) for side in pair]

    def blocks(array: NDArray[np.bool_], beyond: bool) -> NDArray[np.bool_]:
        padded = np.pad(array, padding, constant_values=beyond)
        return padded.reshape(sides).transpose(0, 2, 4, 1, 3, 5)

    some = blocks(voxels, False).any(axis=(3, 4, 5))
    every = blocks(voxels, True).all(axis=(3, 4, 5))
    spare = np.arange(some.size).reshape(some.shape) % 5 == 0
    boundary = (some & ~every) | spare
    words = pack_bits(boundary)
    bricks = pack_bricks(blocks(voxels, False)[boundary])
    ranks = session.upload(rank(words))
    held = Cells(cells, brick, session.upload(words), ranks, len(bricks))
    inside = session.upload(pack_bits(every & ~boundary))
    return VoxelArrays(shape, session.upload(bricks), held, inside)


def models(
    session: Session, voxels: NDArray[np.bool_], rng: np.random.Generator
) -> list[VoxelArrays]:
    brick = BRICKS[rng.integers(len(BRICKS))]
    return [dense(session, voxels), two_levels(session, voxels, brick)]


def shape_of(voxels: NDArray[np.bool_]) -> Shape:
    nz, ny, nx = voxels.shape
    return nx, ny, nz


@given(seed=st.integers(0, 2**32 - 1))
def test_rays_through_edges_and_corners(session: Session, seed: int) -> None:
    """Places and directions are small integers, so that rays run through edges all the time."""
    rng = np.random.default_rng(seed)
    voxels = solid(rng)
    direction = rng.integers(-2, 3, 3)
    direction[rng.integers(3)] = rng.choice([-1, 1])
    triples = [direction, *(8 * rng.integers(-2, 3, (2, 3))), 8 * rng.integers(-8, 20, 3)]
    ahead, right, down, start = ((int(x), int(y), int(z)) for x, y, z in triples)
    rays = Rays(4, 0, 1 << 20, ahead, start, right, down)
    expected = first_voxels(voxels, rays, SIZE)
    for arrays in models(session, voxels, rng):
        np.testing.assert_array_equal(march_surface(session, arrays, rays, SIZE).get(), expected)


@given(seed=st.integers(0, 2**32 - 1))
def test_rays_of_views(session: Session, seed: int) -> None:
    """As pictures are taken: from anywhere, also along an axis, with unequal spacings."""
    rng = np.random.default_rng(seed)
    voxels = solid(rng)
    shape = shape_of(voxels)
    axis = np.eye(3)[rng.integers(3)] * rng.choice([-1, 1])
    direction = rng.normal(size=3) if rng.random() < 0.7 else axis
    spacing = rng.choice([0.1, 1.0, 3.0], 3)
    view = View.fit(
        [(0, 0, 0), shape], shape, spacing, SIZE, direction=direction, up=rng.normal(size=3)
    )
    expected = first_voxels(voxels, view.rays, SIZE)
    for arrays in models(session, voxels, rng):
        got = march_surface(session, arrays, view.rays, SIZE).get()
        np.testing.assert_array_equal(got, expected)


def test_most_rays_of_a_view_of_a_full_box_hit(session: Session) -> None:
    """Two programs that never find anything would agree, too."""
    voxels = np.ones((4, 5, 6), bool)
    rays = View.fit(
        [(0, 0, 0), (6, 5, 4)], (6, 5, 4), (1, 1, 1), SIZE, direction=(-1, 2, -1), up=(0, 0, 1)
    ).rays
    hits = march_surface(session, two_levels(session, voxels, (8, 8, 8)), rays, SIZE).get()
    assert (hits[..., 0] >= 0).mean() > 0.4
    assert (hits[0, 0] == -1).all()


@pytest.mark.parametrize("size", [(0, 5), (1, 1), (7, 9), (8, 8), (13, 5)])
def test_any_number_of_rays(session: Session, size: tuple[int, int]) -> None:
    """None, one, and one below, at and above that of a work-group."""
    voxels = np.ones((2, 2, 2), bool)
    rays = Rays(4, 0, 1 << 20, (1, 3, 2), (-40, 3, 5), (3, 1, 0), (0, 2, 3))
    hits = march_surface(session, dense(session, voxels), rays, size).get()
    np.testing.assert_array_equal(hits, first_voxels(voxels, rays, size))


def test_rays_far_off_miss(session: Session) -> None:
    """Their moments would not fit; nothing may come of it but a miss."""
    voxels = np.ones((2, 2, 2), bool)
    rays = Rays(16, 0, 1 << 30, (1 << 17, 3, 5), (0, 1 << 60, 0), (0, 1 << 50, 0), (0, 0, 1))
    hits = march_surface(session, two_levels(session, voxels, (2, 2, 2)), rays, SIZE).get()
    assert (hits == -1).all()


def test_voxels_beyond_the_grid_are_never_met(session: Session) -> None:
    """A cell that is wholly inside may reach beyond the grid."""
    voxels = np.ones((9, 9, 9), bool)
    arrays = two_levels(session, voxels, (8, 8, 8))
    for direction in ((-1, -1, -1), (1, -1, 2), (-3, 1, 1), (0, 0, -1)):
        rays = View.fit(
            [(0, 0, 0), (9, 9, 9)], (9, 9, 9), (1, 1, 1), SIZE, direction=direction, up=(0, 1, 0)
        ).rays
        hits = march_surface(session, arrays, rays, SIZE).get()
        assert hits.max() == 8


@given(
    shape=st.tuples(*[st.sampled_from([1, 7, 512, 131072])] * 3),
    spacing=st.tuples(*[st.sampled_from([0.01, 1.0, 5.0])] * 3),
    direction=st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda d: max(map(abs, d)) > 1e-3),
    size=st.sampled_from([(1, 1), (3840, 2160), (32768, 2), (2, 32768)]),
)
@settings(max_examples=200)
def test_moments_fit_into_64_bits(
    shape: Shape, spacing: tuple[float, ...], direction: tuple[float, ...], size: tuple[int, int]
) -> None:
    """Of every ray that is followed, at all planes of the grid and of a cell beyond it."""
    up = (0.3, 0.5, 0.7)
    if np.linalg.norm(np.cross(direction, up)) < 1e-2:
        up = (0.7, 0.5, 0.3)
    rays = View.fit([(0, 0, 0), shape], shape, spacing, size, direction=direction, up=up).rays
    parts = [max(1, abs(part)) for part in rays.direction]
    for axis in range(3):
        pace = parts[0] * parts[1] * parts[2] // parts[axis]
        ends = [
            rays.start[axis] + u * rays.right[axis] + v * rays.down[axis]
            for u in (0, size[0])
            for v in (0, size[1])
        ]
        assert max(map(abs, ends)) < 2**63
        # A place, mirrored or not, and the planes of the padded grid and of one more cell.
        farthest = rays.reach + ((shape[axis] + 3 * 64) << rays.bits)
        assert farthest * pace < 2**63
        # A ray through the middle of the grid is followed.
        middle = rays.start[axis] + size[0] // 2 * rays.right[axis] + size[1] // 2 * rays.down[axis]
        assert abs(middle >> rays.fraction) < rays.reach
