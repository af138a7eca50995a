"""Measures of pieces of rays equal the twin's, which are sums of integers and fractions."""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np
import pytest

from clvox.grid import Axis, Shape
from clvox.ops import dexel_measure, dexels
from clvox.ops.dexels import Frame, Rule
from clvox.ops.lists import CrossingLists
from clvox.reference import dexels as twin
from clvox.reference.crossings import AXES
from tests.kernels.cases import some
from tests.kernels.test_dexels import crossings_of, frame_of, read, upload
from tests.strategies import adversarial_meshes

if TYPE_CHECKING:
    from clvox.device import Session

SHAPE: Shape = (7, 5, 6)

every_axis = pytest.mark.parametrize("axis", AXES)


def solids(
    session: Session, axis: Axis, count: int, bits: int = 8
) -> list[tuple[Frame, CrossingLists, CrossingLists]]:
    """Crossings of some meshes, and their pieces."""
    frame = frame_of(axis, bits, SHAPE)
    found = []
    for mesh in adversarial_meshes(11, some(count), bits, SHAPE):
        lists = crossings_of(session, mesh, frame, bits)
        found.append((frame, lists, dexels.resolve(session, frame, lists, Rule.PARITY)))
    return found


@every_axis
def test_findings_are_those_of_the_twin(session: Session, axis: Axis) -> None:
    for frame, lists, pieces in solids(session, axis, 30):
        found = dexel_measure.examine(session, frame, lists, pieces)
        assert found == twin.examine(twin.rows_of(read(lists)), twin.rows_of(read(pieces)))


def test_an_odd_ray_is_counted(session: Session) -> None:
    frame = frame_of("z", 8, (3, 1, 4))
    rows = [[twin.End(0, 0, 1)], [], [twin.End(0, 0, 1), twin.End(5, 1, 1), twin.End(9, 4, -1)]]
    lists = upload(session, list(rows), 8)
    pieces = dexels.resolve(session, frame, lists, Rule.PARITY)
    found = dexel_measure.examine(session, frame, lists, pieces)
    assert (found.odd_rays, found.depth, found.deepest_ray) == (2, 3, 2)
    assert (found.thinnest, found.thinnest_ray) == (5, 2)


def from_sums(sums: tuple[int, ...], frame: Frame) -> tuple[Fraction, ...]:
    """The twin's integrals, from the kernel's sums, which count depths from the face."""
    unit = Fraction(1, 1 << frame.fraction_bits)
    one, i, j, ii, jj, ij = (value * unit for value in sums[:6])
    w, wi, wj = (value * unit**2 / 2 for value in sums[6:9])
    ww = sums[9] * unit**3 / 3
    half, twelfth = Fraction(1, 2), Fraction(1, 12)
    return (
        *(one, i, j, w - half * one, ii + twelfth * one, jj + twelfth * one),
        *(ww - w + one / 4, ij, wi - half * i, wj - half * j),
    )


@every_axis
def test_moments_are_those_of_the_twin(session: Session, axis: Axis) -> None:
    for frame, _, pieces in solids(session, axis, 30):
        sums = dexel_measure.sum_moments(session, frame, pieces)
        rows = twin.rows_of(read(pieces))
        assert from_sums(sums, frame) == twin.moments(rows, frame.across, frame.fraction_bits)


def test_moments_of_the_longest_rays_do_not_overflow(session: Session) -> None:
    """Rays as long as the lattice, far apart."""
    frame = Frame((2000, 1, (1 << 17) - 1), 2, 14)
    low, high = twin.box_of(frame.shape[2], 14)
    rows: list[twin.Row] = [[] for _ in range(2000)]
    rows[-1] = [twin.End(low, 0, 1), twin.End(high, 0, -1)]
    for ray in range(1500, 1530):
        # Odd ends, so that all words of the sums carry.
        rows[ray] = [twin.End(low + ray, 0, 1), twin.End(high - 1 - 7919 * ray, 0, -1)]
    pieces = upload(session, rows, 7)
    sums = dexel_measure.sum_moments(session, frame, pieces)
    assert from_sums(sums, frame) == twin.moments(rows, frame.across, 14)


@every_axis
@pytest.mark.parametrize("side", [1, 2, 4, 7, 9])
def test_lengths_are_those_of_the_twin(
    session: Session, axis: Axis, side: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    for budget in (1, 1 << 26):
        monkeypatch.setattr(dexel_measure, "SLAB_BYTES", budget)
        for frame, _, pieces in solids(session, axis, 12):
            rows = twin.rows_of(read(pieces))
            box = twin.box_of(SHAPE[frame.axis], frame.fraction_bits)
            width = side << frame.fraction_bits
            expected = np.array([twin.lengths_in_cells(row, box, width) for row in rows])
            whole = dexel_measure.sum_lengths(session, frame, pieces)
            np.testing.assert_array_equal(whole, expected.sum(axis=1))
            found = dexel_measure.sum_cells(session, frame, pieces, side)
            shaped = expected.reshape(*frame.across[::-1], -1)
            np.testing.assert_array_equal(found, np.moveaxis(shaped, 2, 2 - frame.axis))


@every_axis
def test_places_are_inside_where_the_twin_says(session: Session, axis: Axis) -> None:
    rng = np.random.default_rng(3)
    for frame, _, pieces in solids(session, axis, 12):
        rows = twin.rows_of(read(pieces))
        low, high = twin.box_of(SHAPE[frame.axis], frame.fraction_bits)
        rays = rng.integers(-1, frame.rays, 100)
        places = rng.integers(low, high, 100, dtype=np.int32)
        if pieces.count:
            # Some at an end, and some one unit before.
            chosen = rng.choice([0, 1, 2], 100)
            ends = pieces.depth.get()
            places = np.where(chosen, rng.choice(ends, 100) - (chosen == 2), places)
        found = dexel_measure.look_up(session, pieces, rays, places.astype(np.int32))
        expected = [
            ray >= 0 and twin.holds(rows[ray], place)
            for ray, place in zip(rays.tolist(), places.tolist(), strict=True)
        ]
        assert found.tolist() == expected
        held = [
            (ray, place, next(end for end in rows[ray] if end.depth > place))
            for ray, place, inside in zip(rays.tolist(), places.tolist(), expected, strict=True)
            if inside
        ]
        depth, side = dexel_measure.find_ends(
            session,
            pieces,
            np.array([ray for ray, _, _ in held], np.int64),
            np.array([place for _, place, _ in held], np.int32),
        )
        assert depth.tolist() == [end.depth for _, _, end in held]
        caps = [dexels.CAP if end.triangle == twin.CAP else end.triangle for _, _, end in held]
        assert (side >> 1).tolist() == caps


@every_axis
def test_behind_the_last_end_there_is_none(session: Session, axis: Axis) -> None:
    for frame, _, pieces in solids(session, axis, 12):
        rays = np.arange(frame.rays)
        places = np.full(frame.rays, frame.box[1], np.int32)
        depth, side = dexel_measure.find_ends(session, pieces, rays, places)
        assert set(depth.tolist()) == {dexel_measure.NOWHERE}
        assert not side.any()
