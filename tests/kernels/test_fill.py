"""Voxels by winding number and by touch are those of the twin, in a dense grid and in bricks."""

from __future__ import annotations

import math
import os
from typing import TYPE_CHECKING

import numpy as np
import pyopencl.array as cla
import pytest
from hypothesis import given
from numpy.typing import NDArray

from clvox.grid import Shape
from clvox.ops import dense, fill
from clvox.ops.boundary import mark_cells
from clvox.ops.facets import upload_facets
from clvox.ops.fill import Winding
from clvox.ops.layout import Bricks, cell_shape, words_for
from clvox.ops.multilevel import carry, rank_cells
from clvox.ops.sorting import LIST_BYTES
from clvox.reference import fill as twin
from clvox.reference.crossings import AXES
from clvox.reference.multilevel import Model
from tests.kernels.cases import INTERPRETED
from tests.strategies import BOX, FAMILIES, Mesh, adversarial_meshes, closed_meshes, join

if TYPE_CHECKING:
    from clvox.device import Session

BITS = 8
SHAPE: Shape = (9, 8, 7)
RAY = 32
"""Bytes of a budget that is enough for one ray or one crossing."""

RULES: dict[twin.FillRule, Winding] = {"nonzero": Winding.NONZERO, "positive": Winding.POSITIVE}

every_rule = pytest.mark.parametrize("rule", RULES)
meshes = closed_meshes(BITS, SHAPE)


def unpacked(words: cla.Array, count: int) -> NDArray[np.bool_]:
    """Rows of *count* bits."""
    rows = words.get().view(np.uint8)
    return np.unpackbits(rows, axis=-1, count=count, bitorder="little").astype(np.bool_)


def fill_dense(
    session: Session, mesh: Mesh, rule: twin.FillRule, list_bytes: int = LIST_BYTES
) -> NDArray[np.bool_]:
    nx, ny, nz = SHAPE
    facets = upload_facets(session, mesh[0].astype(np.int32), mesh[1])
    voxels = session.zeros((nz, ny, words_for(nx)), np.uint32)
    beyond = session.zeros((nz, words_for(nx)), np.uint32)
    winding = RULES[rule]
    fill.flip_dense(session, facets, BITS, SHAPE, winding, voxels, beyond, list_bytes=list_bytes)
    assert dense.fill(session, voxels, beyond) == 0
    return unpacked(voxels, nx)


def fill_bricks(
    session: Session,
    mesh: Mesh,
    rule: twin.FillRule,
    brick: Shape,
    list_bytes: int = LIST_BYTES,
) -> NDArray[np.bool_]:
    facets = upload_facets(session, mesh[0].astype(np.int32), mesh[1])
    marks = mark_cells(session, facets, BITS, SHAPE, brick)
    cells = rank_cells(session, marks, cell_shape(SHAPE, brick), brick)
    bricks = Bricks.cleared(session, cells)
    winding = RULES[rule]
    fill.flip_bricks(session, facets, BITS, cells, winding, bricks, list_bytes=list_bytes)
    solid = carry(session, cells, bricks, SHAPE)
    assert (solid.odd_rays, solid.disagreements) == (0, 0)
    boundary, inside = (unpacked(words, cells.shape[0]) for words in (marks, solid.inside))
    voxels = unpacked(bricks.voxels, math.prod(brick)).reshape(-1, *brick[::-1])
    return Model(SHAPE, brick, boundary, inside, voxels).to_array()


@every_rule
@given(mesh=meshes)
def test_dense_voxels_are_those_of_the_twin(
    session: Session, rule: twin.FillRule, mesh: Mesh
) -> None:
    expected = twin.fill(*mesh, BITS, SHAPE, rule)
    np.testing.assert_array_equal(fill_dense(session, mesh, rule), expected)


@every_rule
@pytest.mark.parametrize("brick", [(8, 8, 8), (3, 4, 2), (1, 1, 1)])
@given(mesh=meshes)
def test_bricks_are_those_of_the_twin(
    session: Session, rule: twin.FillRule, brick: Shape, mesh: Mesh
) -> None:
    expected = twin.fill(*mesh, BITS, SHAPE, rule)
    np.testing.assert_array_equal(fill_bricks(session, mesh, rule, brick), expected)


@every_rule
@pytest.mark.parametrize("family", FAMILIES)
def test_voxels_are_those_of_the_twin_in_every_family(
    session: Session, rule: twin.FillRule, family: str
) -> None:
    for mesh in adversarial_meshes(21, 1 if INTERPRETED else 3, BITS, SHAPE, families=[family]):
        expected = twin.fill(*mesh, BITS, SHAPE, rule)
        np.testing.assert_array_equal(fill_dense(session, mesh, rule), expected)
        np.testing.assert_array_equal(fill_bricks(session, mesh, rule, (8, 8, 8)), expected)


@every_rule
@pytest.mark.parametrize("list_bytes", [1, 5 * RAY, 20 * RAY])
def test_a_small_budget_changes_nothing(
    session: Session, rule: twin.FillRule, list_bytes: int
) -> None:
    if INTERPRETED and list_bytes < 20 * RAY:
        pytest.skip("hundreds of launches take minutes in an interpreter")
    for mesh in adversarial_meshes(22, 1 if INTERPRETED else 3, BITS, SHAPE, families=["bodies"]):
        for found in (
            fill_dense(session, mesh, rule, list_bytes),
            fill_bricks(session, mesh, rule, (8, 8, 8), list_bytes),
        ):
            np.testing.assert_array_equal(found, twin.fill(*mesh, BITS, SHAPE, rule))


def test_a_small_budget_is_kept(session: Session) -> None:
    if "OCLGRIND_LOG" in os.environ:
        pytest.skip("memory is not counted while Oclgrind watches")
    shape: Shape = (64, 64, 64)
    vertices, faces = solid_box((1, 1, 1), (63, 63, 63))
    facets = upload_facets(session, vertices.astype(np.int32), faces)
    voxels, beyond = session.zeros((64, 64, 2), np.uint32), session.zeros((64, 2), np.uint32)
    for list_bytes, enough in ((LIST_BYTES, False), (1 << 15, True)):
        with session.job(1 << 30) as job:
            fill.flip_dense(
                session, facets, BITS, shape, Winding.NONZERO, voxels, beyond, list_bytes=list_bytes
            )
        # The lists of a few triangles, and what a scan needs, come on top.
        assert (job.peak_nbytes < (1 << 15) + 2048) == enough


def solid_box(low: tuple[int, ...], high: tuple[int, ...], *, inwards: bool = False) -> Mesh:
    """A box between the corners of voxels."""
    ends = (np.array([low, high], dtype=np.int64) << BITS) - (1 << BITS >> 1)
    corners = [[ends[i >> axis & 1][axis] for axis in range(3)] for i in range(8)]
    return np.array(corners), BOX[:, ::-1] if inwards else BOX


def voxels_of(low: tuple[int, ...], high: tuple[int, ...]) -> NDArray[np.bool_]:
    found = np.zeros(SHAPE[::-1], dtype=np.bool_)
    (x0, y0, z0), (x1, y1, z1) = np.maximum(low, 0), high
    found[z0:z1, y0:y1, x0:x1] = True
    return found


ONE, OTHER, INNER = ((0, 1, 1), (5, 5, 5)), ((2, 3, 2), (8, 7, 6)), ((1, 2, 2), (4, 4, 4))
BESIDE, HALF_OUT = ((5, 1, 1), (7, 5, 5)), ((-3, -2, -4), (3, 9, 4))

BODIES = {
    "overlapping": ([ONE, OTHER], [False, False], "one | other", "one | other"),
    "nested": ([ONE, INNER], [False, False], "one | other", "one | other"),
    "a void": ([ONE, INNER], [False, True], "one & ~other", "one & ~other"),
    "side by side": ([ONE, BESIDE], [False, False], "one | other", "one | other"),
    "opposite, overlapping": ([ONE, OTHER], [False, True], "one ^ other", "one & ~other"),
    "both inwards": ([ONE, OTHER], [True, True], "one | other", "none"),
    "beyond the grid": ([HALF_OUT, ONE], [False, False], "one | other", "one | other"),
    "the same twice": ([ONE, ONE], [False, False], "one", "one"),
    "the same back to back": ([ONE, ONE], [False, True], "none", "none"),
}


@pytest.mark.parametrize("case", BODIES)
def test_boxes_have_the_voxels_that_the_rule_says(session: Session, case: str) -> None:
    spans, inwards, *expected = BODIES[case]
    bodies = [solid_box(*span, inwards=turned) for span, turned in zip(spans, inwards, strict=True)]
    one, other = (voxels_of(*span) for span in spans)
    sets = {"one": one, "none": one & ~one, "one | other": one | other, "one ^ other": one ^ other,
            "one & ~other": one & ~other}  # fmt: skip
    for order in (bodies, bodies[::-1]):
        mesh = join(order)
        for rule, name in zip(RULES, expected, strict=True):
            np.testing.assert_array_equal(fill_dense(session, mesh, rule), sets[name])
            np.testing.assert_array_equal(fill_bricks(session, mesh, rule, (3, 4, 2)), sets[name])


@pytest.mark.parametrize("rule", ["parity", "nonzero", "positive"])
@given(mesh=meshes)
def test_the_twin_says_the_same_along_every_axis(rule: twin.FillRule, mesh: Mesh) -> None:
    along_x, along_y, along_z = (twin.fill(*mesh, BITS, SHAPE, rule, axis) for axis in AXES)
    np.testing.assert_array_equal(along_x, along_y)
    np.testing.assert_array_equal(along_x, along_z)


@given(mesh=meshes)
def test_turning_a_mesh_inside_out_negates_its_winding_numbers(mesh: Mesh) -> None:
    vertices, faces = mesh
    there = twin.winding_numbers(vertices, faces, BITS, SHAPE, "y")
    back = twin.winding_numbers(vertices, faces[:, ::-1], BITS, SHAPE, "y")
    np.testing.assert_array_equal(there, -back)
