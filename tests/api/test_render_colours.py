"""Pictures in which triangles, or bodies, have colours."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

import clvox
from clvox.reference.raymarch import _ray, first_voxels, triangle_distances
from clvox.render.colours import BODY_COLOURS, bodies_of

SIZE = 48, 36
PURE = np.array([(255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 0)])
PLAIN = clvox.Material(ambient=0.0, diffuse=0.0, specular=0.0, emission=1.0)


def colour_numbers(image: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Which of the pure colours each pixel has, or -1; rims are a little brighter."""
    off = np.abs(image[..., None, :3].astype(int) - PURE).max(axis=-1)
    numbers: NDArray[np.int64] = np.where(image[..., 3] == 255, off.argmin(axis=-1), -1)
    return numbers


@pytest.mark.parametrize("levels", [[(24, 24, 24)], [(5, 6, 7), (5, 4, 3)]])
def test_places_have_the_colour_of_the_nearest_triangle(levels: Any) -> None:
    """Of those that touch the cell of the voxel that a ray meets, found by looking at all."""
    ball = trimesh.creation.icosphere(subdivisions=2)
    model = clvox.voxelize(ball, levels=levels, attributes=("normals", "links"))
    kinds = np.random.default_rng(3).integers(0, len(PURE), len(ball.faces))
    camera = clvox.Camera.around(model, aspect=SIZE[0] / SIZE[1])
    image = clvox.render(
        model, camera=camera, size=SIZE, colours=PURE[kinds], material=PLAIN, samples=1,
        occlusion=False,
    )  # fmt: skip
    found = colour_numbers(image)
    view = camera.view(model.grid, SIZE)
    grid, solid = model.grid, model.to_array(rule="touch")
    hits = first_voxels(solid, view.rays, SIZE)
    np.testing.assert_array_equal(found >= 0, hits[..., 0] >= 0)
    widths, doubtful, checked = np.array(grid.spacing), 0, 0
    for row, column in np.argwhere(hits[..., 0] >= 0)[::3]:
        place, direction = (np.array(part, float) for part in _ray(view.rays, column, row))
        voxel = hits[row, column]
        planes = (voxel + (direction < 0)) * 2.0**view.rays.bits
        with np.errstate(divide="ignore"):
            far = max(0.0, float(((planes - place) / direction)[direction != 0].max()))
        point = (place + far * direction) / 2.0**view.rays.bits * widths + grid.origin
        ends, linked = model.faces_at(grid.centers([voxel]))
        assert len(linked) == ends[1]
        distances = triangle_distances(point, ball.triangles[linked])
        nearest = kinds[linked[distances.argmin()]]
        others = distances[kinds[linked] != nearest]
        if len(others) and others.min() - distances.min() < 2e-3 * widths.max():
            doubtful += 1
            continue
        checked += 1
        assert found[row, column] == nearest
    assert checked > 60
    assert doubtful < 0.3 * checked


def two_balls() -> trimesh.Trimesh:
    first = trimesh.creation.icosphere(subdivisions=2)
    second = first.copy()
    second.apply_translation((3, 0, 0))
    return trimesh.Trimesh(
        np.concatenate([first.vertices, second.vertices]),
        np.concatenate([first.faces, second.faces + len(first.vertices)]),
        process=False,
    )


def test_bodies_have_colours_of_their_own() -> None:
    model = clvox.voxelize(two_balls(), resolution=48, attributes=("links",))
    image = clvox.render(
        model, size=SIZE, colours="bodies", material=PLAIN, samples=1, occlusion=False
    )
    middles = image[SIZE[1] // 2, [SIZE[0] // 4, 3 * SIZE[0] // 4], :3].astype(int)
    off = np.abs(np.sort(middles, axis=0) - np.sort(np.array(BODY_COLOURS[:2]), axis=0))
    assert off.max() < 12
    assert np.abs(middles[0] - middles[1]).max() > 40


def test_colours_are_of_triangles_as_they_were_given() -> None:
    """Also of those after one that was dropped; what a cut opens keeps its own."""
    ball = two_balls()
    dropped = np.concatenate([ball.faces[:1], ball.faces])
    mesh = trimesh.Trimesh(ball.vertices, dropped, process=False)
    model = clvox.voxelize(mesh, resolution=48, attributes=("links",))
    kinds = np.zeros(len(dropped), int)
    kinds[1 + len(ball.faces) // 2 :] = 2
    cut = (model.bounds.mean(axis=0), (0, 0, 1))
    camera = clvox.Camera.around(model, direction=(0, 0.01, -1), up=(0, 1, 0), aspect=4 / 3)
    image = clvox.render(
        model, camera=camera, size=SIZE, colours=PURE[kinds], material=PLAIN, samples=1
    )
    found = colour_numbers(image)
    left, right = found[:, : SIZE[0] // 2], found[:, SIZE[0] // 2 :]
    assert {0} == set(left[left >= 0])
    assert {2} == set(right[right >= 0])
    opened = clvox.Camera(camera.eye, camera.target, camera.up, cut=cut)
    image = clvox.render(
        model, camera=opened, size=SIZE, colours=PURE[kinds], material=PLAIN, samples=1
    )
    off = np.abs(image[18, 12, :3].astype(int) - PLAIN.cut_color)
    assert off.max() < 12


@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 9))
def test_bodies_are_connected_components(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    faces = np.array([rng.choice(3 * count, 3, replace=False) for _ in range(count)], np.int32)
    graph = [{int(vertex) for vertex in face} for face in faces]
    expected = list(range(count))
    for _ in range(count):
        for i in range(count):
            for j in range(i):
                if graph[i] & graph[j]:
                    expected[i] = expected[j] = min(expected[i], expected[j])
    bodies = bodies_of(faces, 3 * count)
    same = bodies[:, None] == bodies
    assert (same == (np.array(expected)[:, None] == expected)).all()
    assert set(bodies) == set(range(len(set(expected))))


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"colours": "faces"}, clvox.GridError, "colours must be 'bodies' or a colour for each"),
        ({"colours": [(1, 2, 3)]}, clvox.GridError, "integers of shape (320, 3)"),
        ({"colours": [[1, 2, 3], [4]]}, clvox.GridError, "rows of different lengths"),
        ({"colours": np.full((320, 3), 256)}, clvox.GridError, "colours must be from 0 to 255"),
        ({"colours": "bodies", "style": "volume"}, clvox.GridError, "for the style 'surface'"),
    ],
)
def test_colours_that_make_no_sense_are_refused(
    options: dict[str, Any], error: type[Exception], message: str
) -> None:
    ball = trimesh.creation.icosphere(subdivisions=2)
    model = clvox.voxelize(ball, resolution=16, attributes=("links",))
    with pytest.raises(error) as refused:
        clvox.render(model, size=SIZE, **options)
    assert message in str(refused.value)


def test_links_alone_change_no_picture() -> None:
    """Touched voxels are drawn for normals or colours, and for links only if colours are asked."""
    ball = trimesh.creation.icosphere(subdivisions=2)
    plain, linked, normal = (
        clvox.voxelize(ball, resolution=16, attributes=names)
        for names in ((), ("links",), ("normals", "links"))
    )
    inner, same, outer = (clvox.render(model, size=SIZE) for model in (plain, linked, normal))
    np.testing.assert_array_equal(same, inner)
    coloured = clvox.render(linked, size=SIZE, colours="bodies")
    np.testing.assert_array_equal(coloured[..., 3], outer[..., 3])
    assert (coloured[..., 3] != inner[..., 3]).any()


def test_colours_need_links() -> None:
    model = clvox.voxelize(trimesh.creation.icosphere(), resolution=16, attributes=("normals",))
    with pytest.raises(clvox.MeshError, match="colours need links to triangles"):
        clvox.render(model, size=SIZE, colours="bodies")
