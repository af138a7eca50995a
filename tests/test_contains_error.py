"""`contains` is wrong in touched voxels only, and near the surface only: see the guide's table."""

from __future__ import annotations

import numpy as np
import trimesh

from benchmarks.contains_error import BEYOND, WIDTH, distance, is_inside, measure, table


def test_truth_is_right_about_a_box() -> None:
    """Inside, outside, and the distance from faces, edges and corners."""
    mesh = trimesh.creation.box(bounds=[[0, 0, 0], [4, 4, 4]])
    triangles = np.asarray(mesh.triangles)
    points = np.array([[1.0, 2, 2], [5, 2, 2], [5, 5, 2], [5, 5, 5], [-3, -4, 2], [2, 2, 3.5]])
    assert is_inside(triangles, points).tolist() == [True, False, False, False, False, True]
    expected = [1.0, 1.0, 2**0.5, 3**0.5, 5.0, 0.5]
    assert np.allclose(distance(triangles, points), expected)


def test_errors_fall_with_the_distance_and_there_are_none_elsewhere() -> None:
    mesh = trimesh.creation.icosphere(subdivisions=2)
    found = measure(mesh, 24, 6000)
    assert found.wrong_elsewhere == 0
    assert found.elsewhere > 1000
    assert found.wrong.sum() > 100
    assert not found.wrong[int(BEYOND / WIDTH) + 1 :].any()
    shares = found.wrong[:6] / found.points[:6]
    assert (np.diff(shares) < 0).all()
    assert "voxel not touched | 0 of" in table({"ball": found})
