"""Combinations of models, and models in other bricks, against NumPy."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from clvox.device import Session
from clvox.grid import Shape
from clvox.ops.combine import Operation, combine, complement, full, rebrick
from tests.kernels.solids import (
    SIZES,
    Sides,
    Voxels,
    levels_of,
    pack,
    solid,
    uniform_bricks,
    unpack,
)

TWINS: dict[Operation, Callable[[Voxels, Voxels], Voxels]] = {
    Operation.UNION: np.logical_or,
    Operation.INTERSECTION: np.logical_and,
    Operation.DIFFERENCE: lambda a, b: a & ~b,
    Operation.XOR: np.logical_xor,
}


@pytest.mark.parametrize("operation", Operation)
@pytest.mark.parametrize("shape, sides", SIZES)
def test_combination(session: Session, shape: Shape, sides: Sides, operation: Operation) -> None:
    """Cells of all nine pairs of states occur; the padding stays zero."""
    a, b = solid(1, shape, sides), solid(2, shape, sides)
    found = combine(session, pack(session, a, sides), pack(session, b, sides), operation)
    assert found.levels == levels_of(shape, sides)
    assert (unpack(found) == TWINS[operation](a, b)).all()


@pytest.mark.parametrize("operation", Operation)
def test_only_what_may_be_mixed_has_a_brick(session: Session, operation: Operation) -> None:
    """A cell that one operand decides alone has none: mixed or outside is mixed or inside."""
    states = np.indices((3, 3)).reshape(2, 9)
    a, b = (np.stack([row > 0, row == 1], axis=-1).reshape(1, 1, 18) for row in states)
    sides: Sides = ((2, 1, 1),)
    one, other = (pack(session, voxels, sides) for voxels in (a, b))
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


BRICKS: list[Sides] = [
    (),
    ((1, 1, 1),),
    ((8, 8, 8),),
    ((5, 3, 4),),
    ((64, 1, 2),),
    ((2, 2, 2), (4, 4, 4)),
    ((3, 1, 2), (2, 5, 3)),
]


@pytest.mark.parametrize("operation", Operation)
@pytest.mark.parametrize("other", BRICKS)
@pytest.mark.parametrize("sides", BRICKS[1:])
def test_combination_of_different_levels(
    session: Session, sides: Sides, other: Sides, operation: Operation
) -> None:
    """The result has levels like the first operand's; it is dense if the second one is."""
    shape = 35, 9, 10
    a, b = solid(3, shape, sides), solid(4, shape, other)
    found = combine(session, pack(session, a, sides), pack(session, b, other), operation)
    assert found.levels == levels_of(shape, sides if other else ())
    assert (unpack(found) == TWINS[operation](a, b)).all()


@pytest.mark.parametrize("operation", Operation)
def test_combination_of_a_dense_model(session: Session, operation: Operation) -> None:
    """The result is dense."""
    shape = 35, 9, 10
    a, b = solid(3, shape, ()), solid(4, shape, ((8, 8, 8),))
    found = combine(session, pack(session, a, ()), pack(session, b, ((8, 8, 8),)), operation)
    assert found.levels == (shape,)
    assert (unpack(found) == TWINS[operation](a, b)).all()


@pytest.mark.parametrize("shape, sides", SIZES)
def test_complement(session: Session, shape: Shape, sides: Sides) -> None:
    """Of the grid's box: what pads words and bricks is not in it."""
    a = solid(5, shape, sides)
    assert (unpack(complement(session, pack(session, a, sides))) == ~a).all()


@pytest.mark.parametrize("shape, sides", SIZES)
def test_full_and_empty(session: Session, shape: Shape, sides: Sides) -> None:
    """Neither has a brick, and combinations of the two have none."""
    solid_box = full(session, shape, levels_of(shape, sides))
    assert unpack(solid_box).all()
    nothing = complement(session, solid_box)
    assert not unpack(nothing).any()
    for operation in Operation:
        found = combine(session, solid_box, nothing, operation)
        assert (unpack(found) == TWINS[operation](np.array(True), np.array(False))).all()
        assert not sides or len(found.voxels) == 0


@pytest.mark.parametrize("prune", [False, True])
@pytest.mark.parametrize("sides", BRICKS)
@pytest.mark.parametrize("shape, source", SIZES)
def test_rebrick(session: Session, shape: Shape, source: Sides, sides: Sides, prune: bool) -> None:
    """The same voxels; pruned, a brick only where they differ."""
    voxels = solid(6, shape, source)
    levels = levels_of(shape, sides)
    found = rebrick(session, pack(session, voxels, source), levels, prune=prune)
    assert found.levels == levels
    assert (unpack(found) == voxels).all()
    if sides and prune:
        assert uniform_bricks(found) == 0


@pytest.mark.parametrize("sides", [((4, 4, 4),), ((2, 3, 2), (2, 2, 3))])
def test_rebrick_prunes_what_combining_leaves(session: Session, sides: Sides) -> None:
    """Bricks that are all alike, which are kept if not asked for."""
    a = solid(7, (21, 18, 13), sides)
    one = pack(session, a, sides)
    for operation, voxels in ((Operation.XOR, a & False), (Operation.UNION, a)):
        left = combine(session, one, one, operation)
        pruned = rebrick(session, left, left.levels, prune=True)
        assert (unpack(pruned) == voxels).all()
        assert uniform_bricks(pruned) == 0
    left = combine(session, one, one, Operation.XOR)
    assert uniform_bricks(left) > 0
    assert len(rebrick(session, left, left.levels).voxels) == len(left.voxels)
