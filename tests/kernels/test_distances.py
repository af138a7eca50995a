"""Distances to what is not empty, and rays that begin where they say nothing is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from pyopencl.array import Array

from clvox.camera import Camera
from clvox.device import Session
from clvox.grid import Grid, Shape
from clvox.ops.attributes import number_touched
from clvox.ops.beams import TILE, find_beams, find_starts
from clvox.ops.distances import MOST, measure_distances, take_crumbs
from clvox.ops.layout import VoxelArrays
from clvox.ops.multilevel import rank_cells
from clvox.ops.raymarch import Pixels, Scene, march, measure_lengths
from clvox.reference.multilevel import pack_bits
from clvox.reference.raymarch import block_kinds, brick_crumbs
from tests.kernels.cases import INTERPRETED
from tests.kernels.solids import pack

SIZE = 19, 13


def model(session: Session, seed: int, cells: Shape, brick: Shape, share: float) -> VoxelArrays:
    """Cells at random, some of them inside, and no voxels in the bricks but a few."""
    rng = np.random.default_rng(seed)
    boundary, inside = rng.random((2, *cells[::-1])) < share
    held = rank_cells(session, session.upload(pack_bits(boundary)), cells, brick)
    words = rng.integers(0, 2**32, (held.count, held.brick_words), np.uint32)
    words &= rng.integers(0, 2**32, words.shape, np.uint32)
    # Bits behind the last voxel of a brick are zero.
    words[:, -1] &= np.uint32(2 ** (np.prod(brick) % 32 or 32) - 1)
    shape = tuple(count * side for count, side in zip(cells, brick, strict=True))
    inner = session.upload(pack_bits(inside & ~boundary))
    return VoxelArrays((shape[0], shape[1], shape[2]), session.upload(words), held, inner)


def unpack(words: Array, shape: Shape) -> NDArray[np.bool_]:
    """Bits of a grid, [z, y, x]."""
    bits = np.unpackbits(words.get().view(np.uint8), axis=-1, bitorder="little")
    return bits.reshape(shape[2], shape[1], -1)[..., : shape[0]] > 0


def any_in_blocks(cells: NDArray[np.bool_], blocks: Shape, side: int) -> NDArray[np.bool_]:
    """Whether any of the cells of each block is set, [z, y, x]; beyond the grid none is."""
    x, y, z = blocks
    padded = np.zeros((z * side, y * side, x * side), dtype=np.bool_)
    padded[tuple(slice(count) for count in cells.shape)] = cells
    result: NDArray[np.bool_] = padded.reshape(z, side, y, side, x, side).max(axis=(1, 3, 5))
    return result


@pytest.mark.parametrize("most_blocks", [1 << 20, 100, 7])
@pytest.mark.parametrize(
    ("cells", "share"), [((9, 7, 5), 0.02), ((37, 3, 4), 0.005), ((4, 4, 4), 0.0), ((1, 1, 1), 1.0)]
)
def test_distances(session: Session, most_blocks: int, cells: Shape, share: float) -> None:
    arrays = model(session, 3, cells, (2, 2, 2), share)
    found = measure_distances(session, arrays, most_blocks=most_blocks)
    assert arrays.cells is not None
    assert arrays.inside is not None
    side = found.side[0] // 2
    assert np.prod(found.shape) <= most_blocks
    boundary, inside = unpack(arrays.cells.boundary, cells), unpack(arrays.inside, cells)
    occupied = any_in_blocks(boundary | inside, found.shape, side)
    full = ~any_in_blocks(~inside, found.shape, side)
    x, y, z = found.shape
    expected = block_kinds(occupied, full, min(MOST, max(found.shape)))
    np.testing.assert_array_equal(found.values.get().reshape(z, y, x), expected)


@pytest.mark.parametrize("touched", [False, True])
def test_distances_of_a_dense_model(session: Session, touched: bool) -> None:
    """Its voxels are the cells, eight to a block; and those that are touched are not empty."""
    rng = np.random.default_rng(7)
    voxels = rng.random((37, 20, 70)) < 1e-4
    voxels[5:30, :, 20:50] = True
    arrays = VoxelArrays((70, 20, 37), session.upload(pack_bits(voxels)))
    edge = rng.random(voxels.shape) < 1e-4
    assert (edge & ~voxels).any()
    marks = session.upload(pack_bits(edge)) if touched else None
    found = measure_distances(session, arrays, marks)
    assert found.shape == (9, 3, 5)
    assert found.side == (8, 8, 8)
    taken = (voxels | edge) if touched else voxels
    occupied = any_in_blocks(taken, found.shape, 8)
    full = ~any_in_blocks(~voxels, found.shape, 8)
    assert full.any()
    expected = block_kinds(occupied, full, MOST)
    np.testing.assert_array_equal(found.values.get().reshape(5, 3, 9), expected)


def test_one_word_tells_all_about_a_cell(session: Session) -> None:
    """Its brick; or how far it is from cells of another kind."""
    arrays = model(session, 4, (9, 7, 5), (2, 2, 2), 0.3)
    found = measure_distances(session, arrays)
    assert found.states is not None
    assert arrays.cells is not None
    assert arrays.inside is not None
    shape = 9, 7, 5
    boundary, inside = unpack(arrays.cells.boundary, shape), unpack(arrays.inside, shape)
    expected = 0xFFFFFF00 + block_kinds(boundary | inside, inside, MOST).astype(np.int64)
    expected[boundary] = np.arange(boundary.sum())
    np.testing.assert_array_equal(found.states.get().reshape(5, 7, 9), expected)


@pytest.mark.parametrize("brick", [(8, 8, 8), (3, 5, 2), (40, 6, 4), (1, 1, 1)])
@pytest.mark.parametrize("touched", [False, True])
def test_crumbs_of_bricks(session: Session, brick: Shape, touched: bool) -> None:
    """Every part of a brick that a voxel reaches into, inside or touched; no other."""
    arrays = model(session, 5, (4, 3, 2), brick, 0.4)
    words = arrays.voxels.get() & np.random.default_rng(5).integers(
        0, 2**32, arrays.voxels.shape, np.uint32
    )
    arrays = replace(arrays, voxels=session.upload(words))
    x, y, z = brick
    marks = np.where(np.arange(words.shape[1]) < 1, np.uint32(1), np.uint32(0)) | 0 * words
    found = take_crumbs(session, arrays, session.upload(marks) if touched else None)
    assert found is not None
    taken = (words | marks) if touched else words
    bits = np.unpackbits(taken.view(np.uint8), axis=-1, bitorder="little")[:, : x * y * z]
    expected = [brick_crumbs(one.reshape(z, y, x) > 0) for one in bits]
    np.testing.assert_array_equal(found.get(), np.array(expected, np.uint64))


@given(seed=st.integers(0, 2**32 - 1), parallel=st.booleans(), most=st.sampled_from([1 << 20, 60]))
def test_starts_change_nothing(session: Session, seed: int, parallel: bool, most: int) -> None:
    """Of what is met, and of how long rays are within; from anywhere, and with any spacing."""
    rng = np.random.default_rng(seed)
    share = float(rng.choice([0.003, 0.03, 0.9]))
    arrays = model(session, seed, (8, 9, 7), (3, 2, 4), share)
    touched = None
    if rng.random() < 0.3:
        voxels, edge = rng.random((2, 20, 30, 40)) < rng.choice([1e-4, 1e-3], (2, 1, 1, 1))
        arrays = VoxelArrays((40, 30, 20), session.upload(pack_bits(voxels)))
        if rng.random() < 0.7:
            touched = number_touched(session, arrays, session.upload(pack_bits(edge)))
    spacing = tuple(rng.choice([0.3, 1.0, 2.0], 3).tolist())
    grid = Grid((0, 0, 0), spacing, arrays.shape)
    low, high = grid.bounds
    eye, target = rng.uniform(low - (high - low), high + (high - low)), rng.uniform(low, high)
    height = float((high - low).max()) if parallel else None
    camera = Camera(tuple(eye), tuple(target), tuple(rng.normal(size=3)), height=height)
    samples = int(rng.integers(1, 3))
    view = camera.view(grid, (SIZE[0] * samples**2, SIZE[1] * samples**2))
    scene = Scene(arrays, grid.spacing, touched)
    distances = measure_distances(session, arrays, scene.edge, most_blocks=most)
    beams = find_beams(session, distances, arrays, view.rays, SIZE, samples**2)
    for each in (False, True):
        pixels = Pixels.whole(SIZE, samples, each=each)
        hits = [march(session, scene, view, pixels, known) for known in (None, beams)]
        first, second = (found.voxels.get() for found in hits)
        # What is met is the same; along which axis may differ where a ray begins in the voxel.
        np.testing.assert_array_equal(first[..., :3], second[..., :3])
        lengths = [
            measure_lengths(session, scene, view, pixels, known).get() for known in (None, beams)
        ]
        np.testing.assert_array_equal(lengths[0], lengths[1])


@pytest.mark.parametrize("sides", [((1, 64, 64), (1, 16, 16)), ((1, 64, 64),)])
@pytest.mark.parametrize("direction", [(-1, -0.9, -0.8), (1, 0.8, -0.9), (-0.2, 1, 0.7)])
def test_blocks_of_unequal_sides_change_nothing(
    session: Session, sides: tuple[Shape, ...], direction: tuple[float, float, float]
) -> None:
    """So many free blocks along one axis are a thousand times as far as the grid along another."""
    voxels = np.zeros((40, 40, 64), bool)
    voxels[5:33, 7:38, 58:63] = True
    voxels[12:30, 9:31, 1:3] = True
    arrays, grid = pack(session, voxels, sides), Grid((0, 0, 0), 1.0, (64, 40, 40))
    distances = measure_distances(session, arrays)
    assert distances.shape == (64, 1, 1)
    assert (distances.values.get() & 127).max() > 20
    view = Camera.around(grid, direction=direction, parallel=True).view(grid, SIZE)
    scene, pixels = Scene(arrays, grid.spacing), Pixels.whole(SIZE)
    beams = find_beams(session, distances, arrays, view.rays, SIZE)
    first, second = (
        march(session, scene, view, pixels, known).voxels.get() for known in (None, beams)
    )
    assert 0.05 < (first[:, 0] >= 0).mean() < 0.9
    np.testing.assert_array_equal(first[:, :3], second[:, :3])
    one, other = (
        measure_lengths(session, scene, view, pixels, known).get() for known in (None, beams)
    )
    np.testing.assert_array_equal(one, other)


@pytest.mark.skipif(INTERPRETED, reason="its kernels are looked at by the other tests")
@pytest.mark.parametrize("most", [1 << 22, 5000])
def test_long_ways_change_nothing(session: Session, most: int) -> None:
    """Through empty space and through the inside, from within and from outside."""
    rng = np.random.default_rng(8)
    cells = 40, 30, 50
    arrays = model(session, 8, cells, (4, 4, 4), 2e-4)
    assert arrays.inside is not None
    # A large block of the cells is wholly inside.
    inner = np.zeros(cells[::-1], bool)
    inner[10:40, 5:25, 8:33] = True
    assert arrays.cells is not None
    held = arrays.cells.boundary.get()
    solid = replace(arrays, inside=session.upload(pack_bits(inner) & ~held))
    scene, grid = Scene(solid, (1.0, 1.0, 1.0)), Grid((0, 0, 0), 1.0, arrays.shape)
    distances = measure_distances(session, solid, most_blocks=most)
    for _ in range(6):
        low, high = grid.bounds
        eye = rng.uniform(low - 100, high + 100)
        view = Camera(tuple(eye), tuple(rng.uniform(low, high)), fov=70.0).view(grid, (64, 48))
        pixels = Pixels.whole((64, 48))
        beams = find_beams(session, distances, solid, view.rays, (64, 48))
        first, second = (
            march(session, scene, view, pixels, known).voxels.get()[:, :3]
            for known in (None, beams)
        )
        np.testing.assert_array_equal(first, second)
        one, other = (
            measure_lengths(session, scene, view, pixels, known).get() for known in (None, beams)
        )
        np.testing.assert_array_equal(one, other)


@pytest.mark.skipif(INTERPRETED, reason="its kernels are looked at by the other tests")
def test_most_rays_skip_much(session: Session) -> None:
    """Starts that are all 0 would change nothing, too."""
    arrays = model(session, 1, (32, 32, 32), (2, 2, 2), 0.0005)
    grid = Grid((0, 0, 0), 1.0, arrays.shape)
    view = Camera.around(grid).view(grid, (64, 64))
    distances = measure_distances(session, arrays)
    starts = find_starts(session, distances, arrays.shape, view.rays, (64, 64)).get()
    assert starts.shape == (64,)
    assert (starts > 0).all()
    assert np.isinf(starts).any()


@pytest.mark.skipif(INTERPRETED, reason="its kernels are looked at by the other tests")
@pytest.mark.parametrize("most", [1 << 22, 5000])
def test_small_tiles_go_on(session: Session, most: int) -> None:
    """No farther than to what the first of their rays meets, and on average most of the way."""
    arrays = model(session, 9, (32, 32, 32), (8, 8, 8), 0.01)
    grid, size = Grid((0, 0, 0), 1.0, arrays.shape), (256, 256)
    view = Camera.around(grid, fov=30.0).view(grid, size)
    distances = measure_distances(session, arrays, most_blocks=most)
    wide = find_starts(session, distances, arrays.shape, view.rays, size)
    beams = find_beams(session, distances, arrays, view.rays, size)
    assert beams is not None
    assert beams.tile < TILE
    far = march(session, Scene(arrays, grid.spacing), view, Pixels.whole(size)).far.get()
    side = size[0] // beams.tile
    nearest = far.reshape(side, beams.tile, side, beams.tile).min(axis=(1, 3)).ravel()
    starts, met = beams.starts.get(), np.isfinite(nearest)
    assert (starts[met] <= nearest[met]).all()
    before = np.kron(wide.get().reshape(32, 32), np.ones((2, 2))).ravel()
    gone = (starts[met] - before[met]) / (nearest[met] - before[met])
    assert np.median(gone) > 0.3
