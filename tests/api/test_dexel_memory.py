"""What making dexels may take, what happens when it may not, and that the lists are the same."""

from __future__ import annotations

import gc
import re
from dataclasses import replace
from typing import Any, cast

import numpy as np
import pyopencl as cl
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

import clvox
from clvox.device import Session
from clvox.device import session as sessions
from clvox.errors import OutOfMemoryError
from clvox.grid import Grid
from clvox.models.dexel_build import DexelAxis
from clvox.models.memory import LEAST_WORK
from clvox.ops import lists
from clvox.ops.bins import Bins
from clvox.ops.crossings import Window
from clvox.ops.facets import FacetChunks
from tests.api.test_memory import asked_of, needed_by

Model = clvox.DexelModel | clvox.TripleDexelModel

AXES: list[DexelAxis] = ["x", "y", "z", "xyz"]


def sheets() -> trimesh.Trimesh:
    """A ball with forty plates in it, so that some rays are too long for one work-item."""
    bodies = [trimesh.creation.icosphere(subdivisions=4, radius=5.0)]
    for height in np.linspace(-2, 2, 40):
        plate = trimesh.creation.box((2, 2, 0.05))
        bodies.append(plate.apply_translation((0.3, -0.2, height)))
    return cast("trimesh.Trimesh", trimesh.util.concatenate(bodies))


MESH = sheets()
GRID = Grid.fit(MESH, resolution=120)


def build(axis: DexelAxis, budget: int | None = None) -> Model:
    # For each of the types that it overloads.
    return cast(
        "Model", clvox.dexelize(MESH, grid=GRID, axis=cast("Any", axis), memory_budget=budget)
    )


def bundles(model: Model) -> tuple[clvox.DexelModel, ...]:
    return model.bundles if isinstance(model, clvox.TripleDexelModel) else (model,)


def bits(model: Model) -> dict[str, bytes]:
    return {name: array.tobytes() for name, array in model.to_record().items()}


def peak(model: Model) -> int:
    return max(bundle.report.peak_nbytes for bundle in bundles(model))


expected: dict[str, dict[str, bytes]] = {}


def expect(axis: DexelAxis) -> dict[str, bytes]:
    """The bits of the model without a budget."""
    if axis not in expected:
        expected[axis] = bits(build(axis))
    return expected[axis]


def grown(axis: DexelAxis, budget: int) -> tuple[Model, int]:
    """A model, and the budget that it was made within: that given, or what messages ask for.

    There is one message at most for the rays, and one for the crossings of each axis.
    """
    for _ in range(1 + len(axis)):
        try:
            return build(axis, budget), budget
        except OutOfMemoryError as error:
            needed = needed_by(error)
        assert needed > budget
        budget = needed
    return build(axis, budget), budget


@settings(max_examples=12)
@given(axis=st.sampled_from(AXES), budget=st.integers(1, 1_500_000))
def test_any_budget_gives_the_same_bits(axis: DexelAxis, budget: int) -> None:
    """Or says what is needed, and that is enough."""
    model, granted = grown(axis, budget)
    assert bits(model) == expect(axis)
    assert peak(model) <= granted


@pytest.mark.parametrize("axis", AXES)
def test_little_more_than_the_result_is_enough(axis: DexelAxis) -> None:
    model, granted = grown(axis, 1)
    assert bits(model) == expect(axis)
    assert granted <= 1.2 * model.nbytes + LEAST_WORK


def test_the_peak_is_within_1_6_of_the_result() -> None:
    """Of a mesh that is small beside it; and of one that is not, if it must be."""
    fine = clvox.dexelize(MESH, resolution=600)
    assert fine.report.peak_nbytes <= 1.6 * fine.nbytes
    ball = trimesh.creation.icosphere(subdivisions=6)
    coarse = clvox.dexelize(ball, resolution=200)
    assert coarse.report.peak_nbytes > 1.6 * coarse.nbytes
    least = clvox.dexelize(ball, resolution=200, memory_budget=int(1.6 * coarse.nbytes))
    assert bits(least) == bits(coarse)


def test_a_small_budget_cuts_the_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """So that the tests above test something."""
    _, least = grown("z", 1)
    met: dict[str, list[Window]] = {"count_tile": [], "write_tile": []}
    run = lists.Listing._run

    def note(listing: Any, name: str, sink: int, bins: Bins, *rest: Any) -> None:
        met[name].append(bins.window)
        run(listing, name, sink, bins, *rest)

    monkeypatch.setattr(lists.Listing, "_run", note)
    build("z")
    assert [len(each) for each in met.values()] == [1, 1]
    for each in met.values():
        each.clear()
    build("z", least)
    for each in met.values():
        assert sum(window.rays for window in set(each)) == GRID.shape[0] * GRID.shape[1]
    written = met["write_tile"]
    assert len(set(written)) > 1
    assert len(written) > 2 * len(set(written))


def test_models_that_are_there_do_not_count() -> None:
    _, least = grown("z", 1)
    kept = [build("x") for _ in range(3)]
    model = build("z", least)
    assert peak(model) <= least < sum(one.nbytes for one in kept) + model.nbytes


# What cannot fit


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("budget", [90_000, 250_000])
def test_refusals_say_what_would_fit(session: Session, axis: DexelAxis, budget: int) -> None:
    """A wider pitch, which does fit into the same budget; no list is allocated before."""
    model = bundles(build(axis))[0]
    with asked_of(session) as sizes, pytest.raises(OutOfMemoryError) as caught:
        build(axis, budget)
    assert model._crossings.depth.nbytes not in sizes
    assert needed_by(caught.value) > budget
    assert f"; {budget:,} may be used" in str(caught.value)
    found = re.search(r"A pitch of ([0-9.]+), about ([0-9]+) voxels", str(caught.value))
    assert found, caught.value
    grid = Grid.fit(MESH, pitch=float(found[1]))
    assert abs(max(grid.shape) - int(found[2])) <= 2
    clvox.dexelize(MESH, grid=grid, axis=cast("Any", axis), memory_budget=budget)


def test_a_budget_for_nothing() -> None:
    with pytest.raises(OutOfMemoryError, match=r"may be used\. Otherwise give a larger"):
        build("z", LEAST_WORK // 2)


def test_by_default_most_of_what_the_device_has(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    small = replace(session.device, memory=session.nbytes + 200_000)
    monkeypatch.setattr(session, "device", small)
    with pytest.raises(OutOfMemoryError, match="may be used"):
        build("z")
    monkeypatch.undo()
    assert bits(build("z")) == expect("z")


@pytest.mark.parametrize("axis", AXES)
def test_no_buffer_above_the_largest_allocation(
    session: Session, monkeypatch: pytest.MonkeyPatch, axis: DexelAxis
) -> None:
    """The mesh and the bins are cut; the lists are what must fit."""
    largest = max(
        session.size_of(array.nbytes)
        for model in bundles(build(axis))
        for array in (model._crossings.offsets, model._crossings.depth)
    )
    monkeypatch.setattr(session, "device", replace(session.device, largest_allocation=largest))
    with asked_of(session) as sizes:
        model = build(axis)
    assert max(sizes) <= largest
    assert bits(model) == expect(axis)


@pytest.mark.parametrize("largest, name", [(50_000, "offsets"), (125_000, "depths")])
def test_a_result_above_the_largest_allocation_is_refused_by_name(
    session: Session, monkeypatch: pytest.MonkeyPatch, largest: int, name: str
) -> None:
    monkeypatch.setattr(session, "device", replace(session.device, largest_allocation=largest))
    text = rf"need [0-9,]+ bytes in one buffer for {name} along z; .* allows {largest:,}\."
    with asked_of(session) as sizes, pytest.raises(OutOfMemoryError, match=text):
        build("z")
    assert max(sizes, default=0) <= largest


# Failures


@pytest.mark.parametrize("axis", ["y", "xyz"])
@pytest.mark.parametrize("budget", [None, 140_000])
def test_each_failing_allocation_is_out_of_memory(
    session: Session, axis: DexelAxis, budget: int | None
) -> None:
    """And nothing stays in use, though the traceback is still there."""
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=1.0)
    options: Any = {"grid": Grid.fit(mesh, resolution=20), "axis": axis}
    right = bits(clvox.dexelize(mesh, **options))
    gc.collect()
    with asked_of(session) as sizes:
        clvox.dexelize(mesh, **options, memory_budget=budget)
    gc.collect()
    before = session.nbytes
    assert len(sizes) > 10
    for number in range(1, len(sizes) + 1, 1 + len(sizes) // 60):
        with asked_of(session, number), pytest.raises(OutOfMemoryError, match="no room") as caught:
            clvox.dexelize(mesh, **options, memory_budget=budget)
        assert session.nbytes == before
        assert session.current_job is None
        assert isinstance(caught.value.__cause__, cl.MemoryError)
    assert bits(clvox.dexelize(mesh, **options, memory_budget=budget)) == right


@pytest.mark.parametrize("budget", [None, 140_000])
def test_work_can_be_ended_at_any_time(
    session: Session, monkeypatch: pytest.MonkeyPatch, budget: int | None
) -> None:
    """Between any two launches; what was taken is given back at once."""
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=1.0)
    options: Any = {"grid": Grid.fit(mesh, resolution=20), "memory_budget": budget}
    right = bits(clvox.dexelize(mesh, **options))
    gc.collect()
    monkeypatch.setattr(sessions, "STEPS_PER_LAUNCH", 1 << 10)
    monkeypatch.setattr(sessions, "ITEMS_PER_LAUNCH", 64)
    monkeypatch.setattr(lists, "LEAST_TILES", 1)
    before = session.nbytes
    told: list[int] = []
    left = [0]

    def stop(done: int, total: int) -> None:
        assert 0 <= done <= total
        told.append(done)
        left[0] -= 1
        if not left[0]:
            raise KeyboardInterrupt

    clvox.dexelize(mesh, **options, progress=stop)
    gc.collect()
    assert session.nbytes == before
    assert told == sorted(told)
    assert told[-1] == len(mesh.faces)
    calls = -left[0]
    assert len(set(told)) > 5
    for number in range(1, calls + 1, max(calls // 25, 1)):
        left[0] = number
        with pytest.raises(KeyboardInterrupt) as caught:
            clvox.dexelize(mesh, **options, progress=stop)
        assert session.nbytes == before, caught
    monkeypatch.undo()
    assert bits(clvox.dexelize(mesh, **options)) == right


def test_parts_of_a_mesh_know_the_numbers_of_their_triangles() -> None:
    vertices = 4 * np.arange(30, dtype=np.int32).reshape(10, 3)
    faces = np.array([[0, 0, 1], [4, 5, 6], [1, 1, 1], [8, 9, 8], [2, 1, 0]], np.int32)
    mesh = FacetChunks(vertices, faces, 2)
    assert [mesh.numbers_in(part).tolist() for part in range(3)] == [[0, 1], [2, 3], [4]]
    low = mesh.within([0], np.array([0]), np.array([20]))
    assert [low.numbers_in(part).tolist() for part in range(2)] == [[0, 2], [4]]
    lower = low.within([0], np.array([24]), np.array([24]))
    assert lower.numbers_in(0).tolist() == [4]
