"""Combinations of models are those of their voxels, and rebricked models those of the twin."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from numpy.typing import NDArray

from clvox.grid import Shape
from clvox.ops.combine import Operation, combine, complement, full, rebrick
from clvox.ops.layout import VoxelArrays
from clvox.ops.query import expand
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
    """Compare the voxels; no bit of the padding, no cell that is both, bricks as ranked."""
    found = expand(session, arrays, (0, 0, 0), arrays.shape).view(np.bool_)
    np.testing.assert_array_equal(found, expected, strict=True)
    if arrays.cells is None or arrays.inside is None:
        np.testing.assert_array_equal(arrays.voxels.get(), twin.pack_bits(expected), strict=True)
        return
    boundary, inside = arrays.cells.boundary.get(), arrays.inside.get()
    assert not (boundary & inside).any()
    np.testing.assert_array_equal(arrays.cells.rank.get(), twin.rank(boundary), strict=True)
    nx = arrays.cells.shape[0]
    for words in (boundary, inside):
        bits = np.unpackbits(words.view(np.uint8), axis=2, bitorder="little")
        assert not bits[..., nx:].any()
    inside_only = np.zeros_like(expected)
    shape, brick = arrays.shape, arrays.cells.brick
    cells = np.unpackbits(boundary.view(np.uint8), axis=2, bitorder="little")[..., :nx] == 1
    whole = cells.repeat(brick[2], 0).repeat(brick[1], 1).repeat(brick[0], 2)
    whole = whole[: shape[2], : shape[1], : shape[0]]
    inside_only[whole] = expected[whole]
    # As many bits in bricks as voxels there: so none beyond the grid.
    stored = np.unpackbits(arrays.voxels.get().view(np.uint8)).sum()
    assert stored == np.count_nonzero(inside_only)


@pytest.mark.parametrize("op", Operation)
@every_model
def test_combinations_are_those_of_the_voxels(
    session: Session, shape: Shape, brick: Shape | None, op: Operation
) -> None:
    a, b = (sample(session, seed, shape, brick) for seed in (91, 92))
    for one, other in ((a, b), (b, a), (a, a)):
        expected = MEANINGS[op](one.voxels, other.voxels)
        check(session, combine(session, one.arrays, other.arrays, op), expected)


@pytest.mark.parametrize("op", Operation)
@pytest.mark.parametrize("brick", [None, (3, 5, 2)])
def test_the_other_may_have_other_bricks(
    session: Session, brick: Shape | None, op: Operation
) -> None:
    shape = (17, 9, 10)
    a, b = sample(session, 93, shape, brick), sample(session, 94, shape, (8, 8, 8))
    expected = MEANINGS[op](a.voxels, b.voxels)
    found = combine(session, a.arrays, b.arrays, op)
    assert found.levels[1:] == a.arrays.levels[1:]
    check(session, found, expected)


@every_model
def test_complements_end_where_the_grid_ends(
    session: Session, shape: Shape, brick: Shape | None
) -> None:
    a = sample(session, 95, shape, brick)
    check(session, complement(session, a.arrays), ~a.voxels)
    check(session, full(session, shape, brick), np.ones_like(a.voxels))


@pytest.mark.parametrize("new", [None, (8, 8, 8), (3, 5, 2), (1, 1, 1), (33, 7, 2)])
@every_model
def test_rebricked_models_equal_the_twin(
    session: Session, shape: Shape, brick: Shape | None, new: Shape | None
) -> None:
    """Bricks whose voxels are alike, of which a model may have any number, are dropped."""
    for source in (sample(session, 96, shape, brick).arrays, full(session, shape, brick)):
        voxels = expand(session, source, (0, 0, 0), shape).view(np.bool_)
        found = rebrick(session, source, new)
        if new is None:
            np.testing.assert_array_equal(found.voxels.get(), twin.pack_bits(voxels), strict=True)
            continue
        expected = twin.from_voxels(voxels, new)
        assert found.cells is not None
        assert found.inside is not None
        boundary = twin.pack_bits(expected.boundary)
        np.testing.assert_array_equal(found.cells.boundary.get(), boundary, strict=True)
        inside = twin.pack_bits(expected.inside)
        np.testing.assert_array_equal(found.inside.get(), inside, strict=True)
        words = twin.pack_bricks(expected.bricks)
        np.testing.assert_array_equal(found.voxels.get(), words, strict=True)
