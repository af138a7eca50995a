"""Sums over voxel indices against the twin, and at the ends of their widths."""

from __future__ import annotations

import numpy as np
import pytest

from clvox.device import Session
from clvox.grid import MAX_SHAPE, Shape
from clvox.ops import measure
from clvox.ops.combine import full
from clvox.ops.layout import VoxelArrays, words_for
from clvox.ops.multilevel import rank_cells
from clvox.reference.measure import sum_moments
from tests.kernels.solids import SIZES, Sides, levels_of, pack, solid


@pytest.mark.parametrize("shape, sides", SIZES)
def test_sums_equal_the_twin(session: Session, shape: Shape, sides: Sides) -> None:
    """Cells that are in, out and mixed, also where the grid ends within them."""
    voxels = solid(11, shape, sides)
    assert measure.sum_moments(session, pack(session, voxels, sides)) == sum_moments(voxels)


@pytest.mark.parametrize("sides", [(), ((2, 2, 2),), ((2, 1, 2), (1, 2, 1))])
def test_rows_in_several_launches(
    session: Session, sides: Sides, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The last launch has fewer rows than the others."""
    monkeypatch.setattr(measure, "ROWS", 4)
    voxels = solid(12, (9, 6, 5), sides)
    assert measure.sum_moments(session, pack(session, voxels, sides)) == sum_moments(voxels)


@pytest.mark.parametrize("shape", [(MAX_SHAPE, 64, MAX_SHAPE), (64, MAX_SHAPE - 7, 64)])
def test_sums_of_the_largest_box(session: Session, shape: Shape) -> None:
    """Sums of one row come close to 63 bits, and their total goes beyond 64."""
    found = measure.sum_moments(session, full(session, shape, levels_of(shape, ((64, 64, 64),))))
    assert found == _box_sums(shape)


def test_sums_of_the_last_bricks(session: Session) -> None:
    """Bricks, other than whole cells, are shifted to their place."""
    shape, brick = (MAX_SHAPE, 1, 1), (64, 1, 1)
    cells = MAX_SHAPE // 64
    mixed = session.upload(np.full((1, 1, words_for(cells)), 0xFFFFFFFF, np.uint32))
    ranked = rank_cells(session, mixed, (cells, 1, 1), brick)
    bricks = session.upload(np.full((cells, 2), 0xFFFFFFFF, np.uint32))
    inside = session.zeros(mixed.shape, np.uint32)
    arrays = VoxelArrays(shape, bricks, ranked, inside)
    assert measure.sum_moments(session, arrays) == _box_sums(shape)


def _box_sums(shape: Shape) -> tuple[int, ...]:
    """Of all voxels of a grid, in Python integers."""
    (n, s, q), (m, t, r), (p, u, v) = (
        (c, c * (c - 1) // 2, c * (c - 1) * (2 * c - 1) // 6) for c in shape
    )
    first = s * m * p, n * t * p, n * m * u
    second = q * m * p, n * r * p, n * m * v
    return (n * m * p, *first, *second, s * t * p, n * t * u, s * m * u)
