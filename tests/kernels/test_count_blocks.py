"""Voxels counted in blocks against the twin."""

from __future__ import annotations

import pytest

from clvox.device import Session
from clvox.grid import MAX_SHAPE, Shape
from clvox.ops import measure
from clvox.ops.combine import full
from clvox.reference.measure import count_blocks
from tests.kernels.solids import SIZES, Sides, levels_of, pack, solid


@pytest.mark.parametrize("side", [(1, 1, 1), (8, 8, 8), (3, 2, 5), (32, 1, 2), (64, 64, 64)])
@pytest.mark.parametrize("shape, sides", SIZES)
def test_counts_equal_the_twin(session: Session, shape: Shape, sides: Sides, side: Shape) -> None:
    """Blocks need not agree with bricks or words, nor divide the grid."""
    voxels = solid(21, shape, sides)
    x, y, z = (min(pair) for pair in zip(side, shape, strict=True))
    found = measure.count_blocks(session, pack(session, voxels, sides), (x, y, z))
    expected = count_blocks(voxels, (x, y, z))
    assert found.shape == expected.shape
    assert (found == expected).all()


@pytest.mark.parametrize("sides", [(), ((4, 4, 4),), ((2, 2, 3), (3, 7, 2))])
def test_blocks_in_parts_and_launches(
    session: Session, sides: Sides, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A block has more rows than one work-item counts, the grid more blocks than one launch."""
    monkeypatch.setattr(measure, "PART", 2)
    monkeypatch.setattr(measure, "COUNTS", 40)
    voxels = solid(22, (19, 11, 13), sides)
    found = measure.count_blocks(session, pack(session, voxels, sides), (9, 5, 3))
    assert (found == count_blocks(voxels, (9, 5, 3))).all()


def test_count_of_the_largest_block(session: Session) -> None:
    """One part of it comes close to 32 bits, the block goes beyond."""
    shape = MAX_SHAPE, 64, 4096
    found = measure.count_blocks(
        session, full(session, shape, levels_of(shape, ((64, 64, 64),))), shape
    )
    assert found.tolist() == [[[MAX_SHAPE * 64 * 4096]]]
