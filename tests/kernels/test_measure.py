"""Voxels are counted by every rule, those of the cells inside as far as the grid reaches."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from clvox.grid import Shape
from clvox.ops.layout import VoxelArrays, cell_shape
from clvox.ops.measure import RUN, count_voxels
from clvox.ops.multilevel import rank_cells
from clvox.ops.query import Rule
from clvox.reference.multilevel import pack_bits
from tests.kernels.models import MODELS, sample

if TYPE_CHECKING:
    from clvox.device import Session


@pytest.mark.parametrize("rule", [Rule.CENTRE, Rule.TOUCH, Rule.WITHIN])
@pytest.mark.parametrize(("shape", "brick"), MODELS)
def test_counts_equal_those_of_the_voxels(
    session: Session, shape: Shape, brick: Shape | None, rule: Rule
) -> None:
    found = sample(session, 71, shape, brick)
    expected = np.count_nonzero(found.by_rule(rule))
    assert count_voxels(session, found.arrays, rule, found.marks) == expected
    if rule == Rule.CENTRE:
        assert count_voxels(session, found.arrays) == expected


@pytest.mark.parametrize("words", [1, RUN - 1, RUN, RUN + 1, 64 * RUN, 64 * RUN + 1])
def test_any_number_of_words(session: Session, words: int) -> None:
    """Work-items count RUN words each and come in groups of 64."""
    bits = np.random.default_rng(words).integers(0, 2**32, (1, 1, words)).astype(np.uint32)
    arrays = VoxelArrays((32 * words, 1, 1), session.upload(bits))
    expected = int(np.unpackbits(bits.view(np.uint8)).sum())
    assert count_voxels(session, arrays) == expected


@pytest.mark.parametrize("shape", [(1, 1, 1), (32, 2, 2), (33, 3, 1), (31, 1, 65), (64, 64, 3)])
@pytest.mark.parametrize("missing", [(0, 0, 0), (1, 0, 0), (0, 2, 0), (0, 0, 3), (3, 3, 3)])
def test_cells_at_the_end_of_the_grid_count_in_part(
    session: Session, shape: Shape, missing: Shape
) -> None:
    """All cells inside and no brick: every voxel of the grid, and none beyond it."""
    nx, ny, nz = (4 * count - less for count, less in zip(shape, missing, strict=True))
    cells = cell_shape((nx, ny, nz), (4, 4, 4))
    assert cells == shape
    inside = session.upload(pack_bits(np.ones(shape[::-1], dtype=np.bool_)))
    marks = session.zeros(inside.shape, np.uint32)
    ranked = rank_cells(session, marks, cells, (4, 4, 4))
    bricks = session.zeros((0, ranked.brick_words), np.uint32)
    arrays = VoxelArrays((nx, ny, nz), bricks, ranked, inside)
    for rule in (Rule.CENTRE, Rule.TOUCH, Rule.WITHIN):
        assert count_voxels(session, arrays, rule, bricks) == nx * ny * nz


def test_counts_beyond_32_bits(session: Session) -> None:
    """Cells inside of 64 voxels a side, 2048 along each axis: 2**33 voxels and nothing stored."""
    cells = (32, 32, 32)
    inside = session.upload(np.full((32, 32, 1), 0xFFFFFFFF, np.uint32))
    ranked = rank_cells(session, session.zeros((32, 32, 1), np.uint32), cells, (64, 64, 64))
    bricks = session.zeros((0, ranked.brick_words), np.uint32)
    arrays = VoxelArrays((2048, 2048, 2047), bricks, ranked, inside)
    assert count_voxels(session, arrays) == 2048 * 2048 * 2047
