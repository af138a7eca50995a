"""Cutters sweep what they should, and what they take adds up."""

from __future__ import annotations

import gc
import itertools

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

import clvox
from clvox import Cutter, DexelModel, Grid, GridError
from clvox.device import Session
from clvox.models.milling import SIDE, Work

Floats = NDArray[np.float64]

GRID = Grid((-6.0, -5.0, -2.0), (0.25, 0.2, 0.1), (48, 50, 40))
CUTTERS = [Cutter.flat(1.3), Cutter.ball(1.3), Cutter.bull(1.3, 0.5), Cutter.bull(1.3, 1.2)]
MOVES: list[tuple[tuple[float, ...], tuple[float, ...]]] = [
    ((-3, -2, 0.5), (3, 1, 0.5)),
    ((-3, -2, 1.0), (2, 3, 0.0)),
    ((2, 3, -1.5), (-1, 3, 1.5)),
    ((0, -4, 0.3), (0, 4, 0.9)),
    ((1, 1, 1), (1, 1, -1)),
    ((1, 1, 0.5), (1, 1, 0.5)),
    ((1, 1, 0.5), (1.001, 1, 0.7)),
    ((-9, -9, 0), (9, 9, 1)),
]

every_cutter = pytest.mark.parametrize("cutter", CUTTERS, ids=str)


def block() -> DexelModel:
    """A plate with a hollow in it."""
    outer = trimesh.creation.box(bounds=[(-5, -4, -1.5), (5, 4, 1.5)])
    inner = trimesh.creation.box(bounds=[(-2, -2, -0.5), (2, 2, 0.5)])
    inner.invert()
    return clvox.dexelize(outer + inner, grid=GRID, axis="z")


def sampled(cutter: Cutter, start: Floats, stop: Floats, x: Floats, y: Floats) -> Floats:
    """The lowest place over many places of the tip, each by the definition of the cutter."""
    lowest = np.full(x.shape, np.inf)
    for at in np.linspace(0, 1, 3001):
        tip = start + at * (stop - start)
        away = np.hypot(x - tip[0], y - tip[1])
        flat = cutter.radius - cutter.corner
        rounding = cutter.corner - np.sqrt(np.maximum(cutter.corner**2 - (away - flat) ** 2, 0))
        height = tip[2] + np.where(away <= flat, 0.0, rounding)
        lowest = np.minimum(lowest, np.where(away <= cutter.radius, height, np.inf))
    return lowest


@every_cutter
@pytest.mark.parametrize("move", MOVES, ids=str)
def test_a_sweep_is_that_of_many_places(
    cutter: Cutter, move: tuple[tuple[float, ...], tuple[float, ...]]
) -> None:
    start, stop = (np.array(end, dtype=np.float64) for end in move)
    x, y = np.random.default_rng(5).uniform(-5, 5, (2, 400))
    x[:3], y[:3] = (start[0], stop[0], (start[0] + stop[0]) / 2), (start[1], stop[1], start[1])
    exact = cutter.lowest(start, stop, x, y)
    brute = sampled(cutter, start, stop, x, y)
    reached = np.isfinite(brute)
    assert np.isfinite(exact[reached]).all()
    assert (exact[reached] <= brute[reached] + 1e-12).all()
    # Samples miss the very rim of the cutter, where its side is steep; elsewhere they are close.
    inner = Cutter(cutter.radius * 0.97, 0.9 * cutter.corner)
    within = np.isfinite(sampled(inner, start, stop, x, y))
    assert within.any()
    step = float(np.linalg.norm(stop - start)) / 3000
    assert (brute[within] - exact[within]).max() <= 5 * step + 1e-12
    beyond = Cutter(cutter.radius * 1.01, cutter.corner)
    assert not np.isfinite(exact[~np.isfinite(sampled(beyond, start, stop, x, y))]).any()


@every_cutter
def test_what_moves_take_adds_up(cutter: Cutter) -> None:
    model = block()
    rng = np.random.default_rng(3)
    path = np.column_stack([rng.uniform(-6, 6, (40, 2)), rng.uniform(-1.8, 2, 40)])
    whole = model.cut(cutter, path)
    assert whole.removed.shape == whole.engagement.shape == (39,)
    assert whole.removed.sum() == pytest.approx(model.volume - whole.model.volume, rel=1e-13)
    assert (whole.removed >= 0).all()
    left = model
    for number in range(39):
        one = left.cut(cutter, path[number : number + 2])
        assert one.removed[0] == pytest.approx(left.volume - one.model.volume, abs=1e-12)
        assert one.removed[0] == whole.removed[number]
        assert one.engagement[0] == whole.engagement[number]
        taken = left.thickness() - one.model.thickness()
        assert one.engagement[0] == pytest.approx(taken.max(), abs=1e-12)
        left = one.model
    assert left == whole.model
    assert (model & whole.model) == whole.model


@every_cutter
def test_rays_end_where_the_cutter_was_lowest(cutter: Cutter) -> None:
    model = block()
    start, stop = np.array([-4.0, -1, 0.8]), np.array([3.0, 2, -0.2])
    cut = model.cut(cutter, [start, stop])
    k, j, i = 0, *np.divmod(np.arange(50 * 48), 48)
    centers = GRID.centers(np.stack([i, j, k + 0 * i], axis=1))
    lowest = cutter.lowest(start, stop, centers[:, 0], centers[:, 1])
    offsets, _, leave = cut.model.intervals()
    before, _, whole = model.intervals()
    unit = GRID.spacing[2] / 2**18
    for ray in range(len(lowest)):
        mine = leave[int(offsets[ray]) : int(offsets[ray + 1])]
        theirs = whole[int(before[ray]) : int(before[ray + 1])]
        assert (mine <= lowest[ray] + unit).all()
        if len(theirs) and theirs[-1] <= lowest[ray]:
            assert mine.tolist() == theirs.tolist()


@every_cutter
def test_tiles_that_are_skipped_change_nothing(cutter: Cutter) -> None:
    """Each ray ends at the lowest of all places, each worked out for all rays."""
    model = block()
    rng = np.random.default_rng(9)
    path = np.column_stack([rng.uniform(-7, 7, (60, 2)), rng.uniform(-2.5, 2, 60)])
    path[5:9, :2] = path[5, :2]
    path[20:30, 2] = path[20, 2]
    i, j = np.tile(np.arange(48), 50), np.repeat(np.arange(50), 48)
    x, y = GRID.centers(np.stack([i, j, 0 * i], axis=1)).T[:2]
    lowest = np.full(len(x), np.inf)
    for start, stop in itertools.pairwise(path):
        lowest = np.minimum(lowest, cutter.lowest(start, stop, x, y))
    top = np.ceil(((lowest - GRID.origin[2]) / GRID.spacing[2] - 0.5) * 2**18)
    offsets = model._pieces.offsets.get().astype(np.int64)
    ends = model._pieces.depth.get().astype(np.int64).reshape(-1, 2)
    rays = np.repeat(np.arange(len(x)), np.diff(offsets) // 2)
    kept = ends[:, 0] < top[rays]
    left = np.minimum(ends, top[rays][:, None]).astype(np.int64)[kept]
    cut = model.cut(cutter, path).model
    np.testing.assert_array_equal(cut.fixed_depths, left.ravel())
    np.testing.assert_array_equal(
        np.diff(cut.offsets.astype(int)), 2 * np.bincount(rays[kept], minlength=len(x))
    )


def test_moves_look_only_at_tiles_with_something_to_cut() -> None:
    """Not at those of the box around a move, nor where the solid is below, or cut away already."""
    model = clvox.dexelize(trimesh.creation.box((120.0, 120.0, 4.0)), pitch=1.0)
    work = Work(model.grid, model._frame, model._pieces)

    def looked(radius: float, *path: tuple[float, float, float]) -> int:
        before = work.looked_at
        start, stop = (np.array(end, dtype=np.float64) for end in path)
        work.cut(0, Cutter.ball(radius), start, stop)
        return work.looked_at - before

    assert (120 // SIDE) ** 2 == 225
    assert looked(2, (-50, -50, 3), (50, 50, 2.5)) == 0
    assert 13 <= looked(2, (-50, -50, 0), (50, 50, 0)) <= 45
    assert looked(2, (-70, 0, 0), (-64, 0, 0)) == 0
    # In the last quarter the tip is lower than the solid is high.
    assert 4 <= looked(2, (-60, 30, 8), (60, 30, 0)) <= 8
    through = (-50.0, 20.0, -30.0), (50.0, 20.0, -30.0)
    first = looked(12, *through)
    # What is left there is around what has gone.
    assert 0 < looked(12, *through) < 0.7 * first


def test_work_is_told_of_and_can_be_ended(session: Session) -> None:
    model, path = block(), np.random.default_rng(2).uniform(-1, 1, (12, 3))
    told: list[tuple[int, int]] = []
    whole = model.cut(CUTTERS[0], path, progress=lambda *now: told.append(now))
    assert told == [(n, 11) for n in range(1, 12)]
    gc.collect()
    before = session.nbytes

    def stop(done: int, _: int) -> None:
        if done == 5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        model.cut(CUTTERS[0], path, progress=stop)
    assert session.nbytes == before
    assert model.cut(CUTTERS[0], path, progress=True).model == whole.model


@every_cutter
@pytest.mark.parametrize("far", [1e-30, 1e-99, 1e-160, 1e-310])
def test_a_move_that_hardly_moves_is_a_plunge(cutter: Cutter, far: float) -> None:
    """Its slope, and the square of its slope, would overflow."""
    model = block()
    plunge = model.cut(cutter, [(0, 0, 5), (0, 0, 0.25)])
    hardly = model.cut(cutter, [(0, 0, 5), (far, 0, 0.25)])
    assert hardly.removed[0] == pytest.approx(plunge.removed[0], rel=1e-4)


def test_a_budget_without_room_for_the_rays_is_refused_at_once() -> None:
    told: list[tuple[int, int]] = []
    with pytest.raises(clvox.OutOfMemoryError, match="bytes more are needed"):
        block().cut(
            CUTTERS[0],
            [(-5, 0, 1), (5, 0, 1)],
            memory_budget=64,
            progress=lambda *now: told.append(now),
        )
    assert not told


def test_what_is_left_is_within_the_budget_or_refused(session: Session) -> None:
    model, path = block(), [(-5, -3, 1), (5, -3, 1)]
    whole = model.cut(CUTTERS[0], path)
    gc.collect()
    before = session.nbytes
    with pytest.raises(clvox.OutOfMemoryError, match="bytes more are needed"):
        model.cut(CUTTERS[0], path, memory_budget=whole.model.nbytes // 2)
    assert session.nbytes == before
    enough = whole.model.nbytes * 17 // 16
    assert model.cut(CUTTERS[0], path, memory_budget=enough).model == whole.model
    assert model.volume > whole.model.volume


def test_ends_name_the_move_that_made_them() -> None:
    moves = [(-5, -3, 1), (5, -3, 1), (5, -3, 3), (5, 3, 3), (5, 3, 0.5), (-5, 3, 0.5)]
    cut = block().cut(Cutter.flat(0.6), moves)
    made = cut.model.triangles[cut.model.operands == 1]
    assert set(made.tolist()) == {0, 3, 4}
    assert cut.removed[1] == cut.removed[2] == 0
    assert (cut.removed[[0, 3, 4]] > 0).all()
    assert cut.engagement[0] == pytest.approx(0.5, abs=1e-5)
    assert cut.engagement[4] == pytest.approx(1.0, abs=1e-5)


def test_what_makes_no_sense_is_refused() -> None:
    with pytest.raises(GridError, match="radius of a cutter must be positive, got 0"):
        Cutter.flat(0)
    with pytest.raises(GridError, match="corner of a cutter must be between 0 and its radius"):
        Cutter.bull(1, 2)
    for values in (("1",), (1, "0"), (True,)):
        with pytest.raises(GridError, match="of a cutter must be a number"):
            Cutter(*values)
    model = block()
    for path in ([(0, 0, 0)], [0, 0, 0], [(0, 0), (1, 1)]):
        with pytest.raises(GridError, match="a path has the shape"):
            model.cut(CUTTERS[0], path)
    with pytest.raises(GridError, match=r"a path must be \(n, 3\) numbers"):
        model.cut(CUTTERS[0], [(0, 0, 0), (1, 1)])
    with pytest.raises(GridError, match="cutter must be a Cutter, got 'ball'"):
        model.cut("ball", [(0, 0, 0), (1, 1, 1)])  # type: ignore[arg-type]
    with pytest.raises(GridError, match="finite"):
        model.cut(CUTTERS[0], [(0, 0, np.nan), (1, 1, 1)])
    with pytest.raises(GridError, match=r"none beyond 1e\+100"):
        model.cut(CUTTERS[0], [(0, 0, 1e308), (1, 0, -1e308)])
    triple = clvox.dexelize(trimesh.creation.box(), resolution=8, axis="xyz")
    with pytest.raises(GridError, match=r"Cut the bundle along z \(model.z.cut\)"):
        triple.cut(CUTTERS[0], [(0, 0, 0), (1, 1, 1)])
    sideways = clvox.dexelize(trimesh.creation.box(), resolution=8, axis="x")
    with pytest.raises(GridError, match="rays must be along z, got x"):
        sideways.cut(CUTTERS[0], [(0, 0, 0), (1, 1, 1)])


@pytest.mark.parametrize("axis", ["z", "xyz"])
def test_a_model_is_clamped_anew(axis: str) -> None:
    mesh = trimesh.creation.torus(3.0, 1.0, major_sections=48, minor_sections=24)
    grid = Grid((-4.5, -4.5, -4.5), 0.15, (60, 60, 60))
    options = {"grid": grid, "axis": axis}
    model = clvox.dexelize(mesh, **options)  # type: ignore[call-overload]
    turn = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]], np.float64)
    found = model.moved(turn)
    assert type(found) is type(model)
    assert found.grid == grid
    expected = clvox.dexelize(mesh.copy().apply_transform(turn), **options)  # type: ignore[call-overload]
    lost = (found ^ expected).volume / model.volume
    assert lost < (0.005 if axis == "xyz" else 0.05)
    assert (found | model).volume > model.volume
    with pytest.raises(clvox.MeshError, match="nothing to move"):
        (model - model).moved(turn)


def test_transforms_that_make_no_sense_are_refused() -> None:
    grid = Grid((-1, -1, -1), 0.1, (20, 20, 20))
    for axis in ("z", "xyz"):
        model = clvox.dexelize(trimesh.creation.icosphere(), grid=grid, axis=axis)
        with pytest.raises(GridError, match=r"\(4, 4\) finite numbers, got .* shape \(3, 3\)"):
            model.moved(np.eye(3))
        with pytest.raises(GridError, match=r"transform must be \(4, 4\) finite numbers"):
            model.moved(np.full((4, 4), np.nan))
        with pytest.raises(GridError, match=r"transform must be \(4, 4\) numbers"):
            model.moved([[1, 0], [1]])
        far = np.eye(4)
        far[0, 3] = 200
        with pytest.raises(GridError, match="the model has 14") as refused:
            model.moved(far)
        assert "lattice_bits=14" not in str(refused.value)


def test_moved_models_combine_on_a_coarse_lattice() -> None:
    grid = Grid((-1, -1, -1), 0.1, (20, 20, 20))
    model = clvox.dexelize(trimesh.creation.icosphere(), grid=grid, lattice_bits=8)
    moved = model.moved(np.eye(4))
    assert moved.fraction_bits == model.fraction_bits
    assert (moved ^ model).volume < 0.1 * model.volume
