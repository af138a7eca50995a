"""What is inside of open meshes: by the majority of three axes, and by winding number."""

from __future__ import annotations

import gc
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import trimesh

import clvox
from clvox.cli import main
from clvox.grid import Axis, Lattice
from clvox.mesh import check
from clvox.models.build import Fill
from clvox.models.memory import LEAST_WORK
from clvox.models.pieces import Pieces, directed_rim
from clvox.reference.winding import winding_numbers
from tests.api.test_fill import GRID, LEVELS, PAIRS, ball, every_level, voxelize
from tests.api.test_memory import asked_of

if TYPE_CHECKING:
    from clvox.device import Session

OPEN: tuple[Fill, Fill] = ("vote", "winding")

every_fill = pytest.mark.parametrize("fill", OPEN)


def with_a_hole(mesh: trimesh.Trimesh, beyond: float) -> trimesh.Trimesh:
    """The mesh without its triangles below a height."""
    kept = np.asarray(mesh.triangles_center)[:, 1] > beyond
    return trimesh.Trimesh(mesh.vertices, mesh.faces[kept], process=False)


@every_level
@every_fill
@pytest.mark.parametrize("pair", PAIRS)
def test_closed_meshes_are_not_guessed(fill: Fill, pair: str, levels: int) -> None:
    one, other = PAIRS[pair]
    both = one + other
    expected = voxelize(both, "parity" if fill == "vote" else "positive", levels=levels)
    model = voxelize(both, fill, levels=levels)
    assert model == expected
    assert model.levels == expected.levels
    assert model.report.fill == fill
    assert not model.report.odd_rays


@every_level
@every_fill
def test_a_ball_with_a_hole_is_nearly_a_ball(fill: Fill, levels: int) -> None:
    whole = ball(1.0, 0, 0, 0)
    model = voxelize(with_a_hole(whole, -0.95), fill, levels=levels)
    closed = voxelize(whole, "parity", levels=levels)
    assert (model ^ closed).count < 0.02 * closed.count
    assert any("open" in warning for warning in model.report.warnings)
    # Away from the hole nothing is in doubt.
    j = GRID.indices([[0.0, -0.8, 0.0]])[0, 1]
    np.testing.assert_array_equal(model.to_array()[:, j:], closed.to_array()[:, j:])


@every_fill
def test_levels_change_nothing(fill: Fill) -> None:
    opened = with_a_hole(ball(1.2, 0.1, 0.2, 0.3), -0.5)
    models = [voxelize(opened, fill, levels=levels) for levels in LEVELS]
    assert models[0] == models[1] == models[2]


@every_fill
def test_touched_voxels_are_known(fill: Fill) -> None:
    opened = with_a_hole(ball(1.2, 0.1, 0.2, 0.3), -0.5)
    model, shell = voxelize(opened, fill, levels=2), voxelize(opened, "surface", levels=2)
    touched = model.to_array(rule="touch") & ~model.to_array(rule="within")
    np.testing.assert_array_equal(touched, shell.to_array())


def test_the_report_names_the_rays_that_were_doubtful() -> None:
    opened = with_a_hole(ball(1.2, 0.1, 0.2, 0.3), -0.5)
    report = voxelize(opened, "vote", levels=2).report
    axes: tuple[Axis, ...] = ("x", "y", "z")
    named = set(report.first_doubtful_rays)
    for axis in axes:
        counts = clvox.count_crossings(opened, grid=GRID, axis=axis, lattice_bits=10)
        later, earlier = np.nonzero(counts % 2)
        assert report.doubtful_rays[axis] == len(later)
        rays = {(axis, u, v) for u, v in zip(earlier.tolist(), later.tolist(), strict=True)}
        assert len(rays) < 1000
        assert {ray for ray in named if ray[0] == axis} == rays
    assert report.odd_rays == sum(report.doubtful_rays.values()) > 0
    assert any("put to the vote" in warning for warning in report.warnings)


def test_only_the_first_doubtful_rays_are_named() -> None:
    sheet = trimesh.Trimesh([[0, 0, 0], [9, 0, 1], [9, 9, 2], [0, 9, 1]], [[0, 1, 2], [0, 2, 3]])
    report = clvox.voxelize(sheet, resolution=40, fill="vote").report
    assert report.doubtful_rays["z"] > 1000
    assert sum(axis == "z" for axis, _, _ in report.first_doubtful_rays) == 1000


@pytest.mark.parametrize("axes", [(0, 2, 1), (1, 0, 2), (2, 1, 0), (1, 2, 0)])
def test_winding_does_not_care_which_way_the_hole_is(axes: tuple[int, int, int]) -> None:
    """Rays and the curtain run along y, the axes are alike all the same."""
    grid = clvox.Grid((-1.5, -1.5, -1.5), 0.1, (30, 30, 30))
    cup = with_a_hole(ball(1.31, 0, 0, 0), -0.2)
    found = clvox.voxelize(cup, grid=grid, fill="winding").to_array()
    order = list(axes)
    turned = trimesh.Trimesh(np.asarray(cup.vertices)[:, order], cup.faces, process=False)
    if axes != (1, 2, 0):  # any other one is a reflection
        turned.faces = turned.faces[:, ::-1]
    other = clvox.voxelize(turned, grid=grid, fill="winding").to_array()
    # Array dimensions are (z, y, x); axis n of the turned mesh is axis `order[n]` of the first.
    expected = found.transpose(2, 1, 0).transpose(order).transpose(2, 1, 0)
    assert found.sum() > 4000
    assert np.count_nonzero(other != expected) <= 8


def test_triangles_that_disagree_have_no_winding() -> None:
    opened = with_a_hole(ball(1.0, 0, 0, 0), -0.9)
    faces = np.array(opened.faces)
    # One that is not at the hole.
    top = np.asarray(opened.triangles_center)[:, 1].argmax()
    faces[top] = faces[top, ::-1]
    mixed = trimesh.Trimesh(opened.vertices, faces, process=False)
    with pytest.raises(clvox.NotOrientedError, match="3 edges that several of them share"):
        voxelize(mixed, "winding", levels=2)
    # Which of them is wrong does not matter to parity along an axis.
    assert voxelize(mixed, "vote", levels=2) == voxelize(opened, "vote", levels=2)


def test_a_mesh_inside_out_has_nothing_inside() -> None:
    opened = with_a_hole(ball(1.0, 0, 0, 0), -0.9)
    opened.invert()
    assert voxelize(opened, "winding", levels=2).count == 0


def test_the_rim_runs_as_its_triangles_do() -> None:
    opened = with_a_hole(ball(1.0, 0, 0, 0), -0.9)
    surface = check(opened)
    rim = directed_rim(surface)
    sides = {
        (a, b)
        for corners in surface.faces.tolist()
        for a, b in zip(corners, corners[1:] + corners[:1], strict=True)
    }
    assert set(map(tuple, rim.tolist())) == {(a, b) for a, b in sides if (b, a) not in sides}
    assert len(rim) == len(surface.odd_edges) > 0


@pytest.fixture(scope="module")
def bunny(data_file: Callable[[str], Path]) -> clvox.VoxelModel:
    mesh = clvox.load(data_file("scans/stanford_bunny_open_69k.ply"))
    return clvox.voxelize(mesh, resolution=256, fill="winding")


def test_the_open_bunny_has_the_volume_of_the_closed_one(
    bunny: clvox.VoxelModel, data_file: Callable[[str], Path]
) -> None:
    closed = clvox.load(data_file("scans/stanford_bunny_closed_70k.ply"))
    volume = float(closed.volume)
    assert abs(bunny.volume / volume - 1) < 0.02
    mesh = clvox.load(data_file("scans/stanford_bunny_open_69k.ply"))
    voted = clvox.voxelize(mesh, grid=bunny.grid, fill="vote")
    assert abs(voted.volume / volume - 1) < 0.02


def test_the_open_bunny_is_a_sum_of_solid_angles(
    bunny: clvox.VoxelModel, data_file: Callable[[str], Path]
) -> None:
    surface = check(clvox.load(data_file("scans/stanford_bunny_open_69k.ply")))
    lattice = Lattice.fit(bunny.grid, surface.bounds)
    voxels = np.random.default_rng(2013).integers(0, bunny.grid.shape, (1000, 3))
    places = voxels << lattice.bits
    winding = winding_numbers(lattice.snap(surface.vertices), surface.faces, places, lattice.step)
    assert np.abs(winding - 0.5).min() > 1e-3
    i, j, k = voxels.T
    np.testing.assert_array_equal(bunny.to_array()[k, j, i], winding > 0.5)


FINE = clvox.Grid((-2.1, -1.7, -1.6), 0.03, (134, 107, 109))
FINE_LEVELS: dict[int, Any] = {1: [FINE.shape], 2: None, 3: [(5, 4, 4), (4, 4, 4), (8, 8, 8)]}
CUP = with_a_hole(ball(1.2, 0.1, 0.2, 0.3), -0.5)


def on_fine(fill: Fill, levels: int, budget: int | None = None) -> clvox.VoxelModel:
    return clvox.voxelize(
        CUP, grid=FINE, levels=FINE_LEVELS[levels], fill=fill, memory_budget=budget
    )


@every_level
@every_fill
def test_a_small_budget_gives_the_same_bits(
    fill: Fill, levels: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    expected = on_fine(fill, levels)
    # What the model takes, rounded up as the pool does, and the least to work in.
    budget = expected.nbytes * 17 // 16 + LEAST_WORK + (70_000 if levels == 3 else 20_000)
    tried = []
    decide = Pieces._decide

    def note(pieces: Pieces, span: Any) -> Any:
        tried.append(span)
        return decide(pieces, span)

    monkeypatch.setattr(Pieces, "_decide", note)
    model = on_fine(fill, levels, budget)
    # Halves, and halves of these; cut for both, or there is nothing to test.
    assert len(tried) > 2
    assert expected.report.peak_nbytes > budget >= model.report.peak_nbytes >= model.nbytes
    record = expected.to_record()
    for name, array in model.to_record().items():
        assert array.tobytes() == record[name].tobytes()
    assert model.report.doubtful_rays == expected.report.doubtful_rays
    assert model.report.first_doubtful_rays == expected.report.first_doubtful_rays


@every_level
@every_fill
def test_what_cannot_fit_is_refused_with_what_would(
    fill: Fill, levels: int, session: Session
) -> None:
    gc.collect()
    before = session.nbytes
    with pytest.raises(clvox.OutOfMemoryError, match=r"need [0-9,]+ bytes of the device") as caught:
        on_fine(fill, levels, 90_000)
    assert session.nbytes == before
    found = re.search(r"A pitch of ([0-9.]+), about [0-9]+ voxels", str(caught.value))
    assert found, caught.value
    pitch = float(found[1])
    shape = -(-np.array(FINE.shape) * 0.03 // pitch)
    grid = clvox.Grid(FINE.origin, pitch, shape)
    sides = {1: [], 2: [(8, 8, 8)], 3: [(4, 4, 4), (8, 8, 8)]}[levels]
    counts = -(-shape // np.prod([(1, 1, 1), *sides], axis=0))
    shapes = [counts.astype(int), *sides]
    model = clvox.voxelize(CUP, grid=grid, levels=shapes, fill=fill, memory_budget=90_000)
    assert model.report.peak_nbytes <= 90_000


@every_fill
@pytest.mark.parametrize("budget", [None, 200_000])
def test_each_failing_allocation_is_out_of_memory(
    session: Session, fill: Fill, budget: int | None
) -> None:
    def build() -> clvox.VoxelModel:
        return clvox.voxelize(CUP, grid=GRID, fill=fill, memory_budget=budget)

    with asked_of(session) as sizes:
        right = build()
    gc.collect()
    before = session.nbytes
    for number in range(1, len(sizes) + 1, max(len(sizes) // 8, 1)):
        with asked_of(session, number), pytest.raises(clvox.OutOfMemoryError, match="no room"):
            build()
        assert session.nbytes == before
    assert build() == right


def test_lists_for_winding_take_what_is_left() -> None:
    """So that less than they would like is enough."""
    opened = with_a_hole(ball(1.2, 0.1, 0.2, 0.3), -0.5)
    grid = clvox.Grid((-2.1, -1.7, -1.6), 0.02, (200, 160, 160))
    model = clvox.voxelize(opened, grid=grid, fill="winding")
    budget = model.report.peak_nbytes * 2 // 3
    again = clvox.voxelize(opened, grid=grid, fill="winding", memory_budget=budget)
    assert again == model
    assert again.report.peak_nbytes <= budget


@every_fill
def test_the_command_line_takes_open_meshes(
    fill: Fill, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "open.ply"
    opened = with_a_hole(ball(1.0, 0, 0, 0), -0.9)
    opened.export(path)
    assert main(["voxelize", str(path), "-r", "24", "--fill", fill, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    model = clvox.voxelize(path, resolution=24, fill=fill)
    assert found["count"] == model.count
    assert found["report"]["doubtful_rays"] == model.report.doubtful_rays
    rays = [list(ray) for ray in model.report.first_doubtful_rays]
    assert found["report"]["first_doubtful_rays"] == rays
    assert bool(rays) == (fill == "vote")
