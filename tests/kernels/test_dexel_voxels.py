"""Bits made of pieces of rays, and pieces made of bits, are those of the twin."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from numpy.typing import NDArray

from clvox.grid import Axis, Shape
from clvox.ops import dexel_voxels, dexels
from clvox.ops.dexels import Frame, Rule
from clvox.reference import dexels as twin
from clvox.reference.crossings import AXES, fill_parity
from clvox.reference.multilevel import pack_bits
from tests.kernels.cases import INTERPRETED, some
from tests.kernels.solids import bits_of
from tests.kernels.solids import solid as voxels_at_random
from tests.kernels.test_dexels import assert_same, crossings_of, frame_of
from tests.strategies import adversarial_meshes

if TYPE_CHECKING:
    from clvox.device import Session

SHAPES: list[Shape] = [(1, 1, 1), (6, 5, 4), (33, 3, 5), (32, 4, 2), (70, 2, 3)]

every_axis = pytest.mark.parametrize("axis", AXES)
every_shape = pytest.mark.parametrize("shape", SHAPES[1:2] if INTERPRETED else SHAPES, ids=str)


def along(voxels: NDArray[np.bool_], frame: Frame) -> NDArray[np.bool_]:
    """Voxels [z, y, x] as (rays, samples)."""
    rows = np.moveaxis(voxels, 2 - frame.axis, 2)
    return rows.reshape(frame.rays, frame.shape[frame.axis])


@every_axis
@every_shape
def test_voxels_are_those_of_the_mesh(session: Session, axis: Axis, shape: Shape) -> None:
    frame = frame_of(axis, 8, shape)
    for mesh in adversarial_meshes(17, some(15), 8, shape):
        lists = crossings_of(session, mesh, frame, 8)
        pieces = dexels.resolve(session, frame, lists, Rule.PARITY)
        found = dexel_voxels.to_dense(session, frame, pieces).get()
        expected = fill_parity(*mesh, 8, shape, "y")
        np.testing.assert_array_equal(bits_of(found, shape[0]), expected)


@every_axis
@every_shape
def test_voxels_come_back_from_their_pieces(session: Session, axis: Axis, shape: Shape) -> None:
    frame = frame_of(axis, 8, shape)
    for seed in range(some(5)):
        voxels = voxels_at_random(seed, shape, ((2, 2, 2),))
        bits = session.upload(pack_bits(voxels))
        pieces = dexel_voxels.from_dense(session, frame, bits)
        assert_same(pieces, twin.from_voxels(along(voxels, frame), frame.fraction_bits))
        found = dexel_voxels.to_dense(session, frame, pieces).get()
        np.testing.assert_array_equal(found, pack_bits(voxels))
