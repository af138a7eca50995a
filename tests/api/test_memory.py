"""What building may take, what happens when it may not, and that the voxels are the same."""

from __future__ import annotations

import gc
import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
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
from clvox.errors import GridError, OutOfMemoryError
from clvox.grid import Grid, Lattice
from clvox.models.attributes import Attribute
from clvox.models.construct import Fill
from clvox.models.memory import LEAST_WORK
from clvox.ops import crossings
from clvox.ops.facets import FacetChunks, pad

FILLS: list[Fill] = ["parity", "nonzero", "positive", "surface"]
MB = 10**6


def overlapping() -> trimesh.Trimesh:
    """Three balls, of which two overlap and one is turned inside out within another."""
    bodies = [trimesh.creation.icosphere(subdivisions=4, radius=5.0) for _ in range(3)]
    bodies[1].apply_translation([4, 1, 2])
    bodies[2].apply_scale(0.5)
    bodies[2].invert()
    return cast("trimesh.Trimesh", trimesh.util.concatenate(bodies))


MESH = overlapping()
FINE = Grid.fit(MESH, resolution=320)
GRIDS = {"one": Grid.fit(MESH, resolution=160), "two": FINE, "three": FINE}
LEVELS: dict[str, Any] = {
    "one": [GRIDS["one"].shape],
    "two": None,
    "three": [[-(-count // 32) for count in FINE.shape], (4, 4, 4), (8, 8, 8)],
}


def build(levels: str, fill: Fill = "parity", budget: int | None = None) -> clvox.VoxelModel:
    return clvox.voxelize(
        MESH, grid=GRIDS[levels], levels=LEVELS[levels], fill=fill, memory_budget=budget
    )


def bits(model: clvox.VoxelModel) -> dict[str, Any]:
    return {name: array.tobytes() for name, array in model.to_record().items()}


expected: dict[tuple[str, str], dict[str, Any]] = {}


def expect(levels: str, fill: Fill) -> dict[str, Any]:
    """The bits of the model without a budget."""
    if (levels, fill) not in expected:
        expected[levels, fill] = bits(build(levels, fill))
    return expected[levels, fill]


# The same voxels


@pytest.mark.parametrize("fill", FILLS)
@pytest.mark.parametrize("levels", LEVELS)
def test_a_megabyte_gives_the_same_bits(levels: str, fill: Fill) -> None:
    model = build(levels, fill, MB)
    assert bits(model) == expect(levels, fill)
    assert model.nbytes <= model.report.peak_nbytes <= MB
    assert model.report.odd_rays == 0


@settings(max_examples=25)
@given(
    levels=st.sampled_from(list(LEVELS)),
    fill=st.sampled_from(FILLS),
    budget=st.integers(500_000, 1_500_000),
)
def test_any_budget_gives_the_same_bits(levels: str, fill: Fill, budget: int) -> None:
    """Or says what is needed, and that is enough."""
    model, granted = grown(levels, fill, budget)
    assert bits(model) == expect(levels, fill)
    assert model.report.peak_nbytes <= granted


def needed_by(error: OutOfMemoryError) -> int:
    """The bytes that a message says are needed."""
    found = re.search(r"need ([0-9,]+) bytes of the device", str(error))
    assert found, error
    return int(found[1].replace(",", ""))


def grown(levels: str, fill: Fill, budget: int) -> tuple[clvox.VoxelModel, int]:
    """A model, and the budget that it was made within: that given, or what messages ask for.

    There is one message at most for the cells of each level, for the bricks, and for a slab.
    """
    for _ in range(4):
        try:
            return build(levels, fill, budget), budget
        except OutOfMemoryError as error:
            needed = needed_by(error)
        assert needed > budget
        budget = needed
    return build(levels, fill, budget), budget


def test_a_small_budget_cuts_the_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """So that the tests above test something."""
    _, least = grown("two", "parity", 1)
    slabs, parts = [], []
    flip = crossings.flip_bricks

    def count(*arguments: Any, **options: Any) -> None:
        slabs.append(arguments[-1].slab)
        parts.append(arguments[1].parts)
        flip(*arguments, **options)

    monkeypatch.setattr(crossings, "flip_bricks", count)
    build("two")
    assert (len(slabs), parts) == (1, [1])
    slabs.clear()
    parts.clear()
    build("two", budget=least)
    assert len(slabs) > 3
    assert sum(slab.layers for slab in slabs) == -(-FINE.shape[2] // 8)
    assert max(parts) > 3


def test_attributes_are_within_the_budget_beside_the_model(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=1.0)

    def build(budget: int | None = None) -> clvox.VoxelModel:
        return clvox.voxelize(
            mesh, resolution=64, attributes=("normals", "links"), memory_budget=budget
        )

    gc.collect()
    before = session.nbytes
    taken = []
    allocate = session.empty

    def note(*arguments: Any) -> Any:
        array = allocate(*arguments)
        taken.append(session.nbytes - before)
        return array

    monkeypatch.setattr(session, "empty", note)
    peak = build().report.peak_nbytes
    monkeypatch.undo()
    # Blocks are rounded up by a sixteenth at most.
    assert max(taken) <= peak <= max(taken) * 17 // 16
    assert build(peak).report.peak_nbytes == peak
    with pytest.raises(OutOfMemoryError, match="bytes more are needed"):
        build(peak - 1)


@pytest.mark.parametrize("fill", ["parity", "winding"])
def test_attributes_can_be_ended(
    session: Session, monkeypatch: pytest.MonkeyPatch, fill: Fill
) -> None:
    """With the model given back; and the report of the model without them stays what it was."""
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=1.0)
    told: list[tuple[int, int]] = []
    left = [-1]

    def stop(done: int, total: int) -> None:
        told.append((done, total))
        left[0] -= 1
        if not left[0]:
            raise KeyboardInterrupt

    def build(*names: Attribute) -> clvox.VoxelModel:
        told.clear()
        return clvox.voxelize(mesh, resolution=16, fill=fill, attributes=names, progress=stop)

    build()
    calls = len(told)
    reports = []
    keep = clvox.VoxelModel._keeping

    def note(model: clvox.VoxelModel, names: tuple[Attribute, ...]) -> clvox.VoxelModel:
        reports.append(model.report)
        return keep(model, names)

    monkeypatch.setattr(clvox.VoxelModel, "_keeping", note)
    model = build("normals", "links")
    assert "attributes" in model.report.seconds
    assert "attributes" not in reports[0].seconds
    more = told[calls:]
    assert len(more) > 5
    assert set(more) == {told[calls - 1]} == {(2 * len(mesh.faces),) * 2}
    del model
    gc.collect()
    before = session.nbytes
    for number in range(1, len(more) + 1):
        left[0] = calls + number
        with pytest.raises(KeyboardInterrupt) as caught:
            build("normals", "links")
        assert session.nbytes == before, caught


def test_models_that_are_there_do_not_count() -> None:
    """The budget and the report are of one build."""
    alone = build("two").report.peak_nbytes
    kept = [build("one") for _ in range(3)]
    model = build("two", budget=MB)
    assert model.report.peak_nbytes <= MB < sum(one.nbytes for one in kept) + model.nbytes
    assert build("two").report.peak_nbytes == alone


def test_the_pool_is_emptied_rather_than_grow(session: Session) -> None:
    """Blocks kept for the next job count too, once they stand in the way."""
    _, least = grown("two", "parity", 1)
    build("one", "nonzero")
    gc.collect()
    before = session.nbytes
    held = session._pool.managed_bytes - before
    assert held > MB > least
    model = build("two", budget=least)
    assert session._pool.managed_bytes - before <= least
    assert session.nbytes - before == model.nbytes


# What cannot fit


@pytest.mark.parametrize("fill", ["parity", "surface"])
@pytest.mark.parametrize("levels", LEVELS)
@pytest.mark.parametrize("budget", [70_000, 150_000, 320_000])
def test_refusals_say_what_would_fit(
    session: Session, levels: str, fill: Fill, budget: int
) -> None:
    """A wider pitch, which does fit into the same budget; nothing large is allocated before."""
    model = build(levels, fill)
    with asked_of(session) as sizes, pytest.raises(OutOfMemoryError) as caught:
        build(levels, fill, budget)
    assert model._arrays.voxels.nbytes not in sizes
    assert "{} x {} x {} voxels need".format(*GRIDS[levels].shape) in str(caught.value)
    assert needed_by(caught.value) > budget
    assert f"; {budget:,} may be used" in str(caught.value)
    sides = LEVELS[levels][1:] if LEVELS[levels] else [(8, 8, 8)]
    heed(caught.value, MESH, sides, fill, budget)


def heed(
    error: OutOfMemoryError, mesh: trimesh.Trimesh, sides: list[Any], fill: Fill, budget: int
) -> None:
    """Do as the message says, which must do."""
    found = re.search(r"A pitch of ([0-9.]+), about ([0-9]+) voxels along the longest", str(error))
    assert found, error
    grid = Grid.fit(mesh, pitch=float(found[1]))
    assert abs(max(grid.shape) - int(found[2])) <= 2
    cells = -(-np.array(grid.shape) // np.prod(np.array([(1, 1, 1), *sides]), axis=0))
    clvox.voxelize(mesh, grid=grid, levels=[cells, *sides], fill=fill, memory_budget=budget)


@pytest.mark.parametrize("brick", [(8, 8, 8), (16, 2, 16)])
def test_refusals_say_what_would_fit_for_a_plate(brick: Any) -> None:
    """All bricks are in one slab, and must have room to be filled."""
    plate = trimesh.creation.box((10, 10, 0.2))
    grid = Grid.fit(plate, resolution=640)
    cells = -(-np.array(grid.shape) // brick)
    with pytest.raises(OutOfMemoryError) as caught:
        clvox.voxelize(plate, grid=grid, levels=[cells, brick], memory_budget=160_000)
    heed(caught.value, plate, [brick], "parity", 160_000)


def test_a_budget_for_nothing() -> None:
    with pytest.raises(OutOfMemoryError, match=r"may be used\. Otherwise give a larger"):
        build("two", budget=LEAST_WORK // 2)


@pytest.mark.parametrize("budget", [0, -1, 1.5, "1MB", math.nan])
def test_budgets_that_make_no_sense(budget: Any) -> None:
    with pytest.raises(GridError, match="memory_budget must be a positive whole number of bytes"):
        build("two", budget=budget)


def test_by_default_most_of_what_the_device_has(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    small = replace(session.device, memory=session.nbytes + 200_000)
    monkeypatch.setattr(session, "device", small)
    with pytest.raises(OutOfMemoryError, match="may be used"):
        build("two")
    monkeypatch.undo()
    assert bits(build("two")) == expect("two", "parity")


# The largest allocation


@pytest.mark.parametrize("fill", FILLS)
@pytest.mark.parametrize("levels", ["two", "three"])
def test_no_buffer_above_the_largest_allocation(
    session: Session, monkeypatch: pytest.MonkeyPatch, levels: str, fill: Fill
) -> None:
    """The mesh, the planes and the lists are cut; the bricks are what must fit."""
    largest = session.size_of(build(levels, fill)._arrays.voxels.nbytes)
    largest = min(largest, 10**9)
    monkeypatch.setattr(session, "device", replace(session.device, largest_allocation=largest))
    with asked_of(session) as sizes:
        model = build(levels, fill)
    assert max(sizes) <= largest
    assert bits(model) == expect(levels, fill)


@pytest.mark.parametrize(
    ("levels", "largest", "name"),
    [
        ("one", 100_000, "voxels"),
        ("two", 100_000, "bricks"),
        ("two", 3000, "boundary"),
        ("three", 1000, "middle_boundary"),
        ("three", 60_000, "bricks"),
    ],
)
def test_a_result_above_the_largest_allocation_is_refused_by_name(
    session: Session, monkeypatch: pytest.MonkeyPatch, levels: str, largest: int, name: str
) -> None:
    monkeypatch.setattr(session, "device", replace(session.device, largest_allocation=largest))
    text = rf"voxels need [0-9,]+ bytes in one buffer for {name}; .* allows {largest:,}\."
    with asked_of(session) as sizes, pytest.raises(OutOfMemoryError, match=text):
        build(levels)
    assert max(sizes, default=0) <= largest


# Failures


class Watching:
    """Stands in for a session's pool: notes what is asked for, and may fail."""

    def __init__(self, pool: Any, fail_at: int | None = None) -> None:
        self._pool = pool
        self.fail_at = fail_at
        self.sizes: list[int] = []

    def __call__(self, size: int) -> Any:
        self.sizes.append(size)
        if self.fail_at == len(self.sizes):
            raise cl.MemoryError("no memory left, says the test")
        return self._pool(size)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._pool, name)


@contextmanager
def asked_of(session: Session, fail_at: int | None = None) -> Iterator[list[int]]:
    """The sizes of all buffers that are asked for."""
    pool = session._pool
    watching = Watching(pool, fail_at)
    session._pool = cast("Any", watching)
    try:
        yield watching.sizes
    finally:
        session._pool = pool


@pytest.mark.parametrize("fill", ["parity", "nonzero", "surface"])
@pytest.mark.parametrize("levels", LEVELS)
@pytest.mark.parametrize("budget", [None, 900_000])
def test_each_failing_allocation_is_out_of_memory(
    session: Session, levels: str, fill: Fill, budget: int | None
) -> None:
    """And nothing stays in use, though the traceback is still there."""
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=1.0)
    grid = Grid.fit(mesh, resolution=32)
    sides = LEVELS[levels][1:] if levels == "three" else []
    shapes = [grid.shape] if levels == "one" else None
    if sides:
        shapes = [cast("Any", (1, 1, 1)), *sides]
    options: dict[str, Any] = {"grid": grid, "levels": shapes, "fill": fill}
    right = bits(clvox.voxelize(mesh, **options))
    gc.collect()
    with asked_of(session) as sizes:
        clvox.voxelize(mesh, **options, memory_budget=budget)
    gc.collect()
    before = session.nbytes
    assert len(sizes) >= 3
    for number in range(1, len(sizes) + 1):
        with asked_of(session, number), pytest.raises(OutOfMemoryError, match="no room") as caught:
            clvox.voxelize(mesh, **options, memory_budget=budget)
        assert session.nbytes == before
        assert session.current_job is None
        assert isinstance(caught.value.__cause__, cl.MemoryError)
    assert bits(clvox.voxelize(mesh, **options, memory_budget=budget)) == right


@pytest.mark.parametrize("fill", ["parity", "nonzero", "surface"])
@pytest.mark.parametrize("levels", ["one", "two"])
def test_work_can_be_ended_at_any_time(
    session: Session, monkeypatch: pytest.MonkeyPatch, levels: str, fill: Fill
) -> None:
    """Between any two launches; what was taken is given back at once."""
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=1.0)
    grid = Grid.fit(mesh, resolution=40)
    options: dict[str, Any] = {
        "grid": grid,
        "levels": [grid.shape] if levels == "one" else None,
        "fill": fill,
    }
    right = bits(clvox.voxelize(mesh, **options))
    gc.collect()
    monkeypatch.setattr(sessions, "STEPS_PER_LAUNCH", 1)
    monkeypatch.setattr(sessions, "ITEMS_PER_LAUNCH", 64)
    before = session.nbytes
    left = [0]

    def stop(done: int, total: int) -> None:
        assert 0 <= done <= total
        left[0] -= 1
        if not left[0]:
            raise KeyboardInterrupt

    clvox.voxelize(mesh, **options, progress=stop)
    gc.collect()
    assert session.nbytes == before
    calls = -left[0]
    assert calls > 10
    for number in range(1, calls + 1, max(calls // 40, 1)):
        left[0] = number
        with pytest.raises(KeyboardInterrupt) as caught:
            clvox.voxelize(mesh, **options, progress=stop)
        assert session.nbytes == before, caught
    monkeypatch.undo()
    assert bits(clvox.voxelize(mesh, **options)) == right


@pytest.mark.parametrize("fill", ["parity", "nonzero", "winding"])
def test_who_is_told_may_use_other_models(session: Session, fill: Fill) -> None:
    """Which are no part of the work: they do not count, and stay if it is ended."""
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=1.0)
    other = clvox.voxelize(mesh, resolution=32)
    expected = (~other).to_array()
    plain = clvox.voxelize(mesh, resolution=16, fill=fill)
    made: list[clvox.VoxelModel] = []

    def look(*_: int) -> None:
        assert session.current_job is None
        made.append(~other)

    model = clvox.voxelize(mesh, resolution=16, fill=fill, progress=look)
    assert model == plain
    assert model.report.peak_nbytes == plain.report.peak_nbytes
    calls = len(made)
    made.clear()

    def stop(done: int, total: int) -> None:
        look(done, total)
        if len(made) == calls:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        clvox.voxelize(mesh, resolution=16, fill=fill, progress=stop)
    assert session.current_job is None
    for each in made:
        np.testing.assert_array_equal(each.to_array(), expected)


@pytest.mark.parametrize("fill", FILLS)
@pytest.mark.parametrize("levels", LEVELS)
def test_progress_of_work_in_pieces_goes_up_to_the_end(levels: str, fill: Fill) -> None:
    told: list[tuple[int, int]] = []
    clvox.voxelize(
        MESH,
        grid=GRIDS[levels],
        levels=LEVELS[levels],
        fill=fill,
        memory_budget=800_000,
        progress=lambda *now: told.append(now),
    )
    done, totals = zip(*told, strict=True)
    assert set(totals) == {2 * len(MESH.faces)}
    assert list(done) == sorted(done)
    assert done[0] < done[-1] == totals[0]
    assert len(set(done)) > 2


def test_each_launch_is_told_of(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of the last stages too, during which no triangle is done."""
    told: dict[str, int] = {}

    def count(steps: int) -> int:
        monkeypatch.setattr(sessions, "STEPS_PER_LAUNCH", steps)
        monkeypatch.setattr(sessions, "ITEMS_PER_LAUNCH", 64)
        calls: list[Any] = []
        clvox.voxelize(
            MESH, grid=GRIDS["one"], levels=LEVELS["one"], progress=lambda *now: calls.append(now)
        )
        told[str(steps)] = sum(now[0] == now[1] for now in calls)
        return len(calls)

    assert count(1) > 10 * count(1 << 30)
    assert told["1"] > told[str(1 << 30)]


def test_a_mesh_in_parts_has_all_its_triangles(session: Session) -> None:
    vertices = np.arange(30, dtype=np.int32).reshape(10, 3)
    faces = np.array([[0, 1, 2], [3, 4, 5], [9, 8, 7], [6, 6, 1], [2, 0, 9]], np.int32)
    mesh = FacetChunks(vertices, faces, 2)
    assert (mesh.triangles, mesh.parts) == (5, 3)
    found = [mesh.part(session, number) for number in range(3)]
    assert [part.triangles for part in found] == [2, 2, 1]
    rows = [part.vertices.get()[:-1].reshape(-1, 3) for part in found]
    corners = [row[part.faces.get()] for row, part in zip(rows, found, strict=True)]
    assert np.array_equal(np.concatenate(corners), vertices[faces])


def test_what_was_snapped_is_sent_as_it_lies() -> None:
    """Kernels load four numbers at the last corner, too."""
    points = np.random.default_rng(5).random((7, 3))
    steps = Lattice(Grid((0, 0, 0), 1, (2, 2, 2)), 8).snap(points)
    row = pad(steps)
    assert np.shares_memory(row, steps)
    assert row.shape == (22,)
    assert row[-1] == 0
    for other in (steps[1:], steps[:-1], steps.copy(), steps[::-1], np.asfortranarray(steps)):
        np.testing.assert_array_equal(pad(other), [*other.ravel(), 0])
        assert not np.shares_memory(pad(other), steps)
