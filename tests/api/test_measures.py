"""Centre of mass, inertia, coverage, bounds of the volume, and trimesh's own voxels."""

from __future__ import annotations

from fractions import Fraction
from typing import Any, cast

import numpy as np
import pytest
import trimesh

from clvox import Grid, GridError, VoxelModel, voxelize
from clvox.models.levels import Levels

GRID = Grid((-1.0, 2.0, 0.5), (0.5, 0.25, 1.0), (37, 26, 19))
LEVELS: list[Levels] = [
    [GRID.shape],
    [(5, 4, 3), (8, 8, 8)],
    [(1, 6, 10), (40, 5, 2)],
    [(3, 4, 2), (4, 2, 3), (4, 4, 4)],
]


def boxes(model: VoxelModel) -> trimesh.Trimesh:
    """The union of the voxels' boxes."""
    extents = np.array(model.grid.spacing)
    centers = model.grid.centers(model.coordinates())
    parts = [trimesh.creation.box(bounds=[c - extents / 2, c + extents / 2]) for c in centers]
    return cast("trimesh.Trimesh", trimesh.util.concatenate(parts))


@pytest.mark.parametrize("levels", LEVELS)
def test_mass_properties_are_those_of_the_boxes(levels: Levels) -> None:
    """As trimesh computes them, on voxels that are no cubes."""
    rng = np.random.default_rng(1)
    voxels = rng.random(GRID.array_shape) < 0.02
    voxels[3:6, 5:9, 10:20] = True
    model = VoxelModel.from_array(voxels, GRID, levels=levels)
    mesh = boxes(model)
    assert model.volume == pytest.approx(mesh.volume)
    assert model.center_mass == pytest.approx(mesh.center_mass)
    scale = np.abs(mesh.moment_inertia).max()
    assert model.moment_inertia == pytest.approx(mesh.moment_inertia, abs=1e-9 * scale)


def test_a_single_voxel_has_the_inertia_of_its_box() -> None:
    """Mass times (b^2 + c^2) / 12."""
    voxels = np.zeros(GRID.array_shape, np.bool_)
    voxels[18, 25, 36] = True
    model = VoxelModel.from_array(voxels, GRID)
    mass, (dx, dy, dz) = 0.125, GRID.spacing
    expected = np.diag([dy**2 + dz**2, dx**2 + dz**2, dx**2 + dy**2]) * mass / 12
    assert model.center_mass.tolist() == GRID.centers([[36, 25, 18]])[0].tolist()
    assert model.moment_inertia == pytest.approx(expected)


def test_mass_properties_are_the_same_far_away() -> None:
    """Sums are exact, so nothing cancels: a box moved by 60,000 voxels has the same inertia."""
    far = Grid((0.0, 0.0, 0.0), 1.0, (60010, 4, 4))
    near = Grid((60000.0, 0.0, 0.0), 1.0, (10, 4, 4))
    mesh = trimesh.creation.box(bounds=[[60001, 1, 1], [60004, 3, 2]])
    one, other = (voxelize(mesh, grid=grid, lattice_bits=8) for grid in (near, far))
    assert one.moment_inertia.tolist() == other.moment_inertia.tolist()
    assert one.center_mass.tolist() == other.center_mass.tolist() == [60002.5, 2.0, 1.5]


@pytest.mark.parametrize("levels", LEVELS)
def test_nothing_has_no_centre_and_no_inertia(levels: Levels) -> None:
    """The mean of nothing is NaN, the sum over nothing zero."""
    nothing = VoxelModel.from_array(np.zeros(GRID.array_shape, np.bool_), GRID, levels=levels)
    assert np.isnan(nothing.center_mass).tolist() == [True] * 3
    assert nothing.moment_inertia.tolist() == [[0.0] * 3] * 3
    assert not nothing.coverage().any()


@pytest.mark.parametrize("levels", LEVELS)
@pytest.mark.parametrize("cells", [8, 1, 100, (3, 7, 2), np.array([40, 1, 19])])
def test_coverage(levels: Levels, cells: int | tuple[int, int, int]) -> None:
    """Means of the voxels of each cell, as far as the grid reaches."""
    voxels = np.random.default_rng(2).random(GRID.array_shape) < 0.3
    voxels[:9, 3:, :30] = True
    found = VoxelModel.from_array(voxels, GRID, levels=levels).coverage(cells=cells)
    x, y, z = np.broadcast_to(cells, 3).tolist()
    nx, ny, nz = GRID.shape
    assert found.dtype == np.float32
    assert found.shape == (-(-nz // z), -(-ny // y), -(-nx // x))
    for k, j, i in np.ndindex(*found.shape):
        part = voxels[k * z : (k + 1) * z, j * y : (j + 1) * y, i * x : (i + 1) * x]
        assert found[k, j, i] == np.float32(part.mean())


@pytest.mark.parametrize("cells", [0, -1, 2.0, (1, 2), (4, 0, 4), "x", None, [[1, 2, 3]]])
def test_coverage_refuses(cells: object) -> None:
    model = VoxelModel.from_array(np.ones(GRID.array_shape, np.bool_), GRID)
    with pytest.raises(GridError, match="positive integers"):
        model.coverage(cells=cells)  # type: ignore[arg-type]


STEP = Fraction(1, 128)
"""Of the coarsest lattice, in voxels."""


def wedge(slope_to: int) -> tuple[trimesh.Trimesh, Fraction]:
    """A solid whose top cuts a voxel that its top on the lattice does not touch.

    The top falls from (0, 1) to (slope_to, 0) in steps beyond the voxel's upper corners; each of
    its ends is lower by 0.49 steps in the mesh.  Returns also the volume of what lies below it in
    the voxel, in voxels.
    """
    start, end = Fraction(1) - Fraction(49, 100), -Fraction(49, 100)
    left, right = [(-0.5, 1.0 + float(start * STEP)), (float(slope_to * STEP), 1.0)]
    right = right[0], 1.0 + float(end * STEP)
    profile = np.array([[-0.5, -2.0], [3.0, -2.0], [3.0, right[1]], [*right], [*left]])
    x0, x1 = Fraction(left[0]), Fraction(right[0])
    y0, y1 = Fraction(left[1]), Fraction(right[1])

    def height(x: Fraction) -> Fraction:
        return y0 + (y1 - y0) * (x - x0) / (x1 - x0)

    crossing = x0 + (x1 - x0) * (1 - y0) / (y1 - y0)
    assert 0 < crossing < 1
    missing = (1 - height(Fraction(1))) * (1 - crossing) / 2
    number = len(profile)
    vertices = np.array([[x, y, z] for z in (-2.0, 3.0) for x, y in profile])
    faces = []
    for i in range(number):
        j = (i + 1) % number
        faces += [[i, j, j + number], [i, j + number, i + number]]
    # Seen from the lower right corner the profile is a fan.
    for i in range(2, number):
        a, b, c = 1, i, (i + 1) % number
        faces += [[a, c, b], [a + number, b + number, c + number]]
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    return mesh, 1 - missing


def test_bounds_of_the_volume_hold_for_the_mesh_as_given() -> None:
    """On the lattice the solid fills the voxel; the mesh's solid does not."""
    mesh, volume = wedge(129)
    grid = Grid((0.0, 0.0, 0.0), 1.0, (1, 1, 1))
    model = voxelize(mesh, grid=grid, lattice_bits=7)
    assert mesh.is_watertight
    assert mesh.volume > 0
    assert model.to_array(rule="within").sum() * grid.voxel_volume > volume
    low, high = model.volume_bounds
    assert low < volume < high
    assert high - low < 0.1
    complement_low, complement_high = (~model).volume_bounds
    assert complement_low < 1 - volume < complement_high


@pytest.mark.parametrize("bits", [7, 9, 13])
@pytest.mark.parametrize("seed", range(4))
def test_bounds_of_the_volume(bits: int, seed: int) -> None:
    """Convex solids anywhere, on grids that hold them."""
    rng = np.random.default_rng(seed)
    hull = trimesh.convex.convex_hull(rng.normal(size=(20, 3)))
    grid = Grid.fit(hull, pitch=(0.2, 0.3, 0.25))
    model = voxelize(hull, grid=grid, lattice_bits=bits)
    low, high = model.volume_bounds
    assert 0 <= low < hull.volume < high <= grid.size * grid.voxel_volume
    within, touch = (model.to_array(rule=rule).sum() for rule in ("within", "touch"))
    widened = low < within * grid.voxel_volume, touch * grid.voxel_volume < high
    assert widened == (True, True)
    # The area times half a step, and a little for the edges.
    steps = np.array(grid.spacing) / 2**bits
    assert (high - low) - (touch - within) * grid.voxel_volume < 4 * hull.area * steps.max()


def test_bounds_are_not_widened_by_vertices_on_the_lattice() -> None:
    """Nothing moves, so nothing is swept but what rounding may have hidden."""
    mesh = trimesh.creation.box(bounds=[[1, 1, 1], [3, 4, 5]])
    model = voxelize(mesh, grid=Grid((0.0, 0.0, 0.0), 1.0, (6, 6, 6)), lattice_bits=7)
    assert model.volume_bounds == pytest.approx((0.0, 4.0 * 5.0 * 6.0), rel=1e-6)


def test_trimesh_voxels_are_where_ours_are() -> None:
    """Its matrix has the order (x, y, z), its points are centres."""
    mesh = trimesh.creation.icosphere(radius=3.0)
    mesh.apply_translation([5.0, -2.0, 1.0])
    grid = Grid.fit(mesh, pitch=(0.5, 0.4, 0.3))
    model = voxelize(mesh, grid=grid)
    assert isinstance(model.to_trimesh(), trimesh.voxel.VoxelGrid)
    found: Any = model.to_trimesh()
    assert found.shape == grid.shape
    assert found.filled_count == model.count
    assert found.volume == pytest.approx(model.volume)
    centers = grid.centers(model.coordinates())
    order = np.lexsort(np.round(found.points, 6).T), np.lexsort(np.round(centers, 6).T)
    assert found.points[order[0]] == pytest.approx(centers[order[1]])
    indices = found.sparse_indices[order[0]]
    assert (indices == model.coordinates()[order[1]]).all()
    points = np.random.default_rng(3).uniform(grid.bounds[0], grid.bounds[1], (2000, 3))
    assert (found.is_filled(points) == model.contains(points)).all()
