"""Pieces of rays, and their combinations, are those of the twin, triangles included."""

from __future__ import annotations

from typing import TYPE_CHECKING, get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from clvox.grid import Axis, Shape
from clvox.ops import dexels
from clvox.ops.combine import Operation
from clvox.ops.crossings import fraction_bits
from clvox.ops.dexels import Frame, Rule
from clvox.ops.lists import CrossingLists, list_crossings
from clvox.reference import dexels as twin
from clvox.reference.crossings import AXES
from clvox.reference.fill import FillRule, fill
from clvox.reference.lists import Lists
from tests.kernels.cases import INTERPRETED, facets_of, some, soup
from tests.strategies import Mesh, adversarial_meshes, closed_meshes, join

if TYPE_CHECKING:
    from clvox.device import Session

SHAPE: Shape = (6, 5, 4)
MESHES = {bits: closed_meshes(bits, SHAPE) for bits in (7, 14)}
RULES: dict[FillRule, Rule] = {
    "parity": Rule.PARITY,
    "nonzero": Rule.NONZERO,
    "positive": Rule.POSITIVE,
}

every_axis = pytest.mark.parametrize("axis", AXES)


def frame_of(axis: Axis, bits: int, shape: Shape = SHAPE) -> Frame:
    return Frame(shape, AXES[axis], fraction_bits(bits))


def read(lists: CrossingLists) -> Lists:
    """The lists on the host; a cap has the triangle -1."""
    triangle = lists.triangle()
    triangle[triangle == dexels.CAP] = twin.CAP
    return Lists(lists.offsets.get(), lists.depth.get(), triangle, lists.sign())


def assert_same(found: CrossingLists, expected: list[twin.Row]) -> None:
    for mine, theirs in zip(read(found), twin.lists_of(expected), strict=True):
        np.testing.assert_array_equal(mine, theirs)


def upload(session: Session, rows: list[twin.Row], bits: int) -> CrossingLists:
    lists = twin.lists_of(rows)
    side = np.where(lists.triangle == twin.CAP, dexels.CAP, lists.triangle).astype(np.uint32)
    side = (side * 2 + (lists.sign > 0)).astype(np.uint32).view(np.int32)
    held = [session.upload(np.ascontiguousarray(a)) for a in (lists.offsets, lists.depth, side)]
    return CrossingLists(held[0], held[1], held[2], fraction_bits(bits))


def crossings_of(session: Session, mesh: Mesh, frame: Frame, bits: int) -> CrossingLists:
    return list_crossings(session, facets_of(session, mesh), bits, frame.shape, frame.axis)


def assert_resolves(
    session: Session, mesh: Mesh, bits: int, axis: Axis, rule: FillRule
) -> list[twin.Row]:
    frame = frame_of(axis, bits)
    lists = crossings_of(session, mesh, frame, bits)
    box = twin.box_of(SHAPE[AXES[axis]], frame.fraction_bits)
    rows = [twin.resolve(row, rule, box) for row in twin.rows_of(read(lists))]
    assert_same(dexels.resolve(session, frame, lists, RULES[rule]), rows)
    return rows


@every_axis
@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("bits", [7, 14])
@given(data=st.data())
def test_pieces_are_those_of_the_twin(
    session: Session, axis: Axis, rule: FillRule, bits: int, data: st.DataObject
) -> None:
    assert_resolves(session, data.draw(MESHES[bits]), bits, axis, rule)


@pytest.mark.parametrize("rule", RULES)
def test_pieces_hold_the_samples_that_the_definition_says(session: Session, rule: FillRule) -> None:
    """The twin's own rows, by way of the twin's fill, along every axis."""
    for mesh in adversarial_meshes(31, some(40), 8, SHAPE):
        for axis, number in AXES.items():
            rows = assert_resolves(session, mesh, 8, axis, rule)
            samples = twin.to_voxels(rows, fraction_bits(8), SHAPE[number])
            across = [count for a, count in enumerate(SHAPE) if a != number]
            found = np.moveaxis(samples.reshape(across[1], across[0], -1), 2, 2 - number)
            np.testing.assert_array_equal(found, fill(*mesh, 8, SHAPE, rule, axis))


@pytest.mark.parametrize("rule", RULES)
def test_what_an_open_mesh_leaves_is_still_made_of_pieces(session: Session, rule: FillRule) -> None:
    for seed in range(some(20)):
        for row in assert_resolves(session, soup(seed, 12, 8, SHAPE), 8, "z", rule):
            depths = [end.depth for end in row]
            assert depths == sorted(set(depths))
            assert [end.sign for end in row] == [1, -1] * (len(row) // 2)


@pytest.mark.parametrize("rule", RULES)
def test_crossings_at_the_faces_of_the_box_keep_their_triangles(
    session: Session, rule: FillRule
) -> None:
    """Also those that were rounded up to beyond it; what lies farther out is cut off."""
    shape: Shape = (40, 5, 4)
    frame = frame_of("z", 8, shape)
    low, high = twin.box_of(4, frame.fraction_bits)
    rng = np.random.default_rng(6)
    near = [low - 5, low - 1, low, low + 1, high - 1, high, high + 1, high + 2, high + 9]
    rows: list[twin.Row] = []
    for _ in range(200):
        depths = np.sort(rng.choice(near, rng.integers(0, 7)))
        ends = enumerate(depths.tolist())
        rows.append(sorted(twin.End(d, int(rng.integers(9)), 1 - 2 * (n % 2)) for n, d in ends))
    lists = upload(session, rows, 8)
    found = dexels.resolve(session, frame, lists, RULES[rule])
    assert_same(found, [twin.resolve(row, rule, (low, high)) for row in rows])
    assert (read(found).triangle == twin.CAP).any()


@st.composite
def pieces(draw: st.DrawFn, rays: int, box: tuple[int, int]) -> list[twin.Row]:
    """Rows of a few pieces, with depths that two of them are likely to share."""
    low, high = box
    step = (high - low) // 4
    spots = st.integers(0, 4).map(lambda at: min(low + at * step, high)) | st.integers(low, high)
    rows: list[twin.Row] = []
    for _ in range(rays):
        depths = sorted(draw(st.sets(spots, max_size=6)))
        ends = [
            twin.End(depth, draw(st.sampled_from([twin.CAP, 0, 3, 9])), -1 if at % 2 else 1)
            for at, depth in enumerate(depths[: len(depths) // 2 * 2])
        ]
        rows.append(ends)
    return rows


NAMES: dict[twin.OperationName, Operation] = {
    "union": Operation.UNION,
    "intersection": Operation.INTERSECTION,
    "difference": Operation.DIFFERENCE,
    "xor": Operation.XOR,
}


def test_there_is_a_twin_of_every_operation() -> None:
    assert set(NAMES) == set(get_args(twin.OperationName))
    assert set(NAMES.values()) == set(Operation)


@pytest.mark.parametrize("name", NAMES)
@given(data=st.data())
def test_combinations_are_those_of_the_twin(
    session: Session, name: twin.OperationName, data: st.DataObject
) -> None:
    shape: Shape = (3, 2, 5)
    frame = frame_of("z", 8, shape)
    box = twin.box_of(5, frame.fraction_bits)
    a, b = (data.draw(pieces(6, box)) for _ in range(2))
    first, second = (upload(session, rows, 8) for rows in (a, b))
    found = dexels.combine(session, frame, first, second, NAMES[name])
    expected = [twin.combine(one, other, name) for one, other in zip(a, b, strict=True)]
    assert_same(found, expected)
    apart = any(twin.combine(one, other, "xor") for one, other in zip(a, b, strict=True))
    assert dexels.differ(session, frame, first, second) == apart
    without = [twin.complement(row, box) for row in a]
    assert_same(dexels.complement(session, frame, first), without)


def test_triangles_of_the_second_operand_are_renumbered(session: Session) -> None:
    shape: Shape = (1, 1, 5)
    frame = frame_of("z", 8, shape)
    numbers = [0, 4, 5, 9, twin.CAP, 12]
    row = [twin.End(at * 100, n, -1 if at % 2 else 1) for at, n in enumerate(numbers)]
    lists = upload(session, [row], 8)
    nothing = upload(session, [[]], 8)
    found = dexels.combine(
        session, frame, nothing, lists, Operation.UNION, [(0, 7), (5, -5), (9, 1000)]
    )
    assert read(found).triangle.tolist() == [7, 11, 0, 1009, twin.CAP, 1012]


@pytest.mark.parametrize("ends", [2, 64, 66, 300])
def test_meshes_are_marked_and_renumbered(session: Session, ends: int) -> None:
    starts = np.array([0, 10, 11, 400, 500])
    moved = np.array([0, 5, -3, -400, 1000])
    rng = np.random.default_rng(ends)
    numbers = rng.integers(0, 20, ends)
    numbers[:2] = 450, twin.CAP
    row = [twin.End(at, number, -1 if at % 2 else 1) for at, number in enumerate(numbers.tolist())]
    lists = upload(session, [row], 8)
    real = numbers[numbers != twin.CAP]
    meshes = np.searchsorted(starts, real, side="right") - 1
    used = dexels.used_meshes(session, lists, starts.tolist())
    assert used == [mesh in meshes for mesh in range(len(starts))]
    pairs = list(zip(starts.tolist(), moved.tolist(), strict=True))
    dexels.renumber(session, lists, pairs)
    expected = numbers.copy()
    expected[numbers != twin.CAP] += moved[meshes]
    assert read(lists).triangle.tolist() == expected.tolist()
    assert read(lists).sign.tolist() == [end.sign for end in row]


@pytest.mark.parametrize("bits", [7, 14])
def test_a_mesh_without_itself_is_nothing(session: Session, bits: int) -> None:
    for mesh in adversarial_meshes(5, some(15), bits, SHAPE):
        frame = frame_of("x", bits)
        lists = crossings_of(session, mesh, frame, bits)
        solid = dexels.resolve(session, frame, lists, Rule.PARITY)
        for operation in (Operation.DIFFERENCE, Operation.XOR):
            assert dexels.combine(session, frame, solid, solid, operation).count == 0
        assert not dexels.differ(session, frame, solid, solid)


@pytest.mark.parametrize("rays", [1, 63, 64, 65])
def test_every_ray_is_walked(session: Session, rays: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dexels, "RAYS_PER_LAUNCH", 32)
    shape: Shape = (rays, 1, 3)
    frame = frame_of("z", 8, shape)
    rng = np.random.default_rng(rays)
    box = twin.box_of(3, frame.fraction_bits)
    rows: list[twin.Row] = []
    for _ in range(rays):
        depths = np.sort(rng.choice(np.arange(*box), 2 * rng.integers(0, 40), replace=False))
        ends = enumerate(depths.tolist())
        rows.append([twin.End(depth, at, -1 if at % 2 else 1) for at, depth in ends])
    found = dexels.complement(session, frame, upload(session, rows, 8))
    assert_same(found, [twin.complement(row, box) for row in rows])


def test_touching_meshes_merge_whatever_their_numbering(session: Session) -> None:
    frame = frame_of("y", 8)
    for mesh in adversarial_meshes(3, 4 if INTERPRETED else 20, 8, SHAPE, ["touching_boxes"]):
        vertices, faces = mesh
        second = faces[:, 0] >= 8
        parts = [(vertices, faces[~second]), (vertices, faces[second])]
        solids = []
        for order in (parts, parts[::-1]):
            lists = crossings_of(session, join(order), frame, 8)
            solids.append(dexels.resolve(session, frame, lists, Rule.PARITY))
        one, other = (
            dexels.resolve(session, frame, crossings_of(session, part, frame, 8), Rule.PARITY)
            for part in parts
        )
        solids.append(dexels.combine(session, frame, one, other, Operation.UNION))
        assert read(solids[0]).depth.tolist() == read(solids[1]).depth.tolist()
        assert read(solids[0]).depth.tolist() == read(solids[2]).depth.tolist()
