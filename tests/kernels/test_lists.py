"""Each ray's crossings are listed in order, and are those of the twin, bit for bit."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pyopencl as cl
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from clvox.device import session as sessions
from clvox.device.source import read_source
from clvox.grid import Axis, Shape
from clvox.ops import lists
from clvox.ops.bins import Binner, Bins
from clvox.ops.crossings import Window, fraction_bits
from clvox.ops.facets import FacetChunks, Facets, upload_facets
from clvox.ops.lists import CrossingLists, list_crossings
from clvox.ops.sorting import sort_crossings, sort_rows
from clvox.reference import lists as twin
from clvox.reference.crossings import AXES, crossings
from tests.kernels.cases import INTERPRETED, build, meshes_for, some
from tests.strategies import BOX, FAMILIES, Mesh, adversarial_meshes, closed_meshes, join

if TYPE_CHECKING:
    from clvox.device import Session

SHAPE: Shape = (6, 5, 4)
MESHES = {bits: closed_meshes(bits, SHAPE) for bits in (7, 14)}

every_axis = pytest.mark.parametrize("axis", AXES)


def upload(session: Session, mesh: Mesh) -> Facets:
    return upload_facets(session, mesh[0].astype(np.int32), mesh[1])


def box(low: tuple[int, ...], high: tuple[int, ...], bits: int) -> Mesh:
    """A box between two voxel centres."""
    ends = np.array([low, high], dtype=np.int64) << bits
    corners = [[ends[i >> axis & 1][axis] for axis in range(3)] for i in range(8)]
    return np.array(corners), BOX


def assert_same(found: CrossingLists, expected: twin.Lists) -> None:
    np.testing.assert_array_equal(found.offsets.get(), expected.offsets)
    np.testing.assert_array_equal(found.depth.get(), expected.depth)
    np.testing.assert_array_equal(found.triangle(), expected.triangle)
    np.testing.assert_array_equal(found.sign(), expected.sign)


@every_axis
@pytest.mark.parametrize("bits", [7, 14])
@given(data=st.data())
def test_lists_are_those_of_the_twin(
    session: Session, axis: Axis, bits: int, data: st.DataObject
) -> None:
    mesh = data.draw(MESHES[bits])
    found = list_crossings(session, upload(session, mesh), bits, SHAPE, AXES[axis])
    assert_same(found, twin.list_crossings(*mesh, bits, SHAPE, axis, fraction_bits(bits)))


@every_axis
@pytest.mark.parametrize("family", FAMILIES)
def test_lists_are_those_of_the_twin_on_every_lattice(
    session: Session, axis: Axis, family: str
) -> None:
    for bits in (11,) if INTERPRETED else (7, 10, 11, 14):
        (mesh,) = adversarial_meshes(bits, 1, bits, SHAPE, families=[family])
        found = list_crossings(session, upload(session, mesh), bits, SHAPE, AXES[axis])
        assert_same(found, twin.list_crossings(*mesh, bits, SHAPE, axis, found.fraction_bits))


def test_depths_of_the_widest_meshes_keep_18_places_up_to_8192_voxels() -> None:
    assert [fraction_bits(bits) for bits in (7, 10, 11, 14)] == [14, 17, 18, 18]


@every_axis
def test_depths_rounded_up_to_voxels_are_the_slots(session: Session, axis: Axis) -> None:
    for mesh in adversarial_meshes(5, 3 if INTERPRETED else 15, 9, SHAPE):
        found = list_crossings(session, upload(session, mesh), 9, SHAPE, AXES[axis])
        slots = -(-found.depth.get().astype(np.int64) >> found.fraction_bits)
        true = {(c.triangle, c.u, c.v): c.slot for c in crossings(*mesh, 9, SHAPE, axis)}
        width = next(count for a, count in enumerate(SHAPE) if a != AXES[axis])
        rays = np.repeat(
            np.arange(found.offsets.size - 1), np.diff(found.offsets.get()).astype(int)
        )
        keys = zip(found.triangle().tolist(), rays % width, rays // width, strict=True)
        assert [true.pop((t, int(u), int(v))) for t, u, v in keys] == slots.tolist()
        assert not true


def test_touching_boxes_meet_at_one_depth_in_the_order_of_their_triangles(session: Session) -> None:
    low, high = box((-1, -1, -1), (9, 2, 9), 8), box((-1, 2, -1), (9, 4, 9), 8)
    for first, second in ((low, high), (high, low)):
        mesh = join([first, second])
        found = list_crossings(session, upload(session, mesh), 8, (2, 5, 2), 1)
        depth, sign = found.depth.get().reshape(4, 4), found.sign().reshape(4, 4)
        # A centre on a lower face is in, one on an upper face is out: the slot is the centre's own.
        np.testing.assert_array_equal(depth, [[-1 << 15, 2 << 15, 2 << 15, 4 << 15]] * 4)
        inner = [-1, 1] if first is low else [1, -1]
        np.testing.assert_array_equal(sign, [[1, *inner, -1]] * 4)


@every_axis
@pytest.mark.parametrize(
    "group, tile, direct, short",
    [(1, (3, 3), 16, 2), (1, (4, 2), 1, 32), (4, (2, 3), 1, 32), (64, (8, 8), 2, 1)],
)
def test_tiles_groups_and_short_rows_change_nothing(
    session: Session, axis: Axis, group: int, tile: tuple[int, int], direct: int, short: int
) -> None:
    for mesh in meshes_for(8, 8, 9, SHAPE):
        facets = upload(session, mesh)
        expected = twin.list_crossings(*mesh, 9, SHAPE, axis, 16)
        found = list_crossings(
            session, facets, 9, SHAPE, AXES[axis],
            direct=direct, tile=tile, short=short, group=group,
        )  # fmt: skip
        assert_same(found, expected)


@every_axis
@pytest.mark.parametrize("bits", [9, 11])
def test_triangles_of_many_rays(session: Session, axis: Axis, bits: int) -> None:
    shape = (11, 9, 10) if INTERPRETED else (43, 21, 37)
    for mesh in adversarial_meshes(bits, 2, bits, shape, families=["tetrahedron", "ball"]):
        # Deep ones, too, for which a division does not do.
        for depth in (1, 40):
            mesh[0][:, AXES[axis]] *= depth
            facets = upload(session, mesh)
            found = list_crossings(session, facets, bits, shape, AXES[axis], tile=(32, 20))
            assert found.count
            assert_same(found, twin.list_crossings(*mesh, bits, shape, axis, found.fraction_bits))


DIVIDE = """
__kernel void divide(
    const __global ulong *areas, const __global ulong *most, const __global ulong *n,
    const __global uint *ties, __global uint *found)
{
    const size_t at = get_global_id(0);
    found[at] = quotient_up(divisor_of(areas[at], most[at]), n[at], ties[at]);
}
"""


def test_quotients_are_exact(session: Session) -> None:
    rng = np.random.default_rng(5)
    cases = []
    for _ in range(some(20_000, 64)):
        area = 1 + int(rng.integers(0, 1 << int(rng.integers(0, 46))))
        area = (1 << area.bit_length()) - 1 if rng.random() < 0.1 else area
        highest = int(rng.integers(0, 1 << int(rng.integers(0, 29))))
        highest = min(highest, (1 << 62) // area)
        whole = int(rng.integers(0, highest + 1)) if rng.random() < 0.8 else highest
        n = whole * area + int(rng.choice([-1, 0, 1, int(rng.integers(0, area))]))
        n = min(max(n, 0), highest * area)
        cases.append((area, area * (highest + 2), n, int(rng.integers(0, 2))))
    areas, most, numbers, ties = zip(*cases, strict=True)
    expected = [-(-x // a) + (tie if x % a == 0 else 0) for a, _, x, tie in cases]
    columns = [session.upload(np.array(column, np.uint64)) for column in (areas, most, numbers)]
    found = session.empty(len(cases), np.uint32)
    kernel = build(session, read_source("lists/divide.h") + DIVIDE, "divide")
    session.run(
        kernel, len(cases), *columns, session.upload(np.array(ties, np.uint32)), found, group=1
    )
    np.testing.assert_array_equal(found.get(), expected)


def test_many_triangles_to_a_tile_are_cut_into_launches(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    launches: dict[str, list[int]] = {"count_tile": [], "write_tile": []}
    enqueue = cl.enqueue_nd_range_kernel

    def note(queue: Any, kernel: cl.Kernel, items: tuple[int, ...], *rest: Any) -> Any:
        launches.get(kernel.function_name, []).append(items[0])
        return enqueue(queue, kernel, items, *rest)

    mesh = join([box((-1, -1, at), (6, 5, at + 1), 8) for at in range(-1, 4)] * 3)
    facets = upload(session, mesh)
    expected = twin.list_crossings(*mesh, 8, SHAPE, "z", fraction_bits(8))
    monkeypatch.setattr(cl, "enqueue_nd_range_kernel", note)
    monkeypatch.setattr(sessions, "STEPS_PER_LAUNCH", 120)
    monkeypatch.setattr(sessions, "ITEMS_PER_LAUNCH", 64)
    monkeypatch.setattr(lists, "LEAST_TILES", 1)
    assert_same(list_crossings(session, facets, 8, SHAPE, 2, tile=(1, 1), group=4), expected)
    # Thirty tiles: sixteen are enough to fill a device, and more would have too many steps.
    assert launches == {"count_tile": [64, 56], "write_tile": [64, 56]}


@every_axis
@pytest.mark.parametrize("most, room", [(None, 1), (None, 250), (3, 1), (3, 200), (10**6, 10**6)])
def test_parts_and_windows_change_nothing(
    session: Session, axis: Axis, most: int | None, room: int
) -> None:
    """A mesh that is sent in parts, and rays that are done window by window."""
    for mesh in meshes_for(8, 6, 9, SHAPE):
        corners, faces = mesh[0].astype(np.int32), mesh[1]
        facets = upload(session, mesh) if most is None else FacetChunks(corners, faces, most)
        expected = twin.list_crossings(*mesh, 9, SHAPE, axis, 16)
        for group in (1, 4):
            found = list_crossings(
                session, facets, 9, SHAPE, AXES[axis], tile=(2, 2), group=group, room=room
            )
            assert_same(found, expected)


def test_little_room_cuts_windows_between_tiles(session: Session) -> None:
    """Each has room for its bins or is one tile; and each part of the mesh comes once."""
    (mesh,) = adversarial_meshes(8, 1, 9, SHAPE, families=["crumpled"])
    corners, faces = mesh[0].astype(np.int32), mesh[1]
    whole = Window.whole(SHAPE, 2)
    chunks = FacetChunks(corners, faces, 5)
    for room, few in ((10**6, 1), (220, 2), (1, 9)):
        met: list[tuple[Window, bool, bool]] = []
        numbers: dict[Window, list[int]] = {}

        def note(bins: Bins) -> None:
            met.append((bins.window, bins.first, bins.last))  # noqa: B023
            assert bins.numbers is not None
            numbers.setdefault(bins.window, []).extend(bins.numbers.get().tolist())  # noqa: B023
            tiles = bins.starts.size - 1
            assert tiles == 1 or 12 * (tiles + 1) + 4 * bins.triangles.size <= room  # noqa: B023

        Binner(session, chunks, 9, 2, (2, 2), room=room).visit(whole, note)
        windows = {window for window, _, _ in met}
        assert len(windows) >= few
        assert sum(window.rays for window in windows) == whole.rays
        assert sum(first for _, first, _ in met) == sum(last for *_, last in met) == len(windows)
        assert all(window.first_u % 2 == window.first_v % 2 == 0 for window in windows)
        assert all(found == sorted(set(found)) for found in numbers.values())


@every_axis
@pytest.mark.parametrize("shape", [(1, 1, 1), (33, 2, 40), (31, 65, 3), (2, 32, 64)], ids=str)
def test_tiles_end_where_the_grid_does(session: Session, axis: Axis, shape: Shape) -> None:
    for mesh in adversarial_meshes(9, 2 if INTERPRETED else 6, 8, shape, ["ball", "crumpled"]):
        found = list_crossings(session, upload(session, mesh), 8, shape, AXES[axis])
        assert_same(found, twin.list_crossings(*mesh, 8, shape, axis, fraction_bits(8)))


@every_axis
def test_flat_and_steep_triangles_of_every_size_are_listed(session: Session, axis: Axis) -> None:
    """At the limits up to which edge functions fit 32 bits, and depths one division."""
    w = AXES[axis]
    rng = np.random.default_rng(w)
    for _ in range(some(40)):
        # Around all rays, of any area, and up to all of the lattice in depth.
        radius, turn = np.exp2(rng.uniform(12, 22)), rng.uniform(0, 2 * np.pi)
        angle = turn + np.arange(3) * (2 * np.pi / 3)
        depth = rng.uniform(-(2**23), 2**23, 3)
        places = [radius * np.cos(angle), radius * np.sin(angle), depth]
        spots = np.empty((3, 3), np.int64)
        spots[:, [(w + 1) % 3, (w + 2) % 3, w]] = np.rint(places).T
        mesh = spots, np.array([[0, 1, 2]], np.int32)
        found = list_crossings(session, upload(session, mesh), 7, SHAPE, w)
        assert_same(found, twin.list_crossings(*mesh, 7, SHAPE, axis, 14))


def test_windows_have_the_crossings_of_their_rays(session: Session) -> None:
    for mesh in adversarial_meshes(8, 3 if INTERPRETED else 15, 9, SHAPE):
        facets = upload(session, mesh)
        expected = twin.list_crossings(*mesh, 9, SHAPE, "y", 16)
        for window in (Window(1, 2, 3, 6), Window(3, 0, 4, 1)):
            rows = sort_crossings(session, facets, 9, 1, window)
            assert rows is not None
            keys = rows.crossings.get()
            inside = [u * 6 + v for u in range(window.first_u, window.stop_u)
                      for v in range(window.first_v, window.stop_v)]  # fmt: skip
            spans = [expected.offsets[ray : ray + 2].astype(int) for ray in inside]
            places = [at for first, last in spans for at in range(first, last)]
            np.testing.assert_array_equal(keys >> 32, expected.depth[places])
            np.testing.assert_array_equal(keys >> 1 & 0x7FFFFFFF, expected.triangle[places])


def test_more_crossings_than_asked_for_are_not_listed(session: Session) -> None:
    facets = upload(session, box((-1, -1, -1), (9, 2, 9), 8))
    window = Window.whole((2, 5, 2), 1)
    assert sort_crossings(session, facets, 8, 1, window, 7) is None
    assert sort_crossings(session, facets, 8, 1, window, 8) is not None


def test_a_mesh_beside_the_grid_has_empty_lists(session: Session) -> None:
    facets = upload(session, box((20, 20, 20), (22, 22, 22), 8))
    found = list_crossings(session, facets, 8, SHAPE, 2)
    assert found.count == 0
    assert not found.offsets.get().any()
    assert found.offsets.size == 6 * 5 + 1


def test_a_long_row_of_a_mesh_is_in_order(session: Session) -> None:
    """A hundred sheets in no order, pierced by few rays."""
    order = np.random.default_rng(4).permutation(100).tolist()
    sheets = [box((-1, at, -1), (3, at + 1, 3), 7) for at in order]
    mesh = join(sheets)
    shape: Shape = (2, 101, 1)
    found = list_crossings(session, upload(session, mesh), 7, shape, 1, short=32)
    assert_same(found, twin.list_crossings(*mesh, 7, shape, "y", 14))
    # Two rays, one after the other.
    found = list_crossings(session, upload(session, mesh), 7, shape, 1, short=32, room=18 * 200)
    assert_same(found, twin.list_crossings(*mesh, 7, shape, "y", 14))


def sorted_rows(rows: list[NDArray[np.int64]]) -> list[NDArray[np.int64]]:
    return [np.sort(row) for row in rows]


@pytest.mark.parametrize("short", [1, 4, 32])
@pytest.mark.parametrize("count", [1, 63, 64, 65])
def test_rows_of_every_length_are_sorted(session: Session, short: int, count: int) -> None:
    rng = np.random.default_rng([short, count])
    edges = [0, 1, 2, short - 1, short, short + 1, 2 * short + 1, 63, 64, 65, 129]
    lengths = rng.choice(edges, count)
    lengths[-1] = 65
    rows = [rng.permutation(rng.integers(-(2**63), 2**63, n)) for n in lengths]
    expected = np.concatenate(sorted_rows(rows))
    offsets = np.concatenate([[0], np.cumsum(lengths)]).astype(np.uint64)
    held = session.upload(np.concatenate(rows))
    sort_rows(session, session.upload(offsets), held, short=short)
    np.testing.assert_array_equal(held.get(), expected)


@pytest.mark.parametrize("length", [33, 127, 128, 129, 1000])
def test_a_long_row_may_come_in_any_order(session: Session, length: int) -> None:
    rng = np.random.default_rng(length)
    values = np.arange(length, dtype=np.int64)
    alike = np.zeros(length, np.int64)
    for row in (values, values[::-1], rng.permutation(values), values // 7, alike):
        held = session.upload(np.ascontiguousarray(row))
        sort_rows(session, session.upload(np.array([0, 0, length], np.uint64)), held)
        np.testing.assert_array_equal(held.get(), np.sort(row))
