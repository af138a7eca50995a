"""Work in slabs, in parts of a mesh and in short launches gives the bits of the whole."""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from clvox.device import session as sessions
from clvox.errors import OutOfMemoryError
from clvox.grid import Shape
from clvox.models.memory import cut_slabs, slab_nbytes
from clvox.ops import crossings, fill
from clvox.ops.boundary import count_flat, mark_and_count, mark_cells, mark_voxels
from clvox.ops.facets import FacetChunks, Facets, upload_facets
from clvox.ops.fill import Winding
from clvox.ops.layout import Bricks, Cells, Slab, cell_shape
from clvox.ops.multilevel import Solid, carry, empty_solid, rank_cells
from clvox.ops.scan import prefix_sum
from tests.kernels.cases import some
from tests.strategies import Mesh, adversarial_meshes, closed_meshes, join

if TYPE_CHECKING:
    import pyopencl.array as cla

    from clvox.device import Session

BITS = 8
SHAPE: Shape = (11, 9, 13)
TREES: list[tuple[Shape, ...]] = [
    ((3, 4, 2),),
    ((8, 8, 8),),
    ((33, 2, 1),),
    ((2, 2, 2), (2, 3, 1)),
    ((1, 2, 3), (8, 8, 2)),
]
RULES = [None, Winding.NONZERO, Winding.POSITIVE]


def chunks(mesh: Mesh, most: int) -> FacetChunks:
    return FacetChunks(mesh[0].astype(np.int32), mesh[1], most)


def whole(session: Session, mesh: Mesh) -> Facets:
    return upload_facets(session, mesh[0].astype(np.int32), mesh[1])


def mark(session: Session, facets: Any, sides: tuple[Shape, ...]) -> Cells:
    """The levels above the voxels."""
    x, y, z = np.prod(np.array(sides), axis=0).tolist()
    marks = mark_cells(session, facets, BITS, SHAPE, (x, y, z))
    cells = rank_cells(session, marks, cell_shape(SHAPE, (x, y, z)), sides[0])
    if len(sides) == 1:
        return cells
    counts = cell_shape(SHAPE, sides[1])
    marks = mark_voxels(session, facets, BITS, counts, cells, side=sides[1])
    return replace(cells, finer=rank_cells(session, marks, counts, sides[1]))


def build(
    session: Session, facets: Any, sides: tuple[Shape, ...], rule: Winding | None, room: int | None
) -> tuple[list[Any], int]:
    """All arrays of a model, made in slabs of *room* bytes; and the number of slabs."""
    cells = mark(session, facets, sides)
    voxels = session.zeros((cells.last.count, cells.last.brick_words), np.uint32)
    solid = empty_solid(session, cells)
    slabs = [Slab.whole(cells)] if room is None else cut_slabs(cells, room)
    for slab in slabs:
        solid = fill_slab(session, facets, cells, voxels, slab, rule, solid)
    assert (solid.disagreements, solid.odd_rays) == (0, 0)
    arrays: list[Any] = [cells.boundary, cells.rank, solid.inside, voxels]
    if cells.finer is not None:
        arrays += [cells.finer.boundary, cells.finer.rank, solid.middle_inside]
    return [array.get() for array in arrays], len(slabs)


def fill_slab(
    session: Session,
    facets: Any,
    cells: Cells,
    voxels: cla.Array,
    slab: Slab,
    rule: Winding | None,
    solid: Solid,
) -> Solid:
    bricks = Bricks.cleared(session, cells, voxels, slab)
    if rule is None:
        crossings.flip_bricks(session, facets, BITS, cells, bricks)
    else:
        fill.flip_bricks(session, facets, BITS, cells, rule, bricks, list_bytes=1 << 12)
    return carry(session, cells, bricks, SHAPE, solid)


def same(found: list[Any], expected: list[Any]) -> None:
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one, other, strict=True)


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("sides", TREES)
def test_slabs_and_parts_equal_the_whole(
    session: Session, sides: tuple[Shape, ...], rule: Winding | None
) -> None:
    mesh = join(adversarial_meshes(7, some(6), BITS, SHAPE))
    expected, _ = build(session, whole(session, mesh), sides, rule, None)
    layers = -(-SHAPE[2] // int(np.prod([side[2] for side in sides])))
    thin, count = build(session, chunks(mesh, 7), sides, rule, 0)
    assert count == layers
    same(thin, expected)
    thick, count = build(session, whole(session, mesh), sides, rule, 2000)
    assert count <= layers
    same(thick, expected)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    closed_meshes(BITS, SHAPE),
    st.sampled_from(TREES),
    st.sampled_from(RULES),
    st.integers(1, 40),
    st.integers(0, 4000),
)
def test_drawn_slabs_and_parts_equal_the_whole(
    session: Session,
    mesh: Mesh,
    sides: tuple[Shape, ...],
    rule: Winding | None,
    most: int,
    room: int,
) -> None:
    expected, _ = build(session, whole(session, mesh), sides, rule, None)
    same(build(session, chunks(mesh, most), sides, rule, room)[0], expected)


@pytest.mark.parametrize("sides", TREES)
def test_slabs_take_the_room_they_may(session: Session, sides: tuple[Shape, ...]) -> None:
    """They follow each other, hold all there is, and none of two layers or more is too large."""
    facets = whole(session, join(adversarial_meshes(3, 4, BITS, SHAPE)))
    cells = mark(session, facets, sides)
    deep = sides[0][2] if len(sides) == 2 else 1
    for room in (0, 500, 2000, 1 << 20):
        layer = brick = 0
        for slab in cut_slabs(cells, room):
            assert (slab.first_layer, slab.first_brick) == (layer, brick)
            assert slab.layers > 0
            assert slab.layers <= deep or slab_nbytes(cells, slab) <= room
            layer, brick = layer + slab.layers, brick + slab.bricks
        assert (layer, brick) == (cells.last.shape[2], cells.last.count)
    assert len(cut_slabs(cells, 1 << 20)) == 1


def test_parts_near_a_window_are_enough(session: Session) -> None:
    """And no more are sent than reach it."""
    mesh = join(adversarial_meshes(11, 10, BITS, SHAPE))
    for axis in range(3):
        window = crossings.Window.whole(SHAPE, axis)._replace(first_u=3, stop_u=5, stop_v=4)
        expected = session.zeros(window.rays, np.uint32)
        crossings.add_counts(session, whole(session, mesh), BITS, axis, window, expected)
        near = crossings.near(chunks(mesh, 5), BITS, axis, window)
        assert near.triangles < len(mesh[1])
        counts = session.zeros(window.rays, np.uint32)
        crossings.add_counts(session, near, BITS, axis, window, counts)
        np.testing.assert_array_equal(counts.get(), expected.get())


def test_flat_triangles_of_parts(session: Session) -> None:
    mesh = join(adversarial_meshes(5, 12, BITS, SHAPE))
    flat = count_flat(session, whole(session, mesh))
    assert flat == count_flat(session, chunks(mesh, 5)) > 0
    assert flat == mark_and_count(session, chunks(mesh, 5), BITS, SHAPE, (4, 4, 4))[1]


def test_progress_of_parts_is_that_of_the_whole(session: Session) -> None:
    mesh = join(adversarial_meshes(5, 6, BITS, SHAPE))
    told: list[tuple[int, int]] = []
    mark_cells(
        session, chunks(mesh, 5), BITS, SHAPE, (4, 4, 4), progress=lambda *now: told.append(now)
    )
    count = len(mesh[1])
    assert [done for done, _ in told] == sorted(done for done, _ in told)
    assert set(told) >= {(5, count), (count, count)}
    assert {total for _, total in told} == {count}


# Launches


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("sides", TREES[1:4])
def test_short_launches_give_the_same(
    session: Session, monkeypatch: pytest.MonkeyPatch, sides: tuple[Shape, ...], rule: Any
) -> None:
    mesh = join(adversarial_meshes(9, some(4, 1), BITS, SHAPE))
    expected, _ = build(session, whole(session, mesh), sides, rule, None)
    shorten(monkeypatch, 64)
    same(build(session, whole(session, mesh), sides, rule, None)[0], expected)


def test_short_launches_of_a_scan(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    counts = np.random.default_rng(1).integers(0, 1000, 20_000).astype(np.uint32)
    shorten(monkeypatch, 64)
    sums, total = prefix_sum(session, session.upload(counts), bits=64)
    before = np.concatenate([[0], np.cumsum(counts, dtype=np.uint64)])
    np.testing.assert_array_equal(sums.get(), before[:-1])
    assert total == before[-1]


def shorten(monkeypatch: pytest.MonkeyPatch, items: int) -> None:
    """Let a launch have so many work-items."""
    monkeypatch.setattr(sessions, "STEPS_PER_LAUNCH", 1)
    monkeypatch.setattr(sessions, "ITEMS_PER_LAUNCH", items)


@pytest.mark.parametrize(("steps", "launches"), [(1, 1), (4, 4), (1 << 20, 16)])
def test_launches_are_cut_and_told_of(
    session: Session, monkeypatch: pytest.MonkeyPatch, steps: int, launches: int
) -> None:
    """After each one whoever asked for the work may end it."""
    monkeypatch.setattr(sessions, "STEPS_PER_LAUNCH", 1024)
    monkeypatch.setattr(sessions, "ITEMS_PER_LAUNCH", 64)
    words = session.upload(np.full(4096, 7, np.uint32))
    kernel = session.kernel("buffers/clear.cl", "clear")
    ticks: list[int] = []
    with session.job(1 << 30, lambda: ticks.append(1)):
        session.run(kernel, 1024, np.uint64(4096), words, steps=steps)
    assert len(ticks) == launches
    assert not words.get().any()


def test_the_host_is_not_far_ahead(session: Session) -> None:
    words = session.zeros(64, np.uint32)
    kernel = session.kernel("buffers/clear.cl", "clear")
    for _ in range(10):
        session.run(kernel, 16, np.uint64(64), words)
        assert len(session._queued) <= sessions.AHEAD
    session.finish()
    assert not session._queued


# Jobs


def test_threads_may_finish_what_others_queue(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Even between a look at the queue and taking the oldest of it."""

    class Queued(deque[Any]):
        def __len__(self) -> int:
            count = super().__len__()
            if count > sessions.AHEAD:
                # Not every implementation likes two threads at work at once.
                session._queue.finish()
                thread = threading.Thread(target=session.finish)
                threads.append(thread)
                thread.start()
                # It may have to wait for us.
                thread.join(0.05)
            return count

    threads: list[threading.Thread] = []
    session.finish()
    monkeypatch.setattr(session, "_queued", Queued())
    array = [session.zeros(64, np.uint32) for _ in range(sessions.AHEAD + 1)]
    for thread in threads:
        thread.join()
    assert len(threads) == 1
    assert not any(words.get().any() for words in array)


def test_a_job_is_of_one_thread(session: Session) -> None:
    found: list[Any] = []

    def work() -> None:
        found.append(session.current_job)
        found.append(session.empty(20_000, np.uint8))

    with session.job(10_000) as job:
        with session.job(5000) as inner:
            assert session.current_job is inner
        assert session.current_job is job
        thread = threading.Thread(target=work)
        thread.start()
        thread.join()
        assert job.nbytes == 0
    assert found[0] is None
    assert found[1].nbytes == 20_000


@pytest.mark.parametrize("size", [0, 4, 1000])
def test_what_is_shared_reads_like_a_copy_and_counts_like_one(session: Session, size: int) -> None:
    host = np.arange(size, dtype=np.uint32)
    with session.job(10_000) as job:
        shared = session.share(host)
        assert job.nbytes == session.size_of(host.nbytes)
        read = session.empty(size, np.uint32)
        if size:
            kernel = session.kernel("buffers/copy.cl", "copy")
            session.run(kernel, size // 4, np.uint64(size // 4), shared, read)
        np.testing.assert_array_equal(read.get(), host, strict=True)
        with pytest.raises(OutOfMemoryError, match="bytes more are needed"):
            session.share(np.zeros(10_001, np.uint8))
        del shared, read
        assert job.nbytes == 0


def test_a_job_counts_its_own_arrays(session: Session) -> None:
    other = session.empty(1000, np.uint8)
    with session.job(10_000) as job:
        first = session.empty(4000, np.uint8)
        size = session.size_of(4000)
        assert job.nbytes == size >= 4000
        second = session.empty(4000, np.uint8)
        assert (job.nbytes, job.left) == (2 * size, 10_000 - 2 * size)
        with pytest.raises(
            OutOfMemoryError, match=r"4,[0-9]+ bytes more are needed .* of the 10,000"
        ):
            session.empty(4000, np.uint8)
        del first
        assert job.nbytes == size
        third = session.empty(4000, np.uint8)
        assert job.peak_nbytes == 2 * size
    assert session.current_job is None
    del second, third, other
    assert job.nbytes == 2 * size, "what is there at the end is the result"
