"""Voxels by generalised winding number are those of the twin, but for rounding about a half."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from clvox.grid import Shape, Triple
from clvox.ops.caps import close_rim
from clvox.ops.facets import upload_facets
from clvox.ops.layout import cell_shape
from clvox.ops.sorting import LIST_BYTES
from clvox.ops.winding import MIXED, Rim, classify_cells, fill_winding, upload_rim
from clvox.reference import fill as reference
from clvox.reference.winding import samples, winding_numbers
from tests.kernels.cases import INTERPRETED, soup
from tests.kernels.test_vote import BITS, LEVELS, SHAPE, every_level, opened, voxels_of
from tests.strategies import BALL, FAMILIES, Mesh, adversarial_meshes, closed_meshes

if TYPE_CHECKING:
    from clvox.device import Session

CLOSE = 1e-4
"""Winding numbers that differ from a half by less may be on either side of it."""

STEPS: list[Triple] = [(1.0, 1.0, 1.0), (0.5, 2.0, 1.0)]


def rim_of(mesh: Mesh) -> NDArray[np.int32]:
    """The edges that are used more often one way, as often as they are; (n, 2)."""
    uses: Counter[tuple[int, int]] = Counter()
    for corners in mesh[1].tolist():
        for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
            uses[a, b] += 1
            uses[b, a] -= 1
    edges = [edge for edge, net in uses.items() for _ in range(net)]
    return np.array(edges, dtype=np.int32).reshape(-1, 2)


def rim_on(session: Session, mesh: Mesh, step: Triple = STEPS[0]) -> Rim:
    """The rim of a mesh, on the device."""
    rim = rim_of(mesh)
    return upload_rim(session, mesh[0].astype(np.int32), rim, close_rim(rim), step)


def with_caps(mesh: Mesh) -> Mesh:
    """The mesh, closed."""
    vertices, faces = mesh
    return vertices, np.concatenate([faces, close_rim(rim_of(mesh))])


def by_winding(
    session: Session,
    mesh: Mesh,
    levels: str,
    step: Triple = STEPS[0],
    list_bytes: int = LIST_BYTES,
) -> NDArray[np.bool_]:
    facets = upload_facets(session, mesh[0].astype(np.int32), mesh[1])
    rim = rim_on(session, mesh, step)
    arrays = fill_winding(session, facets, rim, BITS, SHAPE, LEVELS[levels], list_bytes=list_bytes)
    return voxels_of(session, arrays)


def assert_by_winding(found: NDArray[np.bool_], mesh: Mesh, step: Triple = STEPS[0]) -> None:
    """The voxels found are those of the twin, wherever it is sure."""
    points = samples(SHAPE, BITS)
    winding = winding_numbers(*mesh, points, step)
    sure = (np.abs(winding - 0.5) > CLOSE) & ~on_edges(mesh, points)
    np.testing.assert_array_equal(found.ravel()[sure], winding[sure] > 0.5)


def on_edges(mesh: Mesh, points: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which points lie on an edge: a sum of angles in float64 has no limit there."""
    vertices, faces = mesh
    found = np.zeros(len(points), np.bool_)
    for corners in faces:
        for start, end in zip(vertices[corners], vertices[np.roll(corners, 1)], strict=True):
            across = np.cross(end - start, points - start)
            along = ((points - start) * (points - end)).sum(axis=1)
            found |= ~across.any(axis=1) & (along <= 0)
    return found


@every_level
@given(mesh=closed_meshes(BITS, SHAPE), kept=st.integers(1, 16), step=st.sampled_from(STEPS))
def test_voxels_are_those_of_the_twin(
    session: Session, levels: str, mesh: Mesh, kept: int, step: Triple
) -> None:
    part = opened(mesh, kept)
    assert_by_winding(by_winding(session, part, levels, step), part, step)


@pytest.mark.parametrize("family", FAMILIES)
def test_voxels_are_those_of_the_twin_in_every_family(session: Session, family: str) -> None:
    for mesh in adversarial_meshes(41, 1 if INTERPRETED else 3, BITS, SHAPE, families=[family]):
        part = opened(mesh, 12)
        assert_by_winding(by_winding(session, part, "bricks of 8"), part)


def test_triangles_that_share_nothing_wind_too(session: Session) -> None:
    mesh = soup(42, 4 if INTERPRETED else 40, BITS, SHAPE)
    for levels in ("dense", "small bricks"):
        assert_by_winding(by_winding(session, mesh, levels), mesh)


@given(mesh=closed_meshes(BITS, SHAPE))
def test_on_a_closed_mesh_it_is_the_positive_rule(session: Session, mesh: Mesh) -> None:
    found = by_winding(session, mesh, "small bricks")
    np.testing.assert_array_equal(found, reference.fill(*mesh, BITS, SHAPE, "positive"))


@pytest.mark.parametrize("seed", [4, 67, 80, 99])
def test_a_sum_that_lacks_a_part_of_the_caps_decides_nothing(session: Session, seed: int) -> None:
    """Near concave caps a part of the sum may be far from a half, and on the wrong side of it."""
    shape, levels = (8, 8, 8), ((2, 2, 2), (4, 4, 4))
    part = tubes(seed, shape)
    facets = upload_facets(session, part[0].astype(np.int32), part[1])
    arrays = fill_winding(session, facets, rim_on(session, part), BITS, shape, levels)
    winding = winding_numbers(*part, samples(shape, BITS))
    sure = np.abs(winding - 0.5) > 0.01
    np.testing.assert_array_equal(voxels_of(session, arrays).ravel()[sure], winding[sure] > 0.5)


def tubes(seed: int, shape: Shape) -> Mesh:
    """One to three short tubes, open at ends cut like saddles; a corner amidst the grid."""
    rng = np.random.default_rng(seed)
    vertices, faces = np.empty((0, 3)), np.empty((0, 3), np.int32)
    for _ in range(rng.integers(1, 4)):
        count = int(rng.choice([16, 32, 48]))
        length, (first, last) = rng.uniform(0.5, 4), rng.uniform(0, 0.7, 2)
        turn = rng.uniform(0, 2 * np.pi)
        angle = np.arange(count) * 2 * np.pi / count
        saddles = first * np.cos(2 * angle), length + last * np.cos(2 * angle + turn)
        rings = [np.stack([along, np.cos(angle), np.sin(angle)], axis=1) for along in saddles]
        spots = np.concatenate(rings) * rng.uniform(25, 50)
        axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        axes[:, 0] *= np.linalg.det(axes)
        here = np.arange(count)
        after = (here + 1) % count
        sides = [(here, after, count + here), (after, count + after, count + here)]
        own = np.concatenate([np.stack(corners, axis=1) for corners in sides])
        faces = np.concatenate([faces, (own + len(vertices)).astype(np.int32)])
        vertices = np.concatenate([vertices, spots @ axes.T + rng.uniform(-37.5, 37.5, 3)])
    lattice = np.rint(vertices * (1 << BITS)).astype(np.int64)
    middle = np.array(shape) << (BITS - 1)
    return lattice - lattice[rng.integers(len(lattice))] + middle + rng.integers(
        -128, 128, 3
    ), faces


def test_a_small_budget_changes_nothing(session: Session) -> None:
    mesh = opened(adversarial_meshes(43, 1, BITS, SHAPE, families=["ball"])[0], 12)
    expected = by_winding(session, mesh, "small bricks")
    np.testing.assert_array_equal(by_winding(session, mesh, "small bricks", list_bytes=1), expected)


def test_far_from_the_rim_crossings_alone_decide(session: Session) -> None:
    """Half of all cells and more have a threshold, which is right for each of their voxels."""
    shape, side = (SHAPE, 2) if INTERPRETED else ((48, 48, 48), 4)
    part = ball_with_a_hole(shape)
    rim = rim_on(session, part)
    facets = upload_facets(session, part[0].astype(np.int32), part[1])
    cells, thresholds = classify_cells(session, facets, rim, BITS, shape, (side, side, side))
    found = thresholds.get()
    assert found.shape == cell_shape(shape, (side, side, side))[::-1]
    assert 0 < np.count_nonzero(found == MIXED) < found.size / 2
    assert cells.count < found.size
    signs = reference.winding_numbers(*with_caps(part), BITS, shape, "y").ravel()
    k, j, i = np.indices(shape[::-1]).reshape(3, -1) // side
    threshold = found[k, j, i]
    known = np.flatnonzero(threshold != MIXED)[::7]
    winding = winding_numbers(*part, samples(shape, BITS)[known])
    np.testing.assert_array_equal(signs[known] >= threshold[known], winding > 0.5)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_above_the_rim_jumps_across_the_curtain_are_counted(session: Session, axis: int) -> None:
    """Most voxels there are decided from one sample of their word, by the jumps on the way."""
    shape: Shape = (8, 9, 7) if INTERPRETED else (48, 48, 48)
    part = ball_with_a_hole(shape, axis)
    facets = upload_facets(session, part[0].astype(np.int32), part[1])
    rim = rim_on(session, part, STEPS[1])
    levels = cell_shape(shape, (8, 8, 8)), (8, 8, 8)
    found = voxels_of(session, fill_winding(session, facets, rim, BITS, shape, levels)).ravel()
    some = slice(None, None, 3)
    winding = winding_numbers(*part, samples(shape, BITS)[some], STEPS[1])
    sure = np.abs(winding - 0.5) > CLOSE
    np.testing.assert_array_equal(found[some][sure], winding[sure] > 0.5)


def ball_with_a_hole(shape: Shape, axis: int = 1) -> Mesh:
    """A ball in the middle of a grid, without its lowest triangle along an axis."""
    vertices, faces = BALL
    lowest = vertices[faces].mean(axis=1)[:, axis].argmin()
    return placed(vertices, shape), np.delete(faces, lowest, axis=0)


def placed(vertices: NDArray[np.float64], shape: Shape) -> NDArray[np.int64]:
    """Points of the unit ball in the middle of a grid."""
    return np.rint((vertices * 0.4 + 0.5) * shape * (1 << BITS)).astype(np.int64)


@given(st.lists(st.integers(3, 40), min_size=1, max_size=4), st.integers(0, 2**32 - 1))
def test_caps_close_any_rim(counts: list[int], seed: int) -> None:
    """Lines that meet at vertices too: each edge is run along the other way, and no others are."""
    rng = np.random.default_rng(seed)
    lines = [rng.permutation(45)[:count] for count in counts]
    edges = np.concatenate([np.stack([line, np.roll(line, -1)], axis=1) for line in lines])
    uses: Counter[tuple[int, int]] = Counter(map(tuple, edges.tolist()))
    nets = [(edge, count - uses.get(edge[::-1], 0)) for edge, count in uses.items()]
    rim = np.array([edge for edge, net in nets for _ in range(net)]).reshape(-1, 2)
    caps = close_rim(rim.astype(np.int32))
    left: Counter[tuple[int, int]] = Counter(map(tuple, rim.tolist()))
    for a, b, c in caps.tolist():
        for one, other in ((a, b), (b, c), (c, a)):
            left[one, other] += 1
            left[other, one] -= 1
    for a, b in rim.tolist():
        left[b, a] -= 1
    assert not any(left.values())
    assert len(caps) <= len(rim)


def test_thousands_of_holes_are_the_brute_force_sum(session: Session) -> None:
    """Far ones as dipoles, near ones one by one: no voxel and no whole cell is decided wrongly."""
    shape: Shape = (8, 9, 7) if INTERPRETED else (64, 64, 64)
    ball = trimesh.creation.icosphere(subdivisions=1 if INTERPRETED else 4)
    vertices, faces = placed(ball.vertices, shape), ball.faces.astype(np.int32)
    kept = np.ones(len(faces), np.bool_)
    kept[np.random.default_rng(44).choice(len(faces), len(faces) // 4, replace=False)] = False
    part = vertices, faces[kept]
    levels = cell_shape(shape, (8, 8, 8)), (8, 8, 8)
    facets = upload_facets(session, part[0].astype(np.int32), part[1])
    rim = rim_on(session, part, STEPS[1])
    found = voxels_of(session, fill_winding(session, facets, rim, BITS, shape, levels)).ravel()
    some = np.random.default_rng(45).choice(found.size, min(found.size, 1000), replace=False)
    winding = winding_numbers(*part, samples(shape, BITS)[some], STEPS[1])
    sure = np.abs(winding - 0.5) > CLOSE
    np.testing.assert_array_equal(found[some][sure], winding[sure] > 0.5)
