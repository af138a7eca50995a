"""`clvox.mesh.check`: what it welds, drops, counts and refuses."""

from __future__ import annotations

import gc
from collections import Counter
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from clvox import _blocks, _weld
from clvox import mesh as module
from clvox.errors import MeshError, NotClosedError, NotOrientedError
from clvox.mesh import Surface, check

TETRAHEDRON = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)
SIDES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])


def box() -> trimesh.Trimesh:
    mesh: trimesh.Trimesh = trimesh.creation.box()
    return mesh


def soup(
    vertices: NDArray[np.float64], faces: NDArray[np.int64], seed: int = 0
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Three vertices per triangle, triangles and vertices in random order."""
    rng = np.random.default_rng(seed)
    corners = vertices[rng.permutation(faces)].reshape(-1, 3)
    order = rng.permutation(len(corners))
    place = np.argsort(order)
    return corners[order], place.reshape(-1, 3)


def shape_of(surface: Surface) -> Counter[tuple[tuple[float, ...], ...]]:
    """The triangles by their coordinates, whatever their numbering and first corner."""
    corners = surface.vertices[surface.faces].tolist()
    return Counter(min((*c[i:], *c[:i]) for i in range(3)) for c in map(_tuples, corners))


def _tuples(corners: list[list[float]]) -> tuple[tuple[float, ...], ...]:
    return tuple(map(tuple, corners))


Edges = set[tuple[int, int]]


def twin(faces: NDArray[np.int64]) -> tuple[set[tuple[int, int, int]], Edges, Edges]:
    """What is left of the triangles, the odd and the uneven edges, by counting in a dictionary."""
    rings = set()
    for a, b, c in faces.tolist():
        if len({a, b, c}) == 3:
            low = min(a, b, c)
            rings.add((a, b, c) if a == low else (b, c, a) if b == low else (c, a, b))
    left = {(a, b, c) for a, b, c in rings if (a, c, b) not in rings}
    uses: Counter[tuple[int, int]] = Counter()
    for a, b, c in left:
        uses.update([(a, b), (b, c), (c, a)])
    edges = {(min(edge), max(edge)) for edge in uses}
    odd = {(a, b) for a, b in edges if (uses[a, b] + uses[b, a]) % 2}
    uneven = {(a, b) for a, b in edges if uses[a, b] != uses[b, a]}
    return left, odd, uneven


def named(surface: Surface, edges: NDArray[np.int32]) -> set[tuple[int, int]]:
    """Edges in the caller's numbers."""
    numbers = surface.vertex_numbers
    own = edges if numbers is None else numbers[edges]
    return {(min(pair), max(pair)) for pair in map(tuple, own.tolist())}


# --- a sound mesh -------------------------------------------------------------------------------


def test_sound_mesh_comes_back_as_it_is() -> None:
    mesh = trimesh.creation.icosphere(subdivisions=3)
    surface = check(mesh)
    np.testing.assert_array_equal(surface.vertices, mesh.vertices)
    np.testing.assert_array_equal(surface.faces, mesh.faces)
    np.testing.assert_array_equal(surface.bounds, mesh.bounds)
    assert surface.vertices.dtype == np.float64
    assert surface.faces.dtype == np.int32
    assert surface.closed
    assert surface.oriented
    assert not surface.warnings
    assert surface.face_numbers is None
    assert surface.vertex_numbers is None
    assert (surface.repeated, surface.duplicates, surface.cancelled) == (0, 0, 0)
    assert surface.welded_by == 0.0
    surface.require_closed()
    surface.require_oriented()


def test_arrays_are_read_only_and_the_callers_are_untouched() -> None:
    vertices, faces = TETRAHEDRON.copy(), SIDES.copy()
    surface = check((vertices, faces))
    for array in (surface.vertices, surface.faces, surface.bounds, surface.odd_edges):
        assert not array.flags.writeable
    vertices[0] = 9
    faces[0] = 1
    np.testing.assert_array_equal(surface.vertices, TETRAHEDRON)
    np.testing.assert_array_equal(surface.faces, SIDES)


@pytest.mark.parametrize(
    "vertices",
    [
        TETRAHEDRON.tolist(),
        TETRAHEDRON.astype(np.float32),
        TETRAHEDRON.astype(np.int16),
        TETRAHEDRON.astype(">f8"),
        np.asfortranarray(TETRAHEDRON),
        np.repeat(TETRAHEDRON, 2, axis=0)[::2],
    ],
)
def test_any_real_vertices_are_taken(vertices: Any) -> None:
    np.testing.assert_array_equal(check((vertices, SIDES.astype(np.uint8))).vertices, TETRAHEDRON)
    assert check((vertices, np.asfortranarray(SIDES)[:, ::-1].tolist())).closed


def test_surface_is_not_checked_again() -> None:
    surface = check((TETRAHEDRON, SIDES))
    assert check(surface) is surface


# --- welding ------------------------------------------------------------------------------------

MESHES = [
    trimesh.creation.icosphere(subdivisions=1),
    trimesh.creation.torus(2.0, 0.5, major_sections=7, minor_sections=5),
    trimesh.creation.box(),
]


@settings(max_examples=60, deadline=None)
@given(
    which=st.sampled_from(range(len(MESHES))),
    seed=st.integers(0, 2**32 - 1),
    scale=st.sampled_from([1e-6, 1.0, 3e5]),
    offset=st.sampled_from([0.0, -0.25, 1e6]),
)
def test_soup_welds_to_the_same_mesh(which: int, seed: int, scale: float, offset: float) -> None:
    vertices = np.asarray(MESHES[which].vertices) * scale + offset * max(scale, 1e-6)
    faces = np.asarray(MESHES[which].faces)
    whole, welded = check((vertices, faces)), check(soup(vertices, faces, seed))
    assert welded.closed
    assert welded.oriented
    assert not welded.warnings
    assert len(welded.vertices) == len(vertices)
    assert welded.welded_by == 0.0
    assert shape_of(welded) == shape_of(whole)


def test_small_mesh_far_away_survives() -> None:
    vertices = TETRAHEDRON * 1e-6 + 1e6
    surface = check(soup(vertices, SIDES))
    assert surface.closed
    assert len(surface.vertices) == 4


@pytest.mark.parametrize("size", [1e-320, 1e-150, 1e-9, 1e17])
def test_size_does_not_matter(size: float) -> None:
    surface = check(soup(TETRAHEDRON * size, SIDES))
    assert surface.closed
    assert surface.oriented
    assert not surface.warnings
    assert len(check((TETRAHEDRON * size, SIDES[1:])).odd_edges) == 3


def test_zero_has_one_sign() -> None:
    vertices, faces = soup(TETRAHEDRON, SIDES)
    flipped = np.where(np.arange(len(vertices))[:, None] % 2, vertices, -0.0 + vertices)
    flipped[(vertices == 0) & (np.arange(len(vertices))[:, None] % 2 == 0)] = -0.0
    assert np.signbit(flipped).any()
    surface = check((flipped, faces))
    assert surface.closed
    assert len(surface.vertices) == 4
    assert not np.signbit(surface.vertices).any()


@pytest.mark.parametrize("keep", [0, 3, 2**64 - 1])
def test_colliding_hashes_change_nothing(monkeypatch: pytest.MonkeyPatch, keep: int) -> None:
    mesh = trimesh.creation.icosphere(subdivisions=2)
    vertices, faces = soup(mesh.vertices, mesh.faces)
    doubled = np.concatenate([faces, faces[:5], faces[7:9, ::-1]])
    expected = check((vertices, doubled))
    assert expected.duplicates == 5
    assert expected.cancelled == 4
    weak = _weld._hash

    def worse(rows: NDArray[np.uint64]) -> NDArray[np.uint64]:
        return weak(rows) << np.uint64(60) & np.uint64(keep << 60 & 2**64 - 1)

    monkeypatch.setattr(_weld, "_hash", worse)
    found = check((vertices, doubled))
    np.testing.assert_array_equal(found.vertices, expected.vertices)
    np.testing.assert_array_equal(found.faces, expected.faces)
    np.testing.assert_array_equal(found.face_numbers, expected.face_numbers)
    assert not check((mesh.vertices, mesh.faces)).warnings


def test_welded_vertex_has_the_lowest_number_of_the_caller() -> None:
    vertices = np.concatenate([TETRAHEDRON, [[7.0, 7, 7]], TETRAHEDRON])
    faces = np.where(np.arange(4)[:, None] % 2, SIDES, SIDES + 5)
    surface = check((vertices, faces))
    assert surface.vertex_numbers is not None
    assert surface.vertex_numbers.tolist() == [0, 1, 2, 3]
    # The vertex without a triangle counts for nothing.
    assert surface.bounds.tolist() == [[0, 0, 0], [1, 1, 1]]


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e9])
def test_open_mesh_is_welded_by_a_share_of_its_size(size: float) -> None:
    vertices, faces = soup(TETRAHEDRON * size, SIDES)
    moved = vertices + np.random.default_rng(1).uniform(0, 0.9e-8, vertices.shape) * size
    surface = check((moved, faces))
    assert surface.closed
    assert surface.oriented
    assert surface.welded_by == pytest.approx(1e-8 * size, rel=1e-6)
    assert surface.warnings[0].startswith("8 vertices were merged with others within")
    inside = (surface.vertices >= surface.bounds[0]) & (surface.vertices <= surface.bounds[1])
    assert inside.all()
    assert (surface.vertices.min(axis=0) == surface.bounds[0]).all()


def test_open_mesh_is_not_welded_by_more() -> None:
    vertices, faces = soup(TETRAHEDRON, SIDES)
    moved = vertices + np.random.default_rng(1).uniform(0, 1e-6, vertices.shape)
    surface = check((moved, faces))
    assert not surface.closed
    assert surface.welded_by == 0.0


def test_weld_that_closes_nothing_is_not_made() -> None:
    """Two open triangles that all but share a corner have six odd edges, merged or not."""
    vertices = np.concatenate([TETRAHEDRON[1:], TETRAHEDRON[1:] * [1 + 1e-9, 2, 3]])
    surface = check((vertices, np.arange(6).reshape(2, 3)))
    assert len(surface.vertices) == 6
    assert surface.welded_by == 0.0


def test_closed_mesh_is_not_welded_by_a_tolerance() -> None:
    """Two corners of a sound mesh may be closer than the tolerance."""
    near = np.concatenate([TETRAHEDRON, TETRAHEDRON * 1e-10 + 0.5])
    surface = check((near, np.concatenate([SIDES, SIDES + 4])))
    assert len(surface.vertices) == 8
    assert not surface.warnings


# --- triangles that are dropped, and those that are not -----------------------------------------


def test_triangle_with_a_repeated_vertex_is_dropped() -> None:
    faces = np.concatenate([SIDES[:1], [[1, 1, 2]], SIDES[1:], [[3, 0, 3]]])
    surface = check((TETRAHEDRON, faces))
    assert surface.closed
    assert surface.repeated == 2
    assert surface.face_numbers is not None
    assert surface.face_numbers.tolist() == [0, 2, 3, 4]
    assert surface.warnings == ("2 triangles were dropped, with a vertex number twice",)


def test_of_duplicates_the_first_is_kept() -> None:
    faces = np.concatenate([SIDES, SIDES[1:2], np.roll(SIDES[2:3], 1, axis=1)])
    surface = check((TETRAHEDRON, faces))
    assert surface.closed
    assert surface.oriented
    assert surface.duplicates == 2
    assert surface.face_numbers is not None
    assert surface.face_numbers.tolist() == [0, 1, 2, 3]


def test_opposite_pair_cancels() -> None:
    """Two tetrahedra on both sides of one triangle become one body."""
    apex = np.concatenate([TETRAHEDRON, [[1.0, 1, 1]]])
    other = np.array([[1, 2, 4], [2, 3, 4], [3, 1, 4], [1, 3, 2]])
    surface = check((apex, np.concatenate([SIDES, other])))
    assert surface.closed
    assert surface.oriented
    assert surface.cancelled == 2
    assert len(surface.faces) == 6


def test_opposite_pair_apart_from_everything_cancels() -> None:
    """Each of its edges is used once each way, like those of a sound mesh."""
    vertices = np.concatenate([TETRAHEDRON, [[5.0, 5, 5], [6, 5, 5], [5, 6, 5]]])
    surface = check((vertices, np.concatenate([SIDES, [[4, 5, 6], [6, 5, 4]]])))
    assert surface.cancelled == 2
    assert len(surface.vertices) == 4
    assert surface.bounds.tolist() == [[0, 0, 0], [1, 1, 1]]


def test_third_vertex_that_does_not_fit_the_key(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_weld, "_widths", lambda _: (30, 3))
    mesh = trimesh.creation.icosphere(subdivisions=2)
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    assert check((vertices, faces)).oriented
    pillow = np.concatenate([vertices, 3 + TETRAHEDRON[1:]])
    last = len(vertices) + np.array([[0, 1, 2], [1, 0, 2]])
    assert check((pillow, np.concatenate([faces, last]))).cancelled == 2
    assert len(check((vertices, faces[:-1])).odd_edges) == 3


def test_triangle_without_area_holds_a_t_junction_shut() -> None:
    """An edge of the tetrahedron is split on one side only; a flat triangle fills the gap."""
    vertices = np.concatenate([TETRAHEDRON, [[0.5, 0, 0]]])
    faces = np.array([[0, 2, 4], [4, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3], [0, 4, 1]])
    surface = check((vertices, faces))
    assert surface.closed
    assert surface.oriented
    assert len(surface.faces) == 6
    assert not check((vertices, faces[:-1])).closed


def test_touching_bodies_are_closed() -> None:
    """Two tetrahedra share an edge: four triangles meet in it."""
    vertices = np.concatenate([TETRAHEDRON, TETRAHEDRON * [-1, -1, 1]])
    surface = check((vertices, np.concatenate([SIDES, SIDES + 4])))
    assert surface.closed
    assert surface.oriented
    assert len(surface.vertices) == 6
    assert surface.warnings == (
        "some edges (1) belong to more than two triangles: surfaces touch there",
    )


# --- closed and oriented ------------------------------------------------------------------------


@settings(max_examples=300, deadline=None)
@given(
    faces=st.lists(st.tuples(*[st.integers(0, 5)] * 3), min_size=1, max_size=16),
    mirrored=st.booleans(),
)
def test_edges_agree_with_a_dictionary(faces: list[tuple[int, int, int]], mirrored: bool) -> None:
    array = np.array(faces)
    if mirrored:
        # Closed by every triangle's four sides: a common case instead of a rare one.
        array = np.concatenate([[(a, b, c), (a, c, 6), (c, b, 6), (b, a, 6)] for a, b, c in faces])
    points = np.random.default_rng(3).uniform(size=(7, 3))
    left, odd, uneven = twin(array)
    if not left:
        with pytest.raises(MeshError):
            check((points, array))
        return
    surface = check((points, array))
    assert len(surface.faces) == len(left)
    assert named(surface, surface.odd_edges) == odd
    assert named(surface, surface.uneven_edges) == uneven
    assert surface.closed == (not odd)
    assert surface.oriented == (not uneven)


def test_large_mesh_takes_the_same_way_as_a_small_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two threads and several blocks give what one of each gives."""
    mesh = trimesh.creation.icosphere(subdivisions=4)
    vertices, faces = soup(mesh.vertices, mesh.faces)
    faces = np.concatenate([faces[20:], faces[30:40]])
    expected = check((vertices, faces))
    monkeypatch.setattr(_weld, "SMALL", 16)
    monkeypatch.setattr(_blocks, "SMALL", 16)
    monkeypatch.setattr(_blocks, "BLOCK", 100)
    monkeypatch.setattr(module, "BLOCK", 100)
    found = check((vertices, faces))
    np.testing.assert_array_equal(found.faces, expected.faces)
    np.testing.assert_array_equal(found.odd_edges, expected.odd_edges)
    assert found.warnings == expected.warnings
    assert not found.closed
    assert check(mesh).oriented
    turned = np.asarray(mesh.faces).copy()
    turned[-1] = turned[-1, ::-1]
    assert len(check((mesh.vertices, turned)).uneven_edges) == 3


def test_open_mesh_says_where() -> None:
    vertices = np.concatenate([[[9.0, 9, 9]], TETRAHEDRON])
    surface = check((vertices, SIDES[1:] + 1))
    assert not surface.closed
    assert not surface.oriented
    text = (
        "the mesh is open: 3 edges belong to one triangle only, "
        "the first between vertices 1 and 2 near (0.5, 0, 0)"
    )
    assert surface.warnings == (text,)
    with pytest.raises(NotClosedError) as caught:
        surface.require_closed()
    assert str(caught.value) == (
        f'{text}. A solid needs a closed surface; fill="winding" or fill="vote" guesses one, '
        "trimesh.repair.fill_holes may close it."
    )
    with pytest.raises(NotClosedError):
        surface.require_oriented()


def test_edge_of_three_triangles_is_odd() -> None:
    vertices = np.concatenate([TETRAHEDRON, [[0.5, -1, -1]]])
    surface = check((vertices, np.concatenate([SIDES, [[0, 1, 4]]])))
    assert "3 edges belong to an odd number of triangles" in surface.warnings[-1]


def test_turned_triangle_is_closed_but_not_oriented() -> None:
    faces = SIDES.copy()
    faces[0] = faces[0, ::-1]
    surface = check((TETRAHEDRON, faces))
    assert surface.closed
    assert not surface.oriented
    assert "3 edges are used more often one way than the other" in surface.warnings[0]
    surface.require_closed()
    with pytest.raises(NotOrientedError, match=r"between vertices 0 and 1 near \(0.5, 0, 0\)"):
        surface.require_oriented()


@pytest.mark.parametrize("offset", [0.0, 1e6])
def test_inside_out_mesh_warns(offset: float) -> None:
    surface = check((TETRAHEDRON + offset, SIDES[:, ::-1]))
    assert surface.closed
    assert surface.oriented
    assert surface.warnings == ("the mesh is inside out: its signed volume is -0.166667",)


@pytest.mark.parametrize("turn", [1, -1])
@pytest.mark.parametrize("seed", range(4))
def test_double_sheet_far_away_is_not_inside_out(turn: int, seed: int) -> None:
    """Its volume is zero; only the rounding of a careless sum has a sign."""
    x, y = np.random.default_rng(seed).integers(0, 2**20, (2, 4)) / 2**20
    vertices = np.stack([x, y, x + y], axis=1) + 2.0**24
    faces = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]])[:, ::turn]
    surface = check((vertices, faces))
    assert surface.oriented
    assert not surface.warnings


# --- what is refused ----------------------------------------------------------------------------


def wrong(row: int, value: list[float]) -> NDArray[np.float64]:
    vertices = TETRAHEDRON.copy()
    vertices[row] = value
    return vertices


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        (wrong(2, [np.nan, 3.5, 2]), SIDES, "vertex 2 is (nan, 3.5, 2.0); all coordinates must"),
        (wrong(3, [0, -np.inf, 2]), SIDES, "vertex 3 is (0.0, -inf, 2.0); all coordinates must"),
        (wrong(1, [1e200, 0, 0]), SIDES, "vertex 1 is (1e+200, 0, 0); coordinates must not exc"),
        (TETRAHEDRON, np.empty((0, 3), int), "the mesh has no triangles"),
        (TETRAHEDRON, [], "the mesh has no triangles"),
        (np.empty((0, 3)), SIDES, "triangle 0 uses vertex 0; there are no vertices"),
        (TETRAHEDRON, SIDES + 1, "triangle 1 uses vertex 4; the vertices are 0 to 3"),
        (TETRAHEDRON, SIDES - 1, "triangle 0 uses vertex -1; the vertices are 0 to 3"),
        (TETRAHEDRON, SIDES.astype(np.uint64) + np.uint64(2**63), "triangle 0 uses vertex 92233"),
        (TETRAHEDRON, SIDES.astype(float), "faces must be integers of shape (m, 3), got float64"),
        (TETRAHEDRON, SIDES > 0, "faces must be integers of shape (m, 3), got bool (4, 3)"),
        (TETRAHEDRON, SIDES.reshape(3, 4), "faces must be integers of shape (m, 3), got int64"),
        (TETRAHEDRON, [[0, 1, 2], [0, 1]], "faces must be an array of three columns; its rows"),
        (TETRAHEDRON[:, :2], SIDES, "vertices must be real numbers of shape (n, 3), got float64"),
        (TETRAHEDRON * 1j, SIDES, "vertices must be real numbers of shape (n, 3), got complex128"),
        (np.full((4, 3), "1"), SIDES, "vertices must be real numbers of shape (n, 3), got <U1"),
        (TETRAHEDRON * [1, 1, 0], SIDES, "the mesh is flat: its extent is (1.0, 1.0, 0.0), noth"),
        (TETRAHEDRON * [1, 0, 0], SIDES, "the mesh is flat: its extent is (1.0, 0.0, 0.0), noth"),
        (TETRAHEDRON * 0 + 4.5, SIDES, "the mesh is a single point, (4.5, 4.5, 4.5)"),
        (TETRAHEDRON, [[0, 0, 1], [2, 3, 2]], "nothing is left of 2 triangles: 2 use a vertex"),
        (TETRAHEDRON, [[1, 2, 3], [3, 2, 1]], "nothing is left of 2 triangles: 0 use a vertex"),
        (
            np.arange(12.0).reshape(4, 3) * [1, 2, 3],
            SIDES,
            "none of the 4 triangles has an area",
        ),
    ],
)
def test_refused(vertices: NDArray[np.float64], faces: NDArray[np.int64], message: str) -> None:
    with pytest.raises(MeshError) as caught:
        check((vertices, faces))
    assert message in str(caught.value)


def test_vertex_without_a_triangle_may_be_anything() -> None:
    vertices = np.concatenate([[[np.nan, np.inf, 0]], TETRAHEDRON])
    surface = check((vertices, SIDES + 1))
    assert surface.closed
    assert len(surface.vertices) == 4


@pytest.mark.parametrize("thing", [3, None, trimesh.Scene(box()), (TETRAHEDRON,), TETRAHEDRON])
def test_other_things_are_no_mesh(thing: object) -> None:
    with pytest.raises(MeshError, match=r"a mesh must be a trimesh\.Trimesh, a path, or"):
        check(thing)  # type: ignore[arg-type]


def test_empty_trimesh() -> None:
    with pytest.raises(MeshError, match="the mesh has no triangles"):
        check(trimesh.Trimesh())


# --- once per mesh ------------------------------------------------------------------------------


def test_mesh_is_checked_once() -> None:
    mesh = box()
    surface = check(mesh)
    assert check(mesh) is surface
    assert check(mesh.copy()) is not surface


def test_changed_mesh_is_checked_again() -> None:
    mesh = box()
    first = check(mesh)
    mesh.vertices[0] += 1e-9
    second = check(mesh)
    assert second is not first
    np.testing.assert_array_equal(second.vertices, mesh.vertices)
    mesh.vertices[[0, 1]] = mesh.vertices[[1, 0]]
    third = check(mesh)
    assert third is not second
    mesh.faces = mesh.faces[:-1]
    assert third.closed
    assert not check(mesh).closed


def test_checked_mesh_is_not_kept_alive() -> None:
    mesh = box()
    check(mesh)
    key = id(mesh)
    assert key in module._seen
    del mesh
    gc.collect()
    assert key not in module._seen
