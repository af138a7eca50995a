"""An array of voxels becomes the two-level model that the twin makes of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from numpy.typing import NDArray

from clvox.grid import Shape
from clvox.ops import pack
from clvox.ops.layout import VoxelArrays
from clvox.ops.query import expand
from clvox.reference import multilevel as twin

if TYPE_CHECKING:
    from clvox.device import Session

CASES: list[tuple[Shape, Shape]] = [
    ((9, 8, 7), (8, 8, 8)),
    ((16, 24, 8), (8, 8, 8)),
    ((300, 5, 9), (8, 8, 8)),
    ((5, 4, 3), (1, 1, 1)),
    ((10, 11, 9), (3, 5, 2)),
    ((70, 8, 5), (33, 7, 2)),
    ((23, 21, 12), (10, 10, 10)),
    ((1, 1, 1), (64, 64, 64)),
    ((65, 3, 66), (64, 64, 64)),
]
every_case = pytest.mark.parametrize(("shape", "brick"), CASES)


def lumps(seed: int, shape: Shape, brick: Shape) -> NDArray[np.bool_]:
    """Voxels of which a cell's are all in, all out, all but one of them alike, or any."""
    rng = np.random.default_rng(seed)
    voxels = np.zeros(shape[::-1], dtype=np.bool_)
    steps = [range(0, count, side) for count, side in zip(shape[::-1], brick[::-1], strict=True)]
    for z in steps[0]:
        for y in steps[1]:
            for x in steps[2]:
                cell = voxels[z : z + brick[2], y : y + brick[1], x : x + brick[0]]
                kind = rng.integers(0, 5)
                cell[...] = rng.random(cell.shape) < 0.5 if kind == 4 else kind % 2
                if kind in {2, 3}:
                    cell[tuple(rng.integers(0, cell.shape))] ^= True
    return voxels


def check(session: Session, arrays: VoxelArrays, voxels: NDArray[np.bool_], brick: Shape) -> None:
    """Compare all arrays with the twin's, and the voxels that come back."""
    expected = twin.from_voxels(voxels, brick)
    assert arrays.cells is not None
    assert arrays.inside is not None
    boundary = twin.pack_bits(expected.boundary)
    np.testing.assert_array_equal(arrays.cells.boundary.get(), boundary, strict=True)
    np.testing.assert_array_equal(arrays.cells.rank.get(), twin.rank(boundary), strict=True)
    inside = twin.pack_bits(expected.inside)
    np.testing.assert_array_equal(arrays.inside.get(), inside, strict=True)
    words = twin.pack_bricks(expected.bricks)
    np.testing.assert_array_equal(arrays.voxels.get(), words, strict=True)
    back = expand(session, arrays, (0, 0, 0), arrays.shape).view(np.bool_)
    np.testing.assert_array_equal(back, voxels, strict=True)


@every_case
def test_models_equal_the_twin(session: Session, shape: Shape, brick: Shape) -> None:
    for seed in range(3):
        voxels = lumps(seed, shape, brick)
        check(session, pack.pack_voxels(session, voxels, brick), voxels, brick)


@every_case
def test_in_slabs_it_is_the_same(
    session: Session, shape: Shape, brick: Shape, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One layer of cells at a time, and two."""
    voxels = lumps(81, shape, brick)
    for layers in (1, 2):
        monkeypatch.setattr(pack, "SLAB_BYTES", layers * shape[0] * shape[1] * brick[2])
        check(session, pack.pack_voxels(session, voxels, brick), voxels, brick)


@every_case
def test_uniform_arrays_have_no_brick(session: Session, shape: Shape, brick: Shape) -> None:
    for value in (False, True):
        voxels = np.full(shape[::-1], value)
        arrays = pack.pack_voxels(session, voxels, brick)
        check(session, arrays, voxels, brick)
        assert arrays.voxels.shape[0] == 0


@every_case
def test_the_twin_keeps_the_voxels(shape: Shape, brick: Shape) -> None:
    voxels = lumps(82, shape, brick)
    model = twin.from_voxels(voxels, brick)
    np.testing.assert_array_equal(model.to_array(), voxels, strict=True)
    assert not (model.boundary & model.inside).any()


@pytest.mark.parametrize("shape", [(1, 1, 1), (31, 2, 3), (32, 3, 2), (33, 4, 5), (70, 1, 2)])
def test_dense_grids_equal_the_twin(session: Session, shape: Shape) -> None:
    voxels = np.random.default_rng(83).random(shape[::-1]) < 0.5
    arrays = pack.pack_dense(session, voxels)
    np.testing.assert_array_equal(arrays.voxels.get(), twin.pack_bits(voxels), strict=True)
    back = expand(session, arrays, (0, 0, 0), shape).view(np.bool_)
    np.testing.assert_array_equal(back, voxels, strict=True)
