"""Which pixels of a picture are worth more rays."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from clvox.device import Session
from clvox.ops.beams import Beams
from clvox.ops.choosing import choose_pixels
from clvox.ops.distances import measure_distances
from clvox.reference.raymarch import pixels_beside, uneven_pixels
from tests.kernels.models import MODELS, sample

SIZES = [(1, 1), (9, 7), (16, 1), (3, 10)]


def spotted(rng: np.random.Generator, size: tuple[int, int]) -> NDArray[np.uint8]:
    """A picture of one colour, but for some bytes."""
    image = np.full((size[1], size[0], 4), 40, np.uint8)
    some = rng.random(image.shape) < 0.05
    image[some] += rng.integers(0, 215, int(some.sum())).astype(np.uint8)
    return image


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("least", [1, 30, 200])
def test_uneven_pixels_are_chosen(session: Session, size: tuple[int, int], least: int) -> None:
    image = spotted(np.random.default_rng(size[0] + least), size)
    found = [
        np.sort(some.numbers.get()[some.first : some.first + some.count])
        for some in choose_pixels(session, session.upload(image), least)
    ]
    expected = np.flatnonzero(uneven_pixels(image, least))
    assert len(found) == (len(expected) > 0)
    if found:
        np.testing.assert_array_equal(found[0], expected)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("rounds", [0, 1, 5])
def test_those_beside_them_follow(session: Session, size: tuple[int, int], rounds: int) -> None:
    """By what the pixels that were chosen have become; as often as was asked for."""
    rng = np.random.default_rng(size[0] + rounds)
    image = spotted(rng, size)
    canvas = session.upload(image)
    chosen, asked = np.zeros(image.shape[:2], bool), 0
    expected = uneven_pixels(image, 100)
    for some in choose_pixels(session, canvas, 100, rounds=rounds):
        numbers = some.numbers.get()[some.first : some.first + some.count]
        np.testing.assert_array_equal(np.sort(numbers), np.flatnonzero(expected))
        chosen |= expected
        image[expected] = rng.integers(0, 256, (int(expected.sum()), 4))
        canvas.set(image)
        expected = pixels_beside(image, expected, 100) & ~chosen
        asked += 1
    assert asked <= rounds + 1
    assert asked == rounds + 1 or not expected.any()
    assert asked or not uneven_pixels(image, 100).any()


@pytest.mark.parametrize("tile", [4, 8])
@pytest.mark.parametrize("size", [(3, 2), (8, 16), (21, 13)])
def test_tiles_that_show_nothing_are_left_out(
    session: Session, tile: int, size: tuple[int, int]
) -> None:
    rng = np.random.default_rng(tile)
    image = rng.integers(0, 256, (size[1], size[0], 4)).astype(np.uint8)
    starts = np.where(rng.random((-(-size[1] // tile), -(-size[0] // tile))) < 0.5, np.inf, 3.0)
    arrays = sample(session, 0, *MODELS[0]).arrays
    near = measure_distances(session, arrays)
    beams = Beams(session.upload(starts.astype(np.float32).ravel()), near, tile)
    shown = np.isfinite(np.kron(starts, np.ones((tile, tile))))[: size[1], : size[0]]
    expected = np.flatnonzero(uneven_pixels(image, 12) & shown)
    found = list(choose_pixels(session, session.upload(image), 12, beams))
    numbers = [some.numbers.get()[: some.count] for some in found]
    np.testing.assert_array_equal(np.sort(np.concatenate([*numbers, []])), expected)
