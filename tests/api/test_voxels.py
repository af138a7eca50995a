"""What a voxel model answers, held against the array of its voxels."""

from __future__ import annotations

import itertools
import tracemalloc
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

import clvox
from clvox import VoxelModel
from clvox.device import Session
from clvox.errors import GridError, MeshError
from clvox.grid import Grid, Shape
from clvox.models import BOUNDARY, INSIDE, OUTSIDE

Voxels = NDArray[np.bool_]

BRICKS = [None, (8, 8, 8), (4, 6, 10), (1, 2, 33)]
"""None for a dense model."""


def levels_for(shape: Any, brick: Shape | None) -> Any:
    if brick is None:
        return [shape]
    return [[-(-n // b) for n, b in zip(shape, brick, strict=True)], brick]


def model_of(array: Voxels, brick: Shape | None = (8, 8, 8), **place: Any) -> VoxelModel:
    """The model of an array, on a grid with no two numbers alike."""
    shape = array.shape[::-1]
    grid = Grid(place.get("origin", (1, -2, 3)), place.get("spacing", (0.5, 0.25, 2)), shape)
    return VoxelModel.from_array(array, grid, levels=levels_for(shape, brick))


def blob(shape: Shape, seed: int = 7) -> Voxels:
    """Random voxels, with regions that are wholly in and wholly out."""
    rng = np.random.default_rng(seed)
    found = rng.random(shape[::-1]) < 0.5
    nz, ny, nx = found.shape
    found[: nz // 2, : ny // 2] = True
    found[:, ny // 2 :, : nx // 2] = False
    return found


@pytest.fixture(scope="module", params=BRICKS, ids=str)
def ring(request: pytest.FixtureRequest) -> VoxelModel:
    """A torus, on each kind of levels; its shape is no multiple of any brick."""
    mesh = trimesh.creation.torus(7.0, 3.0)
    grid = Grid.fit(mesh, pitch=(0.31, 0.23, 0.47))
    return clvox.voxelize(mesh, grid=grid, levels=levels_for(grid.shape, request.param))


@pytest.fixture(scope="module")
def drawn() -> VoxelModel:
    """A model that comes from no mesh."""
    return model_of(blob((21, 18, 13)))


# --- arrays -------------------------------------------------------------------------------------

arrays = hnp.arrays(np.bool_, hnp.array_shapes(min_dims=3, max_dims=3, max_side=40))


@given(array=arrays, brick=st.sampled_from(BRICKS))
def test_an_array_comes_back(array: Voxels, brick: Shape | None) -> None:
    model = model_of(array, brick)
    found = model.to_array()
    assert found.dtype == np.bool_
    assert np.array_equal(found, array)
    assert model.count == array.sum()
    assert model.volume == model.count * 0.25
    assert model == model_of(array, None)


@pytest.mark.parametrize("brick", BRICKS, ids=str)
@pytest.mark.parametrize("shape", [(1, 1, 1), (31, 9, 8), (32, 8, 16), (33, 64, 7), (70, 70, 70)])
def test_arrays_of_many_shapes_come_back(shape: Shape, brick: Shape | None) -> None:
    """Rows of one word, of whole words, and of one bit more; all in, all out, and mixed."""
    for array in (blob(shape), np.ones(shape[::-1], bool), np.zeros(shape[::-1], bool)):
        model = model_of(array, brick)
        assert np.array_equal(model.to_array(), array)
        assert model.count == array.sum()
        cells = 2 if brick else 1
        assert len(model.levels) == cells


def test_what_from_array_takes() -> None:
    """Anything that NumPy takes for true or false, in any layout; and it keeps a copy."""
    array = blob((10, 9, 8))
    grid = Grid((0, 0, 0), 1, (10, 9, 8))
    expected = VoxelModel.from_array(array, grid)
    for other in (array.astype(np.uint8), array.astype(float), np.asfortranarray(array)):
        assert VoxelModel.from_array(other, grid) == expected
    assert VoxelModel.from_array(array.tolist(), grid) == expected
    array[:] = False
    assert expected.count == blob((10, 9, 8)).sum()
    with pytest.raises(GridError, match=r"\(8, 9, 10\) \(z, y, x\), got \(10, 9, 8\)"):
        VoxelModel.from_array(array.T, grid)
    with pytest.raises(GridError, match="got \\(\\)"):
        VoxelModel.from_array(True, grid)
    with pytest.raises(GridError, match="levels say"):
        VoxelModel.from_array(array, grid, levels=[(1, 1, 1), (8, 8, 8)])


def test_the_coarse_level_sums_up_the_fine_one(ring: VoxelModel) -> None:
    """A cell called in or out is uniform; one that the mesh touches is a boundary cell."""
    if len(ring.levels) == 1:
        assert np.array_equal(ring.to_array(level=0), ring.to_array())
        return
    coarse, fine = ring.to_array(level=0), ring.to_array(level=1)
    touched = ring.to_array(rule="touch") & ~ring.to_array(rule="within")
    assert coarse.dtype == np.uint8
    assert coarse.shape == ring.levels[0][::-1]
    assert set(np.unique(coarse)) <= {OUTSIDE, INSIDE, BOUNDARY}
    brick = ring.levels[1][::-1]
    for at in np.ndindex(*coarse.shape):
        part = tuple(slice(i * b, (i + 1) * b) for i, b in zip(at, brick, strict=True))
        if coarse[at] == BOUNDARY:
            continue
        assert (fine[part] == (coarse[at] == INSIDE)).all()
        assert not touched[part].any()


@given(data=st.data())
def test_a_part_is_cut_out_of_the_whole(ring: VoxelModel, data: st.DataObject) -> None:
    """Whatever the bounds, empty ones included, by every rule."""
    ends = [
        sorted(data.draw(st.tuples(st.integers(0, n), st.integers(0, n)))) for n in ring.grid.shape
    ]
    (i0, i1), (j0, j1), (k0, k1) = ends
    rule: Any = data.draw(st.sampled_from(["centre", "touch", "within"]))
    part = ring.to_array(bounds=((i0, j0, k0), (i1, j1, k1)), rule=rule)
    assert part.shape == (k1 - k0, j1 - j0, i1 - i0)
    assert np.array_equal(part, ring.to_array(rule=rule)[k0:k1, j0:j1, i0:i1])
    if len(ring.levels) == 2 and part.size:
        brick = ring.levels[1]
        c = [slice(a // b, -(-z // b)) for (a, z), b in zip(ends, brick, strict=True)]
        cells = ring.to_array(level=0, bounds=((i0, j0, k0), (i1, j1, k1)))
        assert np.array_equal(cells, ring.to_array(level=0)[c[2], c[1], c[0]])


def test_the_rules_enclose_each_other(ring: VoxelModel) -> None:
    """Within, then by the centre, then touched; and the volumes with them."""
    within, centre, touch = (ring.to_array(rule=r) for r in ("within", "centre", "touch"))
    assert (within <= centre).all()
    assert (centre <= touch).all()
    assert 0 < within.sum() < centre.sum() < touch.sum() < touch.size
    voxel = ring.grid.voxel_volume
    assert ring.volume == centre.sum() * voxel
    # The bounds may be wider, by what rounding to the lattice did to the mesh: very little.
    low, high = ring.volume_bounds
    assert low <= within.sum() * voxel
    assert high >= touch.sum() * voxel
    assert (low, high) == pytest.approx((within.sum() * voxel, touch.sum() * voxel), rel=1e-3)


def test_touched_voxels_are_those_with_a_part_of_the_mesh() -> None:
    """Planes at known places: faces on voxel planes touch both neighbours, others one layer."""
    mesh = trimesh.creation.box(bounds=[(2, 2.5, 2.25), (6, 6.5, 6.75)])
    model = clvox.voxelize(mesh, grid=Grid((0, 0, 0), 1, (9, 9, 9)))
    i, j, k = (model.to_array(rule="touch").any(axis=axis) for axis in ((0, 1), (0, 2), (1, 2)))
    assert np.flatnonzero(i).tolist() == [1, 2, 3, 4, 5, 6]
    assert np.flatnonzero(j).tolist() == [2, 3, 4, 5, 6]
    assert np.flatnonzero(k).tolist() == [2, 3, 4, 5, 6]
    within = model.to_array(rule="within")
    assert np.argwhere(within).min(axis=0).tolist() == [3, 3, 3]
    assert np.argwhere(within).max(axis=0).tolist() == [5, 5, 4]


@pytest.mark.parametrize("rule", ["centre", "touch", "within"])
def test_coordinates_are_those_of_the_array(ring: VoxelModel, rule: Any) -> None:
    k, j, i = np.nonzero(ring.to_array(rule=rule))
    found = ring.coordinates(rule=rule)
    assert found.dtype == np.int32
    assert np.array_equal(found, np.stack([i, j, k], axis=1))
    assert ring.contains(ring.grid.centers(found)).all() or rule == "touch"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"level": 2}, "level must be from 0 to 1, got 2"),
        ({"level": -1}, "level must be from 0 to 1, got -1"),
        ({"rule": "center"}, "rule must be one of 'centre', 'touch', 'within', got 'center'"),
        ({"bounds": ((0, 0, 0), (22, 1, 1))}, r"within \(0, 0, 0\) and \(21, 18, 13\)"),
        ({"bounds": ((-1, 0, 0), (1, 1, 1))}, "bounds must lie within"),
        ({"bounds": ((2, 0, 0), (1, 1, 1))}, "bounds must lie within"),
        ({"bounds": (0, 1)}, "two triples of integers"),
        ({"bounds": ((0, 0, 0), (1, 1))}, "two triples of integers"),
        ({"bounds": ((0, 0, 0.5), (1, 1, 1))}, "two triples of integers"),
    ],
)
def test_arrays_that_there_are_not(drawn: VoxelModel, options: Any, words: str) -> None:
    with pytest.raises(GridError, match=words):
        drawn.to_array(**options)


def test_touched_voxels_need_a_mesh(drawn: VoxelModel) -> None:
    """Whatever asks for them says so."""
    asked: list[Callable[[], object]] = [
        lambda: drawn.to_array(rule="touch"),
        lambda: drawn.to_array(rule="within"),
        lambda: drawn.coordinates(rule="touch"),
        lambda: drawn.classify([[0, 0, 0]]),
        lambda: drawn.volume_bounds,
    ]
    for ask in asked:
        with pytest.raises(MeshError, match="not made from a mesh"):
            ask()


# --- points -------------------------------------------------------------------------------------


def test_points_are_answered_by_their_voxels(ring: VoxelModel) -> None:
    """Random points in and around the grid, and the corners and faces of voxels."""
    rng = np.random.default_rng(3)
    low, high = ring.grid.bounds
    loose = rng.uniform(low - 2, high + 2, (5000, 3))
    corners = low + rng.integers(-1, np.array(ring.grid.shape) + 2, (2000, 3)) * ring.grid.spacing
    points = np.concatenate([loose, corners])
    cells = np.floor((points - low) / ring.grid.spacing).astype(int)
    held = ((cells >= 0) & (cells < ring.grid.shape)).all(axis=1)
    i, j, k = cells[held].T
    centre, touch, within = (ring.to_array(rule=r) for r in ("centre", "touch", "within"))
    expected = np.zeros(len(points), bool)
    expected[held] = centre[k, j, i]
    found = ring.contains(points)
    assert found.dtype == np.bool_
    assert np.array_equal(found, expected)
    states = np.zeros(len(points), np.uint8)
    states[held] = np.where((touch & ~within)[k, j, i], BOUNDARY, within[k, j, i])
    classes = ring.classify(points)
    assert classes.dtype == np.uint8
    assert np.array_equal(classes, states)
    assert set(np.unique(classes)) == {OUTSIDE, INSIDE, BOUNDARY}


def test_points_that_are_nowhere(ring: VoxelModel) -> None:
    """Not finite, or further off than an integer holds: outside."""
    inside = ring.grid.centers(ring.coordinates(rule="within")[:1])[0]
    assert ring.contains([inside]).tolist() == [True]
    assert ring.classify([inside]).tolist() == [INSIDE]
    bad = []
    for value, axis in itertools.product([np.nan, np.inf, -np.inf, 1e300, -1e300, 1e12], range(3)):
        bad.append(inside.copy())
        bad[-1][axis] = value
    assert not ring.contains(bad).any()
    assert not ring.classify(bad).any()


def test_no_points_at_all(ring: VoxelModel) -> None:
    assert ring.contains(np.zeros((0, 3))).shape == (0,)
    assert ring.contains(np.zeros((0, 3))).dtype == np.bool_
    assert ring.classify(np.zeros((0, 3))).shape == (0,)


def test_points_may_be_lists_or_any_numbers(drawn: VoxelModel) -> None:
    points = drawn.grid.centers(drawn.coordinates()[:5])
    for given_as in (points.tolist(), points.astype(np.float32), points[:, :], points.T.copy().T):
        assert drawn.contains(given_as).all()
    for wrong in ([0, 0, 0], np.zeros((3, 2)), np.zeros((1, 3, 1)), []):
        with pytest.raises(GridError, match=r"points must have the shape \(n, 3\)"):
            drawn.contains(wrong)


# --- a value ------------------------------------------------------------------------------------


def test_equal_models_are_those_with_the_same_voxels(session: Session) -> None:
    """On whatever levels and from wherever; and equal ones have one hash."""
    array = blob((21, 18, 13))
    models = [model_of(array, brick) for brick in BRICKS]
    for one, other in itertools.combinations(models, 2):
        assert one == other
        assert hash(one) == hash(other)
    assert len(set(models)) == 1
    flipped = array.copy()
    flipped[12, 17, 20] ^= True
    swapped = array.copy()
    on, off = np.argwhere(array)[-1], np.argwhere(~array)[-1]
    swapped[tuple(on)], swapped[tuple(off)] = False, True
    assert models[0] != model_of(flipped)
    assert models[0] != model_of(swapped)
    assert models[0] != model_of(array, spacing=(0.5, 0.25, 2.5))
    assert models[0] != model_of(array, origin=(1, -2, 3.5))
    assert models[0] != model_of(array[:, :, :-1])
    assert models[0] != array.tolist()
    assert (models[0] == 3) is False
    assert models[0].device == str(session.device)


def test_a_model_does_not_change(ring: VoxelModel) -> None:
    """No attribute is set, and what is handed out is a copy, or cannot be written to."""
    for name in ("grid", "report", "levels", "count", "new", "_arrays"):
        with pytest.raises(AttributeError):
            setattr(ring, name, None)
    before = ring.to_array().copy()
    point = ring.grid.centers(ring.coordinates()[:1])
    record = ring.to_record()
    answers = [ring.to_array(), ring.to_array(level=0), ring.coordinates(), ring.contains(point)]
    answers += [ring.classify(point), ring.grid.bounds, *record.values()]
    for answer in answers:
        if answer.flags.writeable:
            answer[...] = 0
    assert np.array_equal(ring.to_array(), before)
    assert ring.count == before.sum()
    assert ring.contains(point).all()


def test_a_model_describes_itself(drawn: VoxelModel) -> None:
    """With its size, its bricks, its memory and where it is."""
    assert repr(drawn).startswith("VoxelModel(21 x 18 x 13 voxels in cells of 8 x 8 x 8, 0.0 MB on")
    assert drawn.device in repr(drawn)
    dense = model_of(blob((64, 64, 512)), None)
    assert repr(dense).startswith("VoxelModel(64 x 64 x 512 voxels, 0.3 MB on ")
    assert dense.nbytes == 64 * 64 * 512 // 8


def test_the_memory_of_a_model_is_that_of_its_arrays(ring: VoxelModel) -> None:
    """Touched voxels are marked at the first question that needs them, and counted then."""
    fresh = clvox.voxelize(trimesh.creation.torus(7.0, 3.0), grid=ring.grid, levels=ring.levels)
    arrays = ("voxels", "boundary", "inside", "rank", "bricks")
    record = fresh.to_record()
    assert fresh.nbytes == sum(record[name].nbytes for name in arrays if name in record)
    before = fresh.nbytes
    assert fresh.volume_bounds == ring.volume_bounds
    assert before < fresh.nbytes <= 2 * before


# --- back to a mesh -----------------------------------------------------------------------------


def test_a_mesh_comes_back(ring: VoxelModel) -> None:
    """Closed, the right side out, of the right topology, in place, and with its voxels."""
    mesh = ring.to_mesh()
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.euler_number == 0
    assert mesh.volume == pytest.approx(ring.volume, rel=0.01)
    low, high = mesh.bounds
    assert (low >= ring.grid.bounds[0]).all()
    assert (high <= ring.grid.bounds[1]).all()
    again = clvox.voxelize(mesh, grid=ring.grid, levels=ring.levels)
    assert np.array_equal(again.to_array(), ring.to_array())


@given(array=hnp.arrays(np.bool_, (7, 9, 11)), brick=st.sampled_from(BRICKS))
def test_any_voxels_come_back_as_a_mesh(array: Voxels, brick: Shape | None) -> None:
    """Voxelized on the same grid, the mesh gives the voxels it was made from."""
    model = model_of(array, brick)
    mesh = model.to_mesh()
    if not array.any():
        assert mesh.faces.shape == (0, 3)
        return
    assert mesh.is_watertight
    assert mesh.volume > 0
    assert clvox.voxelize(mesh, grid=model.grid, levels=model.levels) == model


def test_a_solid_that_the_grid_cuts_is_capped() -> None:
    grid = Grid((0, 0, 0), 1, (6, 5, 4))
    model = clvox.voxelize(trimesh.creation.icosphere(radius=30.0), grid=grid)
    mesh = model.to_mesh()
    assert mesh.is_watertight
    assert np.array_equal(mesh.bounds, grid.bounds)
    assert mesh.euler_number == 2


def test_to_mesh_tells_its_progress() -> None:
    told: list[tuple[int, int]] = []
    mesh = model_of(blob((80, 20, 70))).to_mesh(progress=lambda *now: told.append(now))
    assert len(mesh.faces)
    assert [done for done, _ in told] == list(range(1, told[-1][1] + 1))


def test_to_mesh_needs_a_tenth_of_a_dense_grid(session: Session) -> None:
    """On a grid of 2048: a float32 per voxel, as other marching cubes need, is 34 GB."""
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=150.0)
    grid = Grid((-1024, -1024, -1024), 1, (2048, 2048, 2048))
    model = clvox.voxelize(mesh, grid=grid)
    tracemalloc.start()
    found = model.to_mesh()
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert found.volume == pytest.approx(float(mesh.volume), rel=1e-3)
    assert found.is_watertight
    assert peak < 4 * grid.size / 10
    session.free()
