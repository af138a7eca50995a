"""Combinations of models are those of their voxels, and rebricked models those of the twin."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import pyopencl.array as cla
import pytest
from numpy.typing import NDArray

from clvox.grid import Shape
from clvox.ops.combine import Operation, combine, complement, full, rebrick
from clvox.ops.layout import VoxelArrays, cell_shape
from clvox.ops.multilevel import list_bricks, list_bricks_below
from clvox.ops.query import expand, expand_cells
from clvox.reference import multilevel as twin
from tests.kernels.models import MODELS, sample

if TYPE_CHECKING:
    from clvox.device import Session

every_model = pytest.mark.parametrize(("shape", "brick"), MODELS)

MEANINGS: dict[Operation, Callable[[NDArray[Any], NDArray[Any]], NDArray[Any]]] = {
    Operation.UNION: np.logical_or,
    Operation.INTERSECTION: np.logical_and,
    Operation.DIFFERENCE: lambda a, b: a & ~b,
    Operation.XOR: np.logical_xor,
}


def check(session: Session, arrays: VoxelArrays, expected: NDArray[np.bool_]) -> None:
    """Compare the voxels; no cell is both, and no bit of the padding is set."""
    found = expand(session, arrays, (0, 0, 0), arrays.shape).view(np.bool_)
    np.testing.assert_array_equal(found, expected, strict=True)
    stored = bits_in(arrays.voxels)
    if arrays.cells is None or arrays.inside is None:
        assert stored == np.count_nonzero(expected)
        return
    assert not (arrays.cells.boundary.get() & arrays.inside.get()).any()
    assert arrays.cells.count == bits_in(arrays.cells.boundary)
    states = expand_cells(session, arrays, (0, 0, 0), arrays.cells.shape)
    assert np.count_nonzero(states == 1) == bits_in(arrays.inside)
    if arrays.cells.finer is not None and arrays.middle_inside is not None:
        finer = arrays.cells.finer
        assert not (finer.boundary.get() & arrays.middle_inside.get()).any()
        assert finer.count == bits_in(finer.boundary)
        states = expand_cells(session, arrays, (0, 0, 0), finer.shape, 1)
        assert np.count_nonzero(states == 2) == finer.count
        owners = list_bricks(session, arrays.cells)
        x, y, z = list_bricks_below(session, finer, owners, arrays.cells.brick).get().T
        assert (states[z, y, x] == 2).all()
    # As many bits in bricks as voxels below such cells: so none beyond the grid.
    nx, ny, nz = arrays.shape
    bx, by, bz = arrays.cells.last.brick
    below = states.repeat(bz, 0).repeat(by, 1).repeat(bx, 2)[:nz, :ny, :nx] == 2
    assert stored == np.count_nonzero(expected & below)


def bits_in(words: cla.Array) -> int:
    """How many bits are set."""
    return int(np.unpackbits(words.get().view(np.uint8)).sum())


@pytest.mark.parametrize("op", Operation)
@every_model
def test_combinations_are_those_of_the_voxels(
    session: Session, shape: Shape, brick: Shape | None, op: Operation
) -> None:
    a, b = (sample(session, seed, shape, brick) for seed in (91, 92))
    for one, other in ((a, b), (b, a), (a, a)):
        expected = MEANINGS[op](one.voxels, other.voxels)
        check(session, combine(session, one.arrays, other.arrays, op), expected)


LEVELS: list[tuple[Shape, ...]] = [
    (),
    ((8, 8, 8),),
    ((3, 5, 2),),
    ((1, 1, 1),),
    ((33, 7, 2),),
    ((2, 3, 2), (4, 2, 3)),
    ((5, 1, 2), (8, 8, 8)),
]
"""Bricks, level by level; none for a dense grid."""

every_new = pytest.mark.parametrize("new", LEVELS, ids=str)


def levels_for(shape: Shape, bricks: tuple[Shape, ...]) -> tuple[Shape, ...]:
    """The coarse grid and those bricks, or the dense grid."""
    x, y, z = (math.prod(brick[axis] for brick in bricks) for axis in range(3))
    return (cell_shape(shape, (x, y, z)), *bricks)


@pytest.mark.parametrize("op", Operation)
@every_new
def test_the_other_may_have_other_levels(
    session: Session, new: tuple[Shape, ...], op: Operation
) -> None:
    """And so all kinds of models meet, with three levels among them."""
    shape = (17, 9, 10)
    a, b = sample(session, 93, shape, (4, 4, 4)), sample(session, 94, shape, (8, 8, 8))
    one = rebrick(session, a.arrays, levels_for(shape, new))
    for other, voxels in ((b.arrays, b.voxels), (one, a.voxels)):
        found = combine(session, one, other, op)
        assert found.levels == one.levels
        check(session, found, MEANINGS[op](a.voxels, voxels))


@every_new
def test_complements_end_where_the_grid_ends(session: Session, new: tuple[Shape, ...]) -> None:
    for shape, brick in MODELS:
        a = sample(session, 95, shape, brick)
        levels = levels_for(shape, new)
        check(session, complement(session, rebrick(session, a.arrays, levels)), ~a.voxels)
        check(session, full(session, shape, levels), np.ones_like(a.voxels))


@every_new
@every_model
def test_pruned_models_equal_the_twin(
    session: Session, shape: Shape, brick: Shape | None, new: tuple[Shape, ...]
) -> None:
    """Bricks whose voxels are alike, of which a model may have any number, are dropped."""
    levels = levels_for(shape, new)
    for source in (
        sample(session, 96, shape, brick).arrays,
        full(session, shape, levels_for(shape, () if brick is None else (brick,))),
    ):
        voxels = expand(session, source, (0, 0, 0), shape).view(np.bool_)
        found = rebrick(session, source, levels, prune=True)
        check(session, found, voxels)
        check(session, rebrick(session, source, levels), voxels)
        if found.cells is None or found.inside is None:
            continue
        sides = tuple(math.prod(brick[axis] for brick in new) for axis in range(3))
        expected = twin.from_voxels(voxels, (sides[0], sides[1], sides[2]))
        boundary = twin.pack_bits(expected.boundary)
        np.testing.assert_array_equal(found.cells.boundary.get(), boundary, strict=True)
        inside = twin.pack_bits(expected.inside)
        np.testing.assert_array_equal(found.inside.get(), inside, strict=True)
        if found.cells.finer is None:
            words = twin.pack_bricks(expected.bricks)
            np.testing.assert_array_equal(found.voxels.get(), words, strict=True)
