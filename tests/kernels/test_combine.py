"""Combinations of models, and models in other bricks, against NumPy."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from clvox.device import Session
from clvox.grid import Shape
from clvox.ops.combine import Operation, combine, complement, full, rebrick
from tests.kernels.solids import SIZES, Voxels, pack, solid, uniform_bricks, unpack

TWINS: dict[Operation, Callable[[Voxels, Voxels], Voxels]] = {
    Operation.UNION: np.logical_or,
    Operation.INTERSECTION: np.logical_and,
    Operation.DIFFERENCE: lambda a, b: a & ~b,
    Operation.XOR: np.logical_xor,
}


@pytest.mark.parametrize("operation", Operation)
@pytest.mark.parametrize("shape, brick", SIZES)
def test_combination(
    session: Session, shape: Shape, brick: Shape | None, operation: Operation
) -> None:
    """Cells of all nine pairs of states occur; the padding stays zero."""
    a, b = solid(1, shape, brick), solid(2, shape, brick)
    found = combine(session, pack(session, a, brick), pack(session, b, brick), operation)
    assert found.levels == pack(session, a, brick).levels
    assert (unpack(found) == TWINS[operation](a, b)).all()


@pytest.mark.parametrize("operation", Operation)
def test_only_what_may_be_mixed_has_a_brick(session: Session, operation: Operation) -> None:
    """A cell that one operand decides alone has none: mixed or outside is mixed or inside."""
    states = np.indices((3, 3)).reshape(2, 9)
    a, b = (np.stack([row > 0, row == 1], axis=-1).reshape(1, 1, 18) for row in states)
    brick = 2, 1, 1
    one, other = (pack(session, voxels, brick) for voxels in (a, b))
    found = combine(session, one, other, operation)
    assert found.cells is not None
    possible = [
        {TWINS[operation](np.array(p), np.array(q)).item() for p in _values(s) for q in _values(t)}
        for s, t in states.T.tolist()
    ]
    mixed = sum((len(values) == 2) << cell for cell, values in enumerate(possible))
    assert found.cells.boundary.get().tolist() == [[[mixed]]]
    assert (unpack(found) == TWINS[operation](a, b)).all()


def _values(state: int) -> list[bool]:
    """What the voxels of a cell may be: all out, all in, or mixed."""
    return [[False], [True], [False, True]][state]


@pytest.mark.parametrize("operation", Operation)
@pytest.mark.parametrize("other", [None, (1, 1, 1), (8, 8, 8), (3, 5, 7), (40, 2, 2)])
@pytest.mark.parametrize("brick", [None, (8, 8, 8), (5, 3, 4)])
def test_combination_of_different_bricks(
    session: Session, brick: Shape | None, other: Shape | None, operation: Operation
) -> None:
    """The result has bricks like the first operand's."""
    shape = 35, 9, 10
    a, b = solid(3, shape, brick), solid(4, shape, other)
    found = combine(session, pack(session, a, brick), pack(session, b, other), operation)
    assert found.levels[1:] == (() if brick is None else (brick,))
    assert (unpack(found) == TWINS[operation](a, b)).all()


@pytest.mark.parametrize("shape, brick", SIZES)
def test_complement(session: Session, shape: Shape, brick: Shape | None) -> None:
    """Of the grid's box: what pads words and bricks is not in it."""
    a = solid(5, shape, brick)
    assert (unpack(complement(session, pack(session, a, brick))) == ~a).all()


@pytest.mark.parametrize("shape, brick", SIZES)
def test_full_and_empty(session: Session, shape: Shape, brick: Shape | None) -> None:
    """Neither has a brick, and combinations of the two have none."""
    solid_box = full(session, shape, brick)
    assert unpack(solid_box).all()
    nothing = complement(session, solid_box)
    assert not unpack(nothing).any()
    for operation in Operation:
        found = combine(session, solid_box, nothing, operation)
        assert (unpack(found) == TWINS[operation](np.array(True), np.array(False))).all()
        assert brick is None or len(found.voxels) == 0


@pytest.mark.parametrize("brick", [None, (1, 1, 1), (8, 8, 8), (5, 3, 4), (64, 1, 2)])
@pytest.mark.parametrize("shape, source", SIZES)
def test_rebrick(session: Session, shape: Shape, source: Shape | None, brick: Shape | None) -> None:
    """The same voxels, and a brick only where they differ."""
    voxels = solid(6, shape, source)
    found = rebrick(session, pack(session, voxels, source), brick)
    assert (unpack(found) == voxels).all()
    assert brick is None or uniform_bricks(found) == 0


def test_rebrick_prunes(session: Session) -> None:
    """Combining leaves bricks that are all alike; the same bricks anew are without."""
    brick = 4, 4, 4
    a = solid(7, (21, 18, 13), brick)
    one = pack(session, a, brick)
    for operation, voxels in ((Operation.XOR, a & False), (Operation.UNION, a)):
        left = combine(session, one, one, operation)
        pruned = rebrick(session, left, brick)
        assert (unpack(pruned) == voxels).all()
        assert uniform_bricks(pruned) == 0
    assert uniform_bricks(combine(session, one, one, Operation.XOR)) > 0
