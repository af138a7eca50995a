"""Single voxels, and boxes of them, are what the twin reads from the same bits."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from clvox.grid import Shape
from clvox.ops.query import RUN, Rule, expand, expand_cells, look_up
from clvox.reference import multilevel as twin
from tests.kernels.models import MODELS, sample

if TYPE_CHECKING:
    from clvox.device import Session

every_model = pytest.mark.parametrize(("shape", "brick"), MODELS)
every_rule = pytest.mark.parametrize("rule", Rule)


@every_rule
@every_model
def test_every_voxel_is_looked_up(
    session: Session, shape: Shape, brick: Shape | None, rule: Rule
) -> None:
    found = sample(session, 61, shape, brick)
    nx, ny, nz = shape
    places = np.argwhere(np.ones((nz, ny, nx)))[:, ::-1].astype(np.int32)
    answers = look_up(session, found.arrays, places, rule, found.marks)
    np.testing.assert_array_equal(answers, found.by_rule(rule).ravel(), strict=True)
    if found.model is not None and rule == Rule.CENTRE:
        some = places[:: max(len(places) // 500, 1)]
        answers = look_up(session, found.arrays, some)
        np.testing.assert_array_equal(answers == 1, twin.contains(found.model, some))
    if found.model is not None and rule == Rule.CLASS:
        answers = look_up(session, found.arrays, places[:200], rule, found.marks)
        expected = twin.classify(found.model, found.edge, places[:200])
        np.testing.assert_array_equal(answers, expected, strict=True)


@every_rule
@pytest.mark.parametrize("brick", [None, (8, 8, 8)])
@pytest.mark.parametrize("count", [0, 1, 63, 64, 65])
def test_any_number_of_points(
    session: Session, count: int, brick: Shape | None, rule: Rule
) -> None:
    """Work-items come in groups of 64; a negative i is in no voxel."""
    found = sample(session, 62, (17, 9, 10), brick)
    rng = np.random.default_rng(count)
    places = rng.integers(0, (17, 9, 10), (count, 3)).astype(np.int32)
    places[::3] = -1
    answers = look_up(session, found.arrays, places, rule, found.marks)
    held = found.by_rule(rule)[tuple(np.maximum(places, 0).T[::-1])]
    np.testing.assert_array_equal(answers, np.where(places[:, 0] < 0, 0, held).astype(np.uint8))


@every_rule
@every_model
def test_boxes_are_expanded(
    session: Session, shape: Shape, brick: Shape | None, rule: Rule
) -> None:
    found = sample(session, 63, shape, brick)
    expected = found.by_rule(rule)
    boxes: list[tuple[Shape, Shape]] = [
        ((0, 0, 0), shape),
        ((3, 2, 1), (shape[0], 4, 5)),
        ((1, 0, 4), (min(RUN + 1, shape[0]), 1, 5)),
        ((2, 1, 0), (3, 2, 1)),
    ]
    for start, stop in boxes:
        box = expand(session, found.arrays, start, stop, rule, found.marks)
        (x, y, z), (to_x, to_y, to_z) = start, stop
        np.testing.assert_array_equal(box, expected[z:to_z, y:to_y, x:to_x], strict=True)


@every_model
def test_empty_boxes_are_empty(session: Session, shape: Shape, brick: Shape | None) -> None:
    found = sample(session, 64, shape, brick)
    assert expand(session, found.arrays, (2, 2, 2), (2, 3, 3)).shape == (1, 1, 0)
    if brick is not None:
        assert expand_cells(session, found.arrays, (0, 0, 0), (1, 0, 1)).shape == (1, 0, 1)


@pytest.mark.parametrize("length", [1, RUN - 1, RUN, RUN + 1, 4 * RUN + 3])
def test_rows_of_any_length(session: Session, length: int) -> None:
    """Work-items do RUN voxels each."""
    found = sample(session, 65, (2 + 4 * RUN + 3, 8, 5), (33, 7, 2))
    box = expand(session, found.arrays, (2, 1, 0), (2 + length, 8, 5))
    expected = found.by_rule(Rule.CENTRE)[:, 1:, 2 : 2 + length]
    np.testing.assert_array_equal(box, expected, strict=True)


@pytest.mark.parametrize(("shape", "brick"), [m for m in MODELS if m[1] is not None])
def test_states_of_cells(session: Session, shape: Shape, brick: Shape) -> None:
    found = sample(session, 66, shape, brick)
    assert found.model is not None
    states = found.model.states
    counts = states.shape[2], states.shape[1], states.shape[0]
    whole = expand_cells(session, found.arrays, (0, 0, 0), counts)
    np.testing.assert_array_equal(whole, states, strict=True)
    part = expand_cells(session, found.arrays, (1, 0, 1), (counts[0], 1, 2))
    np.testing.assert_array_equal(part, states[1:2, :1, 1:], strict=True)
