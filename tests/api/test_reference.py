"""The slow twin holds what the design promises, and says it in more than one way."""

from __future__ import annotations

import math
from collections import Counter
from fractions import Fraction
from typing import TypeAlias

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from clvox.errors import GridError
from clvox.grid import Axis, Shape
from clvox.reference.boundary import cells_of, touched, touching
from clvox.reference.crossings import (
    AXES,
    Corners,
    count_crossings,
    crossing_at,
    crossings,
    fill_parity,
    fixed_depth,
)
from clvox.reference.multilevel import (
    BOUNDARY,
    INSIDE,
    OUTSIDE,
    build,
    classify,
    contains,
    pack_bits,
    pack_bricks,
    prefix_sum,
    rank,
)
from tests.strategies import (
    BOX,
    FAMILIES,
    SOLIDS,
    Mesh,
    adversarial_meshes,
    closed_meshes,
    limits,
)

Tuples: TypeAlias = list[tuple[int, int, int]]

BITS = 3
SHAPE: Shape = (6, 5, 4)
SIZE: Shape = (2, 3, 2)
meshes = closed_meshes(BITS, SHAPE)

every_axis = pytest.mark.parametrize("axis", AXES)
every_family = pytest.mark.parametrize("family", FAMILIES)


def fill(mesh: Mesh, axis: Axis = "y", shape: Shape = SHAPE) -> NDArray[np.bool_]:
    return fill_parity(*mesh, BITS, shape, axis)


def rays(axis: Axis) -> list[tuple[int, int]]:
    nu, nv = (n for a, n in enumerate(SHAPE) if a != AXES[axis])
    return [(u, v) for v in range(nv) for u in range(nu)]


def corners_of(mesh: Mesh) -> list[Corners]:
    vertices, faces = mesh
    return [
        (tuple(a), tuple(b), tuple(c)) for a, b, c in (vertices[face].tolist() for face in faces)
    ]


# The meshes themselves


@every_family
def test_edges_are_used_equally_often_both_ways(family: str) -> None:
    for vertices, faces in adversarial_meshes(3, 20, families=[family]):
        edges = Counter((face[i], face[(i + 1) % 3]) for face in faces.tolist() for i in range(3))
        assert all(edges[b, a] == count for (a, b), count in edges.items())
        assert faces.min() == 0
        assert faces.max() == len(vertices) - 1


@pytest.mark.parametrize(("bits", "shape"), [(8, (9, 8, 7)), (14, (1024, 3, 1000)), (7, (4, 4, 4))])
def test_meshes_keep_within_the_span_of_the_lattice(bits: int, shape: Shape) -> None:
    ends = np.array([limits(bits, count) for count in shape])
    assert (ends[:, 1] - ends[:, 0] <= 2**24).all()
    assert (ends[:, 0] <= -(2 ** (bits - 1))).all()
    assert (ends[:, 1] >= np.array(shape) * 2**bits - 2 ** (bits - 1)).all()
    for vertices, _ in adversarial_meshes(4, 60, bits, shape):
        assert (vertices >= ends[:, 0]).all()
        assert (vertices <= ends[:, 1]).all()


def test_a_seed_gives_the_same_meshes_and_another_gives_others() -> None:
    def digest(seed: int) -> list[bytes]:
        return [v.tobytes() + f.tobytes() for v, f in adversarial_meshes(seed, 20)]

    assert digest(5) == digest(5)
    assert digest(5) != digest(6)


# Crossings


@every_axis
@given(mesh=meshes)
def test_rays_enter_a_closed_mesh_as_often_as_they_leave(axis: Axis, mesh: Mesh) -> None:
    assert not (count_crossings(*mesh, BITS, SHAPE, axis) % 2).any()
    balance: Counter[tuple[int, int]] = Counter()
    for crossing in crossings(*mesh, BITS, SHAPE, axis):
        balance[crossing.u, crossing.v] += crossing.sign
    assert not any(balance.values())


@every_axis
@given(mesh=meshes)
def test_counts_are_those_of_the_list(axis: Axis, mesh: Mesh) -> None:
    counts = count_crossings(*mesh, BITS, SHAPE, axis)
    listed = Counter((c.u, c.v) for c in crossings(*mesh, BITS, SHAPE, axis))
    assert {(u, v): counts[v, u] for u, v in rays(axis) if counts[v, u]} == listed


@given(mesh=meshes)
def test_rays_along_each_axis_give_the_same_voxels(mesh: Mesh) -> None:
    along_y = fill(mesh, "y")
    np.testing.assert_array_equal(fill(mesh, "x"), along_y)
    np.testing.assert_array_equal(fill(mesh, "z"), along_y)


@every_family
def test_rays_along_each_axis_agree_on_the_widest_meshes(family: str) -> None:
    """On a lattice of many bits, where int64 does not do for the largest triangles."""
    shape: Shape = (20, 9, 3)
    for vertices, faces in adversarial_meshes(7, 6, 14, shape, families=[family]):
        along_y = fill_parity(vertices, faces, 14, shape, "y")
        np.testing.assert_array_equal(fill_parity(vertices, faces, 14, shape, "x"), along_y)
        np.testing.assert_array_equal(fill_parity(vertices, faces, 14, shape, "z"), along_y)


@given(mesh=closed_meshes(BITS, SHAPE, ["box"]))
def test_a_box_owns_its_lower_faces_and_not_its_upper_ones(mesh: Mesh) -> None:
    """A sample lies a little above its centre, so that a face on the centre is below it."""
    low, high = mesh[0].min(axis=0), mesh[0].max(axis=0)
    x, y, z = (
        (np.arange(n) * 2**BITS >= low[a]) & (np.arange(n) * 2**BITS < high[a])
        for a, n in enumerate(SHAPE)
    )
    expected = z[:, None, None] & y[:, None] & x
    for axis in AXES:
        np.testing.assert_array_equal(fill(mesh, axis), expected)


def test_a_box_between_centres_has_the_voxels_counted_by_hand() -> None:
    voxel = 2**BITS
    low, high = np.array([1, 0, 2]) * voxel, np.array([4, 2, 3]) * voxel
    vertices = np.array([[(low, high)[i >> a & 1][a] for a in range(3)] for i in range(8)])
    expected = np.zeros((4, 5, 6), dtype=np.bool_)
    expected[2:3, 0:2, 1:4] = True
    np.testing.assert_array_equal(fill((vertices, BOX)), expected)
    found = crossings(vertices, BOX, BITS, SHAPE, "x")
    assert {(c.u, c.v) for c in found} == {(0, 2), (1, 2)}
    assert Counter((c.depth, c.slot, c.sign) for c in found) == {(1, 1, +1): 2, (4, 4, -1): 2}


def moved_crossing(corners: Corners, u: int, v: int, axis: Axis) -> tuple[int, int] | None:
    """Slot and sign with a number for e, small enough for coordinates as small as these."""
    e = Fraction(1, 10**9)
    sample = [e, e**2, e**3]
    w_axis = AXES[axis]
    u_axis, v_axis = (a for a in range(3) if a != w_axis)
    sample[u_axis] += u * 2**BITS
    sample[v_axis] += v * 2**BITS
    a, b, c = np.array(corners, dtype=object)[:, [u_axis, v_axis]] - [
        sample[u_axis],
        sample[v_axis],
    ]
    weights = [p[0] * q[1] - p[1] * q[0] for p, q in ((b, c), (c, a), (a, b))]
    area = sum(weights)
    if area == 0 or any(weight / area <= 0 for weight in weights):
        return None
    depth = sum(p[w_axis] * weight / area for p, weight in zip(corners, weights, strict=True))
    slot = math.floor((depth - sample[w_axis]) / 2**BITS) + 1
    # (u, v, w) is a right-handed frame for x and z only.
    rises = area < 0 if axis == "y" else area > 0
    return slot, -1 if rises else +1


@every_axis
@given(mesh=closed_meshes(BITS, (3, 4, 3), SOLIDS))
def test_crossings_are_those_of_samples_really_moved(axis: Axis, mesh: Mesh) -> None:
    found = {(c.triangle, c.u, c.v): c for c in crossings(*mesh, BITS, SHAPE, axis)}
    for triangle, corners in enumerate(corners_of(mesh)[:12]):
        for u, v in rays(axis):
            crossing = found.get((triangle, u, v))
            summary = crossing and (crossing.slot, crossing.sign)
            assert summary == moved_crossing(corners, u, v, axis)


@every_axis
@every_family
def test_arrays_of_rays_say_what_the_definition_says(axis: Axis, family: str) -> None:
    for mesh in adversarial_meshes(11, 4, 10, SHAPE, families=[family]):
        found = {(c.triangle, c.u, c.v): c for c in crossings(*mesh, 10, SHAPE, axis)}
        for triangle, corners in enumerate(corners_of(mesh)):
            for u, v in rays(axis):
                crossing = found.get((triangle, u, v))
                summary = crossing and (crossing.depth, crossing.slot, crossing.sign)
                assert summary == crossing_at(corners, u, v, 10, axis)


@every_axis
@pytest.mark.parametrize("fraction_bits", [0, 1, 18])
@given(mesh=meshes)
def test_stored_depths_are_rounded_up_to_the_slot(
    axis: Axis, fraction_bits: int, mesh: Mesh
) -> None:
    unit = Fraction(1, 2**fraction_bits)
    for crossing in crossings(*mesh, BITS, SHAPE, axis):
        stored = fixed_depth(crossing, fraction_bits) * unit
        assert 0 <= stored - crossing.depth <= unit
        assert math.ceil(stored) == crossing.slot


@given(mesh=meshes, shift=st.tuples(*[st.integers(-2, 2)] * 3))
def test_a_mesh_moved_by_voxels_moves_its_voxels(mesh: Mesh, shift: tuple[int, ...]) -> None:
    vertices, faces = mesh
    # A grid four voxels larger holds both places.
    larger: Shape = (SHAPE[0] + 4, SHAPE[1] + 4, SHAPE[2] + 4)
    whole = fill((vertices + 2 * 2**BITS, faces), "y", larger)
    x, y, z = (2 - by for by in shift)
    expected = whole[z : z + SHAPE[2], y : y + SHAPE[1], x : x + SHAPE[0]]
    np.testing.assert_array_equal(fill((vertices + np.array(shift) * 2**BITS, faces)), expected)


@given(mesh=meshes)
def test_the_order_of_the_triangles_changes_nothing(mesh: Mesh) -> None:
    vertices, faces = mesh
    turned = np.roll(faces[::-1], 1, axis=1)
    np.testing.assert_array_equal(fill((vertices, turned)), fill(mesh))
    last = len(faces) - 1
    first = {c._replace(triangle=last - c.triangle) for c in crossings(*mesh, BITS, SHAPE, "z")}
    assert set(crossings(vertices, turned, BITS, SHAPE, "z")) == first
    np.testing.assert_array_equal(
        touched(vertices, turned, BITS, SHAPE, SIZE), touched(*mesh, BITS, SHAPE, SIZE)
    )


# Touched cells


STEP = 2**BITS
FACE = STEP // 2
"""The upper face of voxel 0: its centre is at 0."""


@pytest.mark.parametrize(
    ("triangle", "cells"),
    [
        pytest.param([(1, 1, 1), (2, 1, 1), (1, 2, 2)], [(0, 0, 0)], id="within"),
        pytest.param(
            [(FACE, 1, 1), (FACE, 2, 1), (FACE, 1, 2)], [(0, 0, 0), (1, 0, 0)], id="on a face"
        ),
        pytest.param(
            [(FACE - 1, 1, 1), (FACE - 1, 2, 1), (FACE - 1, 1, 2)], [(0, 0, 0)], id="a step short"
        ),
        pytest.param(
            [(FACE + 1, 1, 1), (FACE + 1, 2, 1), (FACE + 1, 1, 2)], [(1, 0, 0)], id="a step beyond"
        ),
        pytest.param(
            [(FACE, FACE, 0), (FACE, FACE, 1), (FACE, FACE, 2)],
            [(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)],
            id="along an edge, without area",
        ),
        pytest.param(
            [(FACE,) * 3] * 3,
            [(i, j, k) for i in (0, 1) for j in (0, 1) for k in (0, 1)],
            id="one point, at a corner",
        ),
        pytest.param(
            [(FACE, FACE, FACE), (STEP, STEP, STEP), (STEP, STEP, STEP - 1)],
            [(i, j, k) for i in (0, 1) for j in (0, 1) for k in (0, 1)],
            id="its tip at a corner",
        ),
        pytest.param(
            # x + y + z = 3 FACE cuts the boxes of all eight voxels around the corner (FACE,) * 3,
            # and touches voxel 0 and voxel (1, 1, 1) in that very corner only.
            [(3 * FACE, 0, 0), (0, 3 * FACE, 0), (0, 0, 3 * FACE)],
            [(i, j, k) for i in (0, 1) for j in (0, 1) for k in (0, 1)],
            id="its middle at a corner",
        ),
        pytest.param(
            [(3 * FACE + 1, 0, 0), (0, 3 * FACE + 1, 0), (0, 0, 3 * FACE + 1)],
            [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (1, 0, 1), (0, 1, 1), (1, 1, 1)],
            id="its middle a step beyond a corner",
        ),
        pytest.param([(-FACE - 1, 0, 0), (-FACE - 1, 1, 0), (-STEP, 0, 1)], [], id="before all"),
        pytest.param([(-FACE, 0, 0), (-FACE, 1, 0), (-STEP, 0, 1)], [(0, 0, 0)], id="at the first"),
    ],
)
def test_touched_cells_of_a_triangle(triangle: Tuples, cells: Tuples) -> None:
    marked = touched(triangle, [[0, 1, 2]], BITS, (2, 2, 2), (1, 1, 1))
    assert {(i, j, k) for k, j, i in np.argwhere(marked).tolist()} == set(cells)


def test_cells_reach_beyond_the_grid() -> None:
    assert cells_of((5, 4, 1), (2, 4, 3)) == (3, 1, 1)
    # Voxel 6 is in no grid of 5 voxels, and its place is in the last cell of 4 nevertheless.
    speck = np.full((3, 3), 6) * [STEP, 0, 0]
    marked = touched(speck, [[0, 1, 2]], BITS, (5, 1, 1), (4, 1, 1))
    np.testing.assert_array_equal(marked, [[[False, True]]])


@given(mesh=meshes)
def test_a_cell_is_touched_if_one_of_its_voxels_is(mesh: Mesh) -> None:
    counts = cells_of(SHAPE, SIZE)
    padded = counts[0] * SIZE[0], counts[1] * SIZE[1], counts[2] * SIZE[2]
    voxels = touched(*mesh, BITS, padded, (1, 1, 1))
    cells = voxels.reshape(counts[2], SIZE[2], counts[1], SIZE[1], counts[0], SIZE[0])
    np.testing.assert_array_equal(touched(*mesh, BITS, SHAPE, SIZE), cells.any(axis=(1, 3, 5)))


@given(mesh=meshes, axis=st.integers(0, 2))
def test_the_mirror_image_touches_the_mirrored_cells(mesh: Mesh, axis: int) -> None:
    vertices, faces = mesh
    mirrored = vertices.copy()
    mirrored[:, axis] = (SHAPE[axis] - 1) * STEP - vertices[:, axis]
    marked = touched(mirrored, faces, BITS, SHAPE, (1, 1, 1))
    np.testing.assert_array_equal(
        np.flip(marked, 2 - axis), touched(vertices, faces, BITS, SHAPE, (1, 1, 1))
    )


@given(mesh=meshes)
def test_the_voxel_before_or_after_a_crossing_is_touched(mesh: Mesh) -> None:
    """Every point of the surface lies in a touched voxel: that of a crossing by its depth."""
    pairs = set(touching(*mesh, BITS, SHAPE, (1, 1, 1)))
    for crossing in crossings(*mesh, BITS, SHAPE, "z"):
        k = math.floor(crossing.depth + Fraction(1, 2))
        if 0 <= k < SHAPE[2]:
            assert ((crossing.u, crossing.v, k), crossing.triangle) in pairs


# Models


@given(mesh=meshes, size=st.sampled_from([SIZE, (1, 1, 1), (4, 4, 4), (3, 2, 1)]))
def test_a_model_holds_the_voxels_of_the_fill(mesh: Mesh, size: Shape) -> None:
    """`build` itself raises if an untouched cell is mixed."""
    model = build(*mesh, BITS, SHAPE, (cells_of(SHAPE, size), size))
    voxels = fill(mesh, "x")
    np.testing.assert_array_equal(model.to_array(), voxels)
    assert not (model.boundary & model.inside).any()
    assert len(model.bricks) == model.boundary.sum()
    np.testing.assert_array_equal(model.states == BOUNDARY, model.boundary)
    np.testing.assert_array_equal(model.states == INSIDE, model.inside)

    nx, ny, nz = SHAPE
    z, y, x = (index.ravel() for index in np.mgrid[-1 : nz + 1, -1 : ny + 1, -1 : nx + 1])
    indices = np.stack([x, y, z], axis=1)
    expected = np.pad(voxels, 1).ravel()
    np.testing.assert_array_equal(contains(model, indices), expected)

    edge = touched(*mesh, BITS, SHAPE, (1, 1, 1))
    states = np.where(np.pad(edge, 1).ravel(), BOUNDARY, np.where(expected, INSIDE, OUTSIDE))
    np.testing.assert_array_equal(classify(model, edge, indices), states)


def test_a_model_numbers_its_bricks_along_x_first_and_clears_what_is_beyond() -> None:
    # From within voxel 0 to within voxel 4 of 5, along x; the last cell holds voxel 4 only.
    ends = [(1, 4 * STEP + 1), (-FACE - 1, STEP), (-FACE - 1, STEP)]
    vertices = np.array([[ends[a][i >> a & 1] for a in range(3)] for i in range(8)])
    model = build(vertices, BOX, BITS, (5, 1, 1), ((3, 1, 1), (2, 1, 1)))
    np.testing.assert_array_equal(model.states, [[[BOUNDARY, INSIDE, BOUNDARY]]])
    np.testing.assert_array_equal(model.bricks, [[[[False, True]]], [[[True, False]]]])
    # Now beyond the grid's end: voxel 5, which is padding, would be in.
    longer = vertices + np.where(vertices == 4 * STEP + 1, STEP, 0)
    model = build(longer, BOX, BITS, (5, 1, 1), ((3, 1, 1), (2, 1, 1)))
    np.testing.assert_array_equal(model.bricks, [[[[False, True]]], [[[True, False]]]])


def test_an_open_mesh_leaves_a_cell_mixed() -> None:
    low, high = np.full(3, STEP // 4), np.full(3, 2 * STEP)
    vertices = np.array([[(low, high)[i >> a & 1][a] for a in range(3)] for i in range(8)])
    above_y = {2, 3, 6, 7}
    lidless = np.array([face for face in BOX.tolist() if not above_y.issuperset(face)])
    with pytest.raises(AssertionError, match="neither in nor out"):
        build(vertices, lidless, BITS, (8, 8, 8), ((2, 2, 2), (4, 4, 4)))


def test_levels_that_do_not_fit_the_grid_are_refused() -> None:
    with pytest.raises(GridError, match=r"the first must be \(3, 2, 2\)"):
        build(np.zeros((3, 3), int), [[0, 1, 2]], BITS, SHAPE, ((3, 2, 1), SIZE))


# Bits and sums


def test_bits_are_packed_from_the_lowest_and_rows_padded_to_words() -> None:
    row = np.zeros((2, 40), dtype=np.bool_)
    row[0, [0, 31, 33]] = True
    row[1, 39] = True
    words = pack_bits(row)
    assert words.dtype == np.uint32
    np.testing.assert_array_equal(words, [[0x80000001, 0b10], [0, 0x80]])


@pytest.mark.parametrize("count", [0, 1, 31, 32, 33, 64, 100])
def test_packing_loses_nothing(count: int) -> None:
    bits = np.random.default_rng(count).random((3, count)) < 0.5
    words = pack_bits(bits)
    assert words.shape == (3, (count + 31) // 32)
    unpacked = np.unpackbits(words.astype("<u4").view(np.uint8), axis=1, bitorder="little")
    np.testing.assert_array_equal(unpacked[:, :count], bits)
    assert not unpacked[:, count:].any()


def test_a_brick_is_packed_along_x_first_in_words_of_its_own() -> None:
    bricks = np.zeros((2, 4, 3, 5), dtype=np.bool_)
    bricks[0, 0, 0, 1] = True
    bricks[0, 0, 1, 0] = True
    bricks[1, 3, 2, 4] = True
    np.testing.assert_array_equal(pack_bricks(bricks), [[1 << 1 | 1 << 5, 0], [0, 1 << 59 - 32]])
    assert pack_bricks(bricks[:0]).shape == (0, 2)


@pytest.mark.parametrize("count", [0, 1, 255, 256, 257, 1000])
def test_rank_is_the_number_of_bits_before_each_block(count: int) -> None:
    bits = np.random.default_rng(count).random(count) < 0.3
    blocks = rank(pack_bits(bits))
    assert blocks.dtype == np.uint32
    assert blocks.tolist() == [int(bits[:start].sum()) for start in range(0, count, 256)]


def test_sums_are_exclusive_and_pass_32_bits() -> None:
    sums, total = prefix_sum(np.array([3, 0, 2**32 - 1, 2**32 - 1], dtype=np.uint32))
    assert sums.tolist() == [0, 3, 3, 2**32 + 2]
    assert total == 2**33 + 1
    sums, total = prefix_sum([])
    assert (len(sums), total) == (0, 0)
