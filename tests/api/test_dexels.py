"""What must be true of dexel models and triple dexel models, whatever their inside."""

from __future__ import annotations

import operator
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

import clvox
from clvox import DexelModel, FormatError, Grid, GridError, TripleDexelModel, VoxelModel
from clvox.grid import Axis
from clvox.models import archive
from clvox.models.dexels import MOST_MESHES
from clvox.models.levels import Levels
from clvox.models.memory import LEAST_WORK
from clvox.ops.lists import CrossingLists
from clvox.reference.fill import FillRule
from tests.strategies import SOLIDS, adversarial_meshes

Record = dict[str, NDArray[Any]]

AXES: tuple[Axis, ...] = get_args(Axis)
GRID = Grid((-2.1, -1.7, -1.6), (0.13, 0.11, 0.12), (41, 33, 29))

OPERATORS: list[Callable[[Any, Any], Any]] = [
    operator.or_,
    operator.and_,
    operator.xor,
    operator.sub,
    lambda a, b: a & ~b,
]

every_axis = pytest.mark.parametrize("axis", AXES)


def ball(radius: float, *center: float) -> trimesh.Trimesh:
    made: trimesh.Trimesh = trimesh.creation.icosphere(subdivisions=2, radius=radius)
    made.apply_translation(center)
    return made


def box(low: tuple[float, ...], high: tuple[float, ...]) -> trimesh.Trimesh:
    made: trimesh.Trimesh = trimesh.creation.box(bounds=[low, high])
    return made


PARTS = [
    ball(1.2, 0, 0, 0),
    ball(0.9, 0.6, 0.3, 0.2),
    box((-1, -1, -1), (0.5, 0.7, 0.6)),
    # Faces on voxel centres and on the grid's box, and beyond it.
    box((-2.1 + 6.5 * 0.13, -1.7 + 3.5 * 0.11, -1.6), (0.0, 0.0, -1.6 + 12.5 * 0.12)),
    box((-3, 0.1, -0.2), (3, 0.6, 3)),
    trimesh.creation.torus(1.0, 0.4, major_sections=24, minor_sections=12),
]
BOTH = PARTS[0] + PARTS[2]


def dexelize(
    mesh: trimesh.Trimesh, axis: Axis, fill: FillRule = "parity", grid: Grid = GRID
) -> DexelModel:
    return clvox.dexelize(mesh, grid=grid, axis=axis, fill=fill, lattice_bits=12)


def triple(mesh: trimesh.Trimesh) -> TripleDexelModel:
    return clvox.dexelize(mesh, grid=GRID, axis="xyz", lattice_bits=12)


def voxelize(mesh: Any, fill: FillRule = "parity", levels: Levels | None = None) -> VoxelModel:
    return clvox.voxelize(mesh, grid=GRID, fill=fill, lattice_bits=12, levels=levels)


@every_axis
@pytest.mark.parametrize("fill", get_args(FillRule))
def test_voxels_are_those_of_voxelize(axis: Axis, fill: FillRule) -> None:
    for mesh in (*PARTS, BOTH, BOTH.copy() + PARTS[4]):
        model = dexelize(mesh, axis, fill)
        assert model.to_voxels() == voxelize(mesh, fill)


@pytest.mark.parametrize(
    "levels", [[GRID.shape], [(6, 11, 8), (7, 3, 4)], [(3, 3, 4), (4, 4, 2), (4, 3, 4)]]
)
def test_voxels_come_on_any_levels(levels: Levels) -> None:
    model = dexelize(PARTS[5], "z").to_voxels(levels=levels)
    assert np.array_equal(model.levels, np.array(levels))
    assert model == voxelize(PARTS[5], levels=levels)


def test_degenerate_meshes_have_the_voxels_of_voxelize() -> None:
    shape, bits = (9, 8, 7), 8
    grid = Grid((0, 0, 0), 1, shape)
    for vertices, faces in adversarial_meshes(23, 30, bits, shape, SOLIDS):
        mesh = vertices / 2.0**bits + 0.5, faces
        try:
            model = clvox.dexelize(mesh, grid=grid, axis="xyz", lattice_bits=bits)
        except clvox.MeshError:
            # Without extent, or nothing but triangles back to back.
            continue
        expected = clvox.voxelize(mesh, grid=grid, lattice_bits=bits)
        for bundle in model.bundles:
            assert bundle.to_voxels() == expected


@every_axis
@pytest.mark.parametrize("seed", range(2))
def test_random_trees_of_fifty_operations_are_those_of_voxels(axis: Axis, seed: int) -> None:
    rng = np.random.default_rng(seed)
    dexels = [dexelize(mesh, axis) for mesh in PARTS]
    voxels = [voxelize(mesh) for mesh in PARTS]
    for _ in range(50):
        a, b = rng.integers(0, len(dexels), 2)
        operation = OPERATORS[rng.integers(0, len(OPERATORS))]
        at = rng.integers(0, len(dexels))
        dexels[at], voxels[at] = operation(dexels[a], dexels[b]), operation(voxels[a], voxels[b])
        if not rng.integers(0, 5):
            dexels[at], voxels[at] = ~dexels[at], ~voxels[at]
        if voxels[at].count in (0, GRID.size):
            dexels[at], voxels[at] = dexelize(PARTS[at], axis), voxelize(PARTS[at])
        assert dexels[at].to_voxels() == voxels[at]


@every_axis
def test_laws(axis: Axis) -> None:
    a, b = dexelize(PARTS[0], axis), dexelize(PARTS[2], axis)
    nothing, everything = a - a, a | ~a
    assert nothing.volume == 0
    assert not len(nothing.depths)
    assert everything.volume == pytest.approx(GRID.size * GRID.voxel_volume, rel=1e-14)
    assert ~~a == a
    assert ~(a | b) == ~a & ~b
    assert a - b == a & ~b
    assert a ^ b == (a | b) - (a & b)
    assert (a ^ b) ^ b == a
    assert a != b
    assert (a | b).volume + (a & b).volume == pytest.approx(a.volume + b.volume, rel=1e-13)


@every_axis
def test_the_winding_rule_unites(axis: Axis) -> None:
    one, other = PARTS[0], PARTS[2]
    united = dexelize(one, axis) | dexelize(other, axis)
    for both in (one + other, other + one):
        assert dexelize(both, axis, "nonzero") == united
        assert dexelize(both, axis, "positive") == united
        assert dexelize(both, axis) == dexelize(one, axis) ^ dexelize(other, axis)


@every_axis
def test_boxes_that_touch_merge(axis: Axis) -> None:
    parts = [box((0, 0, 0), (1, 1, 1)), box((1, 0, 0), (2, 1, 1)), box((0, 1, 0), (2, 2, 1))]
    parts.append(box((0, 0, 1), (2, 2, 2)))
    grid = Grid((-0.25, -0.25, -0.25), 0.25, (10, 10, 10))
    whole = dexelize(box((0, 0, 0), (2, 2, 2)), axis, grid=grid)
    for order in ([0, 1, 2, 3], [3, 1, 0, 2]):
        models = [dexelize(parts[at], axis, grid=grid) for at in order]
        united = models[0] | models[1] | models[2] | models[3]
        assert united == whole
        mesh = parts[order[0]] + parts[order[1]] + parts[order[2]] + parts[order[3]]
        assert dexelize(mesh, axis, grid=grid) == whole


def test_ends_keep_their_triangle_and_their_mesh() -> None:
    one, other = PARTS[2], PARTS[5]
    result = dexelize(one, "z") - dexelize(other, "z")
    ends = result.offsets.astype(np.int64)
    counts = ends[1:] - ends[:-1]
    rays = np.repeat(np.arange(len(counts)), counts)
    v, u = np.divmod(rays, GRID.shape[0])
    points = GRID.centers(np.stack([u, v, 0 * u], axis=1))
    points[:, 2] = result.depths
    assert set(result.operands.tolist()) == {0, 1}
    assert (result.signs == 1 - 2 * (np.arange(len(rays)) % 2)).all()
    for number, mesh in enumerate((one, other)):
        own = result.operands == number
        triangles = mesh.triangles[result.triangles[own]]
        closest: Any = trimesh.triangles.closest_point
        near = closest(triangles, points[own])
        assert np.abs(near - points[own]).max() < 1e-3
        facing = mesh.face_normals[result.triangles[own], 2]
        # Of what is taken away, a ray goes in where the mesh ends.
        assert (facing * result.signs[own] * (1 if number else -1) > 0).all()
    caps = ~result
    assert (caps.operands == -1).any()
    assert ((caps.operands == -1) == (caps.triangles == -1)).all()


def test_triangles_are_numbered_as_the_caller_does() -> None:
    mesh = PARTS[2]
    faces = np.concatenate([[[0, 0, 1]], mesh.faces[:5], mesh.faces[:1], mesh.faces[5:]])
    plain = dexelize(mesh, "y").triangles
    found = clvox.dexelize((mesh.vertices, faces), grid=GRID, axis="y", lattice_bits=12).triangles
    assert found.tolist() == np.where(plain < 5, plain + 1, plain + 2).tolist()


def test_a_thousand_operations_keep_working_and_take_no_more_memory() -> None:
    tools = [dexelize(ball(0.3, *place), "z") for place in np.eye(3)]
    model = dexelize(PARTS[0], "z")
    session = model._session
    expected = model - tools[0] | tools[1]
    blocks, peaks = 0, []
    for step in range(500):
        held = session.nbytes
        with session.job(1 << 30) as job:
            model = model - tools[0] | tools[1]
        peaks.append(held + job.peak_nbytes)
        if step == 20:
            blocks = session.blocks
    assert model == expected
    assert max(peaks[10:]) == max(peaks[10:20])
    assert session.blocks <= blocks + 4
    assert len(model._sources.meshes) == 3


def test_meshes_of_which_no_end_is_left_are_forgotten() -> None:
    model = dexelize(PARTS[0], "z")
    for step in range(5 * MOST_MESHES):
        tool = ball(0.3, 0, 0, 0.01 * step)
        model |= dexelize(tool, "z")
        assert len(model._sources.meshes) <= MOST_MESHES + 1
    assert model == dexelize(PARTS[0], "z")
    model = model - dexelize(PARTS[2], "z")
    assert set(model.operands.tolist()) <= {0, len(model._sources.meshes) - 1}


@every_axis
def test_intervals_are_the_solid(axis: Axis) -> None:
    model = dexelize(BOTH, axis, "nonzero")
    offsets, enter, leave = model.intervals()
    assert len(offsets) == np.prod(model.rays_shape) + 1
    assert int(offsets[-1]) == len(enter) == len(leave)
    assert (enter < leave).all()
    lengths = np.add.reduceat(np.append(leave - enter, 0), offsets[:-1].astype(np.int64))
    lengths[offsets[1:] == offsets[:-1]] = 0
    np.testing.assert_allclose(model.thickness(), lengths.reshape(model.rays_shape), atol=1e-9)
    section = GRID.voxel_volume / GRID.spacing[AXES.index(axis)]
    assert model.volume == pytest.approx(lengths.sum() * section, rel=1e-12)
    assert model.thickness().dtype == np.float64


@every_axis
def test_measures_are_those_of_the_solid(axis: Axis) -> None:
    fine = Grid((-2.0, -1.5, -1.5), (0.041, 0.037, 0.043), (90, 85, 80))
    for mesh in (PARTS[1], PARTS[5]):
        model = dexelize(mesh, axis, grid=fine)
        assert model.volume == pytest.approx(mesh.volume, rel=2e-3)
        np.testing.assert_allclose(model.center_mass, mesh.center_mass, atol=2e-3)
        np.testing.assert_allclose(model.moment_inertia, mesh.moment_inertia, atol=6e-3)


@every_axis
def test_measures_of_a_box_along_the_grid_are_exact(axis: Axis) -> None:
    grid = Grid((0, 0, 0), (0.5, 0.25, 1), (8, 8, 8))
    # Across it ends between two rays, along it anywhere on the lattice.
    ends = {"x": ((0.3125, 0.5, 2), (3.40625, 1.5, 7)), "y": ((1, 0.203125, 2), (3, 1.5625, 7))}
    low, high = ends.get(axis, ((1, 0.5, 1.1875), (3, 1.5, 7.40625)))
    mesh = box(low, high)
    model = dexelize(mesh, axis, grid=grid)
    assert model.volume == pytest.approx(mesh.volume, rel=1e-15)
    np.testing.assert_allclose(model.center_mass, mesh.center_mass, rtol=1e-14)
    np.testing.assert_allclose(model.moment_inertia, mesh.moment_inertia, rtol=1e-12, atol=1e-12)
    nothing = model - model
    assert np.isnan(nothing.center_mass).all()
    assert not nothing.moment_inertia.any()


@every_axis
@pytest.mark.parametrize("cells", [1, 4, 100])
def test_fractions_add_up_to_the_volume(axis: Axis, cells: int) -> None:
    model = dexelize(PARTS[5], axis)
    fractions = model.column_fractions(cells=cells)
    along = 2 - AXES.index(axis)
    count = GRID.array_shape[along]
    side = min(cells, count)
    held = np.minimum(side, count - np.arange(0, count, side))
    voxels = np.moveaxis(fractions, along, 2) @ held
    assert voxels.sum() * GRID.voxel_volume == pytest.approx(model.volume, rel=1e-5)
    assert 0 <= fractions.min() < fractions.max() <= 1
    if cells == 1:
        inside = model.to_voxels().to_array()
        # Half a voxel on either side of its sample.
        assert (fractions[inside] > 0).all()
        full = fractions == 1
        assert inside[full].all()
        assert 0 < full.sum() < inside.sum()


@every_axis
def test_points_are_inside_where_their_ray_is(axis: Axis) -> None:
    model = dexelize(PARTS[5], axis)
    rng = np.random.default_rng(7)
    low, high = GRID.bounds
    points = rng.uniform(low - 0.2, high + 0.2, (2000, 3))
    points[:3] = np.nan, np.inf, -np.inf
    number = AXES.index(axis)
    voxels = GRID.indices(points)
    offsets, enter, leave = model.intervals()
    expected = []
    for point, voxel in zip(points, voxels.tolist(), strict=True):
        first, second = (at for a, at in enumerate(voxel) if a != number)
        ray = second * model.rays_shape[1] + first
        span = slice(int(offsets[ray]), int(offsets[ray + 1]))
        along = point[number]
        inside = bool(((enter[span] <= along) & (along < leave[span])).any())
        expected.append(voxel[0] >= 0 and inside)
    assert model.contains(points).tolist() == expected
    assert any(expected)
    centers = GRID.centers(np.argwhere(np.ones(GRID.shape)))
    assert (model.contains(centers) == voxelize(PARTS[5]).contains(centers)).all()


@every_axis
def test_dexels_come_from_voxels(axis: Axis) -> None:
    voxels = voxelize(BOTH)
    model = DexelModel.from_voxels(voxels, axis=axis, lattice_bits=12)
    assert model.to_voxels() == voxels
    assert model.volume == pytest.approx(voxels.volume, rel=1e-14)
    np.testing.assert_allclose(model.center_mass, voxels.center_mass, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(model.moment_inertia, voxels.moment_inertia, rtol=1e-10, atol=1e-13)
    cut = model - dexelize(PARTS[1], axis)
    assert cut.to_voxels() == voxels - voxelize(PARTS[1])


@every_axis
def test_a_mesh_of_one_bundle_is_exact_along_its_rays(axis: Axis) -> None:
    radius = 1.1
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=radius)
    found = dexelize(mesh, axis).to_mesh()
    assert found.is_watertight
    assert found.is_winding_consistent
    number = AXES.index(axis)
    places = (found.vertices - GRID.origin) / GRID.spacing * 2
    others = [a for a in range(3) if a != number]
    on_ray = (np.rint(places[:, others]).astype(int) % 2 == 1).all(axis=1)
    distance = np.abs(np.linalg.norm(found.vertices, axis=1) - radius)
    assert on_ray.sum() > len(on_ray) / 4
    assert distance[on_ray].max() < 4e-3
    assert distance[~on_ray].max() > 0.03
    assert not len((dexelize(mesh, axis) - dexelize(mesh, axis)).to_mesh().faces)


def test_a_mesh_of_three_bundles_is_exact() -> None:
    radius = 1.1
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=radius)
    model = triple(mesh)
    found = model.to_mesh()
    assert found.is_watertight
    assert found.is_winding_consistent
    away = np.linalg.norm(found.vertices, axis=1)
    assert np.abs(away - radius).max() < 4e-3
    facing = np.einsum("ij,ij->i", found.vertex_normals, found.vertices) / away
    assert facing.min() > 0.99
    hollow = ~model & triple(PARTS[2])
    found = hollow.to_mesh()
    assert found.is_watertight
    # What finer grids come to; edges of the box are cut off.
    assert found.volume == pytest.approx(0.70, abs=0.05)


def test_where_the_box_cuts_the_solid_the_mesh_is_capped() -> None:
    model = triple(PARTS[4])
    found = model.to_mesh()
    assert found.is_watertight
    low, high = GRID.bounds
    assert found.bounds[0][0] == pytest.approx(low[0])
    assert found.bounds[1][2] == pytest.approx(high[2])
    # Where the solid ends by itself.
    assert found.bounds[1][0] == pytest.approx(3.0, abs=1e-4)


def test_bundles_agree_at_every_centre() -> None:
    for mesh in PARTS:
        model = triple(mesh)
        assert model.x.to_voxels() == model.y.to_voxels() == model.z.to_voxels()
        assert model.to_voxels() == voxelize(mesh)
        assert model.x == dexelize(mesh, "x")


def test_triples_combine() -> None:
    a, b = triple(PARTS[0]), triple(PARTS[2])
    one, other = voxelize(PARTS[0]), voxelize(PARTS[2])
    for operation in OPERATORS:
        found = operation(a, b)
        assert {model.to_voxels() == operation(one, other) for model in found.bundles} == {True}
    assert ~~a == a
    assert (a - a).volume == 0
    assert a.volume == pytest.approx(PARTS[0].volume, rel=0.02)
    np.testing.assert_allclose(b.center_mass, PARTS[2].center_mass, atol=0.05)
    np.testing.assert_allclose(a.moment_inertia, PARTS[0].moment_inertia, rtol=0.05, atol=0.05)
    points = np.random.default_rng(1).uniform(-1, 1, (500, 3))
    votes = np.sum([model.contains(points) for model in a.bundles], axis=0)
    assert (a.contains(points) == (votes > 1)).all()
    with pytest.raises(TypeError):
        a | a.x  # type: ignore[operator]


def test_the_report_tells_of_the_rays() -> None:
    grid = Grid((0, 0, 0), 1, (4, 3, 5))
    slab = box((0, 0, 1), (4, 3, 4))
    # Half of one more voxel, on the ray (i, j) = (2, 1).
    thin = box((2, 1, 4.25), (3, 2, 4.75))
    model = clvox.dexelize(slab + thin, grid=grid, axis="z")
    report = model.report
    assert report.crossings == len(model.depths) == 2 * 12 + 2
    assert (report.deepest, report.deepest_ray) == (4, (1, 2))
    assert (report.thinnest, report.thinnest_ray) == (0.5, (1, 2))
    assert (report.odd_rays, report.odd_triangles) == (0, ())
    assert report.triangles == 24
    assert set(report.seconds) == {"snap", "upload", "list"}
    assert report.peak_nbytes > 0
    assert (model - model).report.thinnest_ray is None
    assert "4 x 3 rays along z, 26 crossings" in repr(model)
    assert "4 x 3 x 5" in repr(clvox.dexelize(slab, grid=grid, axis="xyz"))


def test_odd_rays_are_told_with_their_triangles() -> None:
    """No mesh that is let in has one, so a model is made that does."""
    model = dexelize(PARTS[2], "z")
    offsets = model.offsets.astype(np.int64)
    first = int(offsets[offsets < offsets[-1]].max())
    offsets = np.minimum(offsets, offsets[-1] - 1).astype(np.uint64)
    broken = CrossingLists(
        model._session.upload(offsets),
        model._session.upload(model.fixed_depths[:-1].copy()),
        model._session.upload(model._crossings.side.get()[:-1].copy()),
        model.fraction_bits,
    )
    report = DexelModel(
        model._session, model.grid, "z", "parity", 12, broken, model._sources, model._built
    ).report
    assert report.odd_rays == 1
    assert report.odd_triangles == tuple(sorted(set(model.triangles[first:-1].tolist())))


def test_a_budget_is_kept_or_refused() -> None:
    model = dexelize(PARTS[0], "x")
    held = model.nbytes
    assert held < model.report.peak_nbytes
    options: Any = {"grid": GRID, "axis": "x", "lattice_bits": 12}
    assert clvox.dexelize(PARTS[0], **options, memory_budget=2 * LEAST_WORK) == model
    with pytest.raises(clvox.OutOfMemoryError):
        clvox.dexelize(PARTS[0], **options, memory_budget=LEAST_WORK)


def test_work_may_be_ended_early() -> None:
    def tell(*_: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        clvox.dexelize(PARTS[0], grid=GRID, progress=tell)
    assert dexelize(PARTS[0], "z") == dexelize(PARTS[0], "z")


def test_arrays_are_read_only() -> None:
    model = dexelize(PARTS[0], "x")
    for name in ("offsets", "depths", "fixed_depths", "triangles", "operands", "signs"):
        array = getattr(model, name)
        assert len(array)
        assert not array.flags.writeable


def test_progress_is_told() -> None:
    for axis, parts in (("x", 1), ("xyz", 3)):
        seen: list[tuple[int, int]] = []
        told: Any = {"axis": axis, "progress": lambda *work, seen=seen: seen.append(work)}
        clvox.dexelize(PARTS[0], resolution=20, **told)
        assert seen[-1][0] == seen[-1][1] == parts * len(PARTS[0].faces)


# Files


@pytest.fixture(params=["one mesh", "made of others", "triple"])
def model(request: pytest.FixtureRequest) -> DexelModel | TripleDexelModel:
    if request.param == "triple":
        return triple(PARTS[5])
    one = dexelize(PARTS[5], "y")
    return one if request.param == "one mesh" else ~one | dexelize(PARTS[2], "y")


def test_models_come_back_from_files_and_pickles(
    model: DexelModel | TripleDexelModel, tmp_path: Path
) -> None:
    model.save(tmp_path / "model.npz")
    for found in (clvox.open(tmp_path / "model.npz"), pickle.loads(pickle.dumps(model))):  # noqa: S301
        assert type(found) is type(model)
        assert found == model
        mine, theirs = model.to_record(), found.to_record()
        assert list(mine) == list(theirs)
        for name in mine:
            np.testing.assert_array_equal(mine[name], theirs[name])
    if isinstance(model, DexelModel):
        again = pickle.loads(pickle.dumps(model))  # noqa: S301
        assert again.report.triangles == model.report.triangles
        assert again.triangles.tolist() == model.triangles.tolist()


DAMAGE: dict[str, Callable[[Record], object]] = {
    "arrays are": lambda r: r.pop("side"),
    "layout version": lambda r: r.update(version=np.array(2)),
    "grid makes no sense": lambda r: r.update(spacing=np.zeros(3)),
    "axis must be": lambda r: r.update(axis=np.array(3)),
    "rule must be": lambda r: r.update(rule=np.array(9)),
    "lattice_bits must be": lambda r: r.update(lattice_bits=np.array(15)),
    "fraction_bits must be": lambda r: r.update(fraction_bits=np.array(17)),
    "array offsets must be": lambda r: r.update(offsets=r["offsets"][1:]),
    "array depth must be": lambda r: r.update(depth=r["depth"].astype(np.int64)),
    "array side must be": lambda r: r.update(side=r["side"][1:]),
    "array meshes must be": lambda r: r.update(meshes=r["meshes"].astype(np.int32)),
    "offsets must rise": lambda r: r.update(offsets=r["offsets"][::-1].copy()),
    "meshes must have": lambda r: r.update(meshes=-r["meshes"]),
    "triangles that its meshes": lambda r: r.update(meshes=r["meshes"] // 2),
    "depths must rise": lambda r: r.update(depth=np.zeros_like(r["depth"])),
    "in and out by turns": lambda r: r.update(side=r["side"] ^ np.uint32(1)),
    "lie in its grid": lambda r: r.update(depth=r["depth"] + np.int32(1 << 22)),
}


@pytest.mark.parametrize("words", DAMAGE)
def test_a_damaged_file_is_refused(words: str, tmp_path: Path) -> None:
    record = dict(((dexelize(PARTS[5], "y")) | dexelize(PARTS[2], "y")).to_record())
    DAMAGE[words](record)
    path = tmp_path / "model.npz"
    archive.write(path, record)
    with pytest.raises(FormatError, match=words):
        clvox.open(path)


def test_a_damaged_triple_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "model.npz"
    for words, change in {
        "arrays are": {"depth": np.zeros(1)},
        "along x, y and z": {"y_axis": np.array(0)},
        "must have one lattice": {"y_lattice_bits": np.array(11)},
    }.items():
        cube = Grid((-2, -2, -2), 0.2, (20, 20, 20))
        record = clvox.dexelize(PARTS[0], grid=cube, axis="xyz").to_record()
        archive.write(path, record | change)
        with pytest.raises(FormatError, match=words):
            clvox.open(path)


def test_a_file_of_bundles_that_disagree_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "model.npz"
    for fill in get_args(FillRule):
        made = clvox.dexelize(PARTS[0], grid=GRID, axis="xyz", lattice_bits=12, fill=fill)
        for other in (made.z - made.z, dexelize(PARTS[2], "z"), ~made.z):
            made.save(path)
            assert clvox.open(path) == made
            TripleDexelModel(made.x, made.y, other).save(path)
            with pytest.raises(FormatError, match="bundles disagree on which voxel centres"):
                clvox.open(path)


def test_the_lattice_comes_back_from_files_and_is_kept(tmp_path: Path) -> None:
    model = clvox.dexelize(PARTS[0], grid=GRID, lattice_bits=11)
    model.save(tmp_path / "model.npz")
    voxels = clvox.voxelize(PARTS[0], grid=GRID, lattice_bits=11)
    found = [
        clvox.open(tmp_path / "model.npz"),
        pickle.loads(pickle.dumps(model)),  # noqa: S301
        ~model,
        model - model,
        DexelModel.from_voxels(voxels),
        model.moved(np.eye(4)),
    ]
    for one in found:
        assert one.lattice_bits == 11
        assert (one | model).lattice_bits == 11


# What is refused


def test_bundles_that_do_not_belong_together_are_refused() -> None:
    t = triple(PARTS[0])
    with pytest.raises(GridError, match="along x, y and z, in this order, got z, z, z"):
        TripleDexelModel(t.z, t.z, t.z)
    with pytest.raises(GridError, match="must be on one grid"):
        TripleDexelModel(t.x, t.y, clvox.dexelize(PARTS[0], resolution=10))
    with pytest.raises(GridError, match=r"on one lattice, got lattice_bits of \[12, 12, 14"):
        TripleDexelModel(t.x, t.y, clvox.dexelize(PARTS[0], grid=GRID, lattice_bits=14))
    with pytest.raises(GridError, match="must be three DexelModels"):
        TripleDexelModel(t.x, t.y, t)  # type: ignore[arg-type]


def test_bundles_of_other_solids_have_no_mesh() -> None:
    t, other = triple(PARTS[0]), triple(PARTS[2])
    for bundles in (
        (t.x, t.y, t.z - t.z),
        (t.x - t.x, t.y, t.z),
        (t.x, t.y, other.z),
        (other.x, t.y, t.z),
    ):
        with pytest.raises(GridError, match="is of another solid than the others"):
            TripleDexelModel(*bundles).to_mesh()


def test_models_on_other_rays_are_not_combined() -> None:
    model = dexelize(PARTS[0], "z")
    with pytest.raises(GridError, match=r"different rays: along z .* along x"):
        model | dexelize(PARTS[0], "x")
    other = clvox.dexelize(PARTS[0], resolution=10, axis="z")
    with pytest.raises(GridError, match="different rays"):
        model - other
    coarse = clvox.dexelize(PARTS[0], grid=GRID, axis="z", lattice_bits=8)
    with pytest.raises(GridError, match="lattice_bits are 8 and 12"):
        model ^ coarse
    # Depths of both have 18 binary places.
    with pytest.raises(GridError, match="lattice_bits are 12 and 14"):
        model | clvox.dexelize(PARTS[0], grid=GRID, axis="z", lattice_bits=14)
    assert model != coarse
    assert model != dexelize(PARTS[0], "x")
    assert model != "model"
    with pytest.raises(TypeError):
        model | voxelize(PARTS[0])  # type: ignore[operator]


def test_what_makes_no_sense_is_refused() -> None:
    bad: Any = "w"
    with pytest.raises(GridError, match="axis must be 'x', 'y', 'z' or 'xyz', got 'w'"):
        clvox.dexelize(PARTS[0], resolution=8, axis=bad)
    with pytest.raises(GridError, match="fill must be one of"):
        clvox.dexelize(PARTS[0], resolution=8, fill=bad)
    with pytest.raises(GridError, match="give one of resolution="):
        clvox.dexelize(PARTS[0], resolution=8, pitch=1)
    with pytest.raises(GridError, match="give one of resolution="):
        clvox.dexelize(PARTS[0])
    with pytest.raises(GridError, match="axis must be 'x', 'y' or 'z'"):
        DexelModel.from_voxels(voxelize(PARTS[0]), axis=bad)
    model = dexelize(PARTS[0], "z")
    for cells in (0, 1.5, None):
        with pytest.raises(GridError, match="cells must be a positive integer"):
            model.column_fractions(cells=cells)  # type: ignore[arg-type]
    lid = PARTS[2].vertices, PARTS[2].faces[:-1]
    with pytest.raises(clvox.NotClosedError):
        clvox.dexelize(lid, grid=GRID)
    faces = PARTS[2].faces.copy()
    faces[0] = faces[0][::-1]
    clvox.dexelize((PARTS[2].vertices, faces), grid=GRID)
    with pytest.raises(clvox.NotOrientedError):
        clvox.dexelize((PARTS[2].vertices, faces), grid=GRID, fill="nonzero")
