"""What is inside where bodies overlap, lie within one another, or are open: `fill=`."""

from __future__ import annotations

import operator
from collections.abc import Callable
from functools import reduce
from pathlib import Path

import numpy as np
import pytest
import trimesh

import clvox
from clvox.models.construct import Fill
from clvox.models.levels import Levels

LEVELS: dict[int, Levels | None] = {
    1: [(45, 29, 27)],
    2: None,
    3: [(4, 3, 3), (4, 4, 4), (3, 3, 3)],
}

every_level = pytest.mark.parametrize("levels", LEVELS)


def ball(radius: float, *center: float) -> trimesh.Trimesh:
    made: trimesh.Trimesh = trimesh.creation.icosphere(subdivisions=3, radius=radius)
    made.apply_translation(center)
    return made


def box(low: tuple[float, ...], high: tuple[float, ...]) -> trimesh.Trimesh:
    made: trimesh.Trimesh = trimesh.creation.box(bounds=[low, high])
    return made


GRID = clvox.Grid((-2.1, -1.7, -1.6), 0.13, (45, 29, 27))
PAIRS = {
    "balls": (ball(1.0, 0, 0, 0), ball(1.1, 0.9, 0.2, 0.1)),
    "boxes": (box((0, 0, 0), (1, 1, 1)), box((0.5, -0.5, 0.25), (2.5, 0.5, 1.5))),
    "nested": (ball(1.5, 0, 0, 0), box((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5))),
    "apart": (ball(0.7, -1, 0, 0), ball(0.8, 2, 0, 0)),
    "side by side": (box((0, 0, 0), (1, 1, 1)), box((1, 0, 0), (2, 1, 1))),
    "beyond the grid": (ball(2.5, 0, 0, 0), ball(1.0, 2.8, 0, 0)),
}


def voxelize(mesh: trimesh.Trimesh, fill: Fill, *, levels: int) -> clvox.VoxelModel:
    # One lattice, so that models may be combined.
    return clvox.voxelize(mesh, grid=GRID, levels=LEVELS[levels], fill=fill, lattice_bits=10)


@every_level
@pytest.mark.parametrize("pair", PAIRS)
def test_overlapping_bodies_are_united(pair: str, levels: int) -> None:
    one, other = PAIRS[pair]
    for both in (one + other, other + one):
        first, second = (voxelize(mesh, "parity", levels=levels) for mesh in (one, other))
        assert voxelize(both, "nonzero", levels=levels) == first | second
        assert voxelize(both, "positive", levels=levels) == first | second
        assert voxelize(both, "parity", levels=levels) == first ^ second


@every_level
def test_a_body_turned_inwards_is_a_void(levels: int) -> None:
    outer, inner = PAIRS["nested"]
    void = inner.copy()
    void.invert()
    hollow = outer + void
    expected = voxelize(outer, "parity", levels=levels) - voxelize(inner, "parity", levels=levels)
    for fill in ("parity", "nonzero", "positive"):
        assert voxelize(hollow, fill, levels=levels) == expected


@every_level
def test_one_body_is_the_same_by_every_rule(levels: int) -> None:
    mesh = PAIRS["balls"][0]
    models = [voxelize(mesh, fill, levels=levels) for fill in ("parity", "nonzero", "positive")]
    assert models[0] == models[1] == models[2]
    assert [model.report.fill for model in models] == ["parity", "nonzero", "positive"]


def test_a_mesh_inside_out_is_solid_by_nonzero_and_nothing_by_positive() -> None:
    mesh = PAIRS["balls"][0].copy()
    mesh.invert()
    turned = voxelize(mesh, "nonzero", levels=2)
    assert turned == voxelize(PAIRS["balls"][0], "parity", levels=2)
    nothing = voxelize(mesh, "positive", levels=2)
    assert nothing.count == 0
    assert any("inside out" in warning for warning in nothing.report.warnings)


@every_level
def test_surface_takes_the_touched_voxels_of_any_mesh(levels: int) -> None:
    closed = PAIRS["balls"][0]
    parity = voxelize(closed, "parity", levels=levels)
    shell = voxelize(closed, "surface", levels=levels)
    touched = parity.to_array(rule="touch") & ~parity.to_array(rule="within")
    np.testing.assert_array_equal(shell.to_array(), touched)
    low, high = shell.volume_bounds
    assert low == 0.0
    # A little more, for what snapping may have moved beyond the touched voxels.
    assert shell.volume <= high <= 1.01 * shell.volume

    opened = trimesh.Trimesh(closed.vertices, closed.faces[closed.triangles_center[:, 2] < 0.3])
    model = voxelize(opened, "surface", levels=levels)
    assert 0 < model.count < shell.count
    assert not (model - shell).count
    assert any("open" in warning for warning in model.report.warnings)


def test_an_open_mesh_is_no_solid() -> None:
    closed = PAIRS["balls"][0]
    opened = trimesh.Trimesh(closed.vertices, closed.faces[1:])
    for fill in ("parity", "nonzero", "positive"):
        with pytest.raises(clvox.NotClosedError):
            voxelize(opened, fill, levels=2)


def test_winding_needs_an_oriented_mesh() -> None:
    faces = PAIRS["boxes"][0].faces.copy()
    faces[0] = faces[0][::-1]
    mixed = trimesh.Trimesh(PAIRS["boxes"][0].vertices, faces, process=False)
    assert voxelize(mixed, "parity", levels=2) == voxelize(PAIRS["boxes"][0], "parity", levels=2)
    for fill in ("nonzero", "positive"):
        with pytest.raises(clvox.NotOrientedError, match="used more often one way"):
            voxelize(mixed, fill, levels=2)


def test_an_unknown_fill_is_refused_with_the_known_ones() -> None:
    known = "'parity', 'nonzero', 'positive', 'vote', 'winding', 'surface', got 'odd'"
    with pytest.raises(clvox.GridError, match=known):
        clvox.voxelize(PAIRS["balls"][0], grid=GRID, fill="odd")  # type: ignore[arg-type]


@pytest.mark.parametrize("fill", ["parity", "nonzero", "vote", "winding", "surface"])
def test_progress_comes_to_its_end(fill: Fill) -> None:
    mesh = PAIRS["balls"][0] + PAIRS["balls"][1]
    told: list[tuple[int, int]] = []
    clvox.voxelize(
        mesh, grid=GRID, fill=fill, progress=lambda done, total: told.append((done, total))
    )
    assert told[-1] == (2 * len(mesh.faces), 2 * len(mesh.faces))
    assert told == sorted(told)


@pytest.mark.parametrize(
    ("name", "volume"),
    [
        ("awkward/grid_aligned_boxes.ply", 1536.0),
        ("awkward/needle_box_1000_to_1.stl", 1000.0),
        ("awkward/two_boxes_touching_at_vertex.ply", 128.0),
        ("awkward/binary_stl_header_says_solid.stl", 105.0),
        # Voids are turned inwards here, so that signed volumes add up to what is solid.
        ("awkward/hollow_sphere_void.stl", 2039.712627),
        ("awkward/three_nested_spheres.stl", 2562.179996),
    ],
)
@pytest.mark.parametrize("fill", ["parity", "nonzero", "positive"])
def test_known_volumes_lie_between_the_bounds(
    data_file: Callable[[str], Path], fill: Fill, name: str, volume: float
) -> None:
    model = clvox.voxelize(clvox.load(data_file(name)), resolution=100, fill=fill)
    low, high = model.volume_bounds
    assert low <= volume <= high


@pytest.mark.parametrize(
    "name", ["overlapping_boxes_45_bodies.obj", "featuretype_plus_scaled_copy_overlap.stl"]
)
def test_files_of_overlapping_bodies_are_united(
    data_file: Callable[[str], Path], name: str
) -> None:
    mesh = clvox.load(data_file(f"awkward/{name}"))
    mesh.merge_vertices()
    grid = clvox.Grid.fit(mesh, resolution=96)
    bodies = mesh.split(only_watertight=False)
    assert len(bodies) > 1
    alone = [clvox.voxelize(body, grid=grid, lattice_bits=9) for body in bodies]
    united = reduce(operator.or_, alone)
    assert clvox.voxelize(mesh, grid=grid, lattice_bits=9, fill="nonzero") == united
