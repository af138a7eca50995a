"""Passes over memory, held against a plain copy.

A pass is charged the bytes that no program could save: each input read once, each output written
once.  Its share of the copy's bandwidth says how far it is from the best that is possible.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from clvox.bench.harness import Contestant, Result, compare
from clvox.device import Session
from clvox.grid import Grid, Lattice
from clvox.mesh import Surface
from clvox.ops import boundary, crossings, dense
from clvox.ops.facets import upload_facets
from clvox.ops.layout import Bricks, words_for
from clvox.ops.multilevel import carry, rank_cells
from clvox.ops.scan import prefix_sum

BRICK = 8, 8, 8


def copy(session: Session, words: int) -> tuple[Callable[[], None], int]:
    """Return what copies *words* 32-bit words, in fours, and the bytes read and written."""
    fours = words // 4
    source = session.zeros(4 * fours, np.uint32)
    target = session.empty(4 * fours, np.uint32)
    kernel = session.kernel("buffers/copy.cl", "copy")

    def run() -> None:
        session.run(kernel, fours, np.uint64(fours), source, target)
        session.finish()

    return run, source.nbytes + target.nbytes


def compare_with_copy(
    session: Session, surface: Surface, *, words: int, resolution: int, repeats: int = 5
) -> list[Result]:
    """Return the copy, and each streaming pass with its share of the copy's bandwidth.

    Parameters
    ----------
    session : Session
    surface : Surface
        Closed; cut into bricks for `carry`.
    words : int
        32-bit words that are copied, cleared, scanned, and filled as a dense grid.
    resolution : int
        Voxels along the longest side of *surface*, for `carry`.
    repeats : int

    Returns
    -------
    list of Result
        With the notes "GB/s" and "share of the copy".
    """
    passes = {
        "copy": copy(session, words),
        "clear": _clear(session, words),
        "scan": _scan(session, words),
        "fill": _fill(session, words),
        "carry": _carry(session, surface, resolution),
    }
    contestants = [Contestant(name, run) for name, (run, _) in passes.items()]
    results = compare("streaming passes", contestants, repeats=repeats)
    speeds = [
        nbytes / result.median for result, (_, nbytes) in zip(results, passes.values(), strict=True)
    ]
    return [
        replace(result, notes={"GB/s": speed / 1e9, "share of the copy": speed / speeds[0]})
        for result, speed in zip(results, speeds, strict=True)
    ]


def _clear(session: Session, words: int) -> tuple[Callable[[], None], int]:
    def run() -> None:
        session.zeros(words, np.uint32)
        session.finish()

    return run, 4 * words


def _scan(session: Session, words: int) -> tuple[Callable[[], None], int]:
    counts = session.zeros(words, np.uint32)
    return lambda: _drop(prefix_sum(session, counts)), 8 * words


def _fill(session: Session, words: int) -> tuple[Callable[[], None], int]:
    side = max(1, round((32 * words) ** (1 / 3)))
    voxels = session.zeros((side, side, words_for(side)), np.uint32)
    beyond = session.zeros((side, words_for(side)), np.uint32)
    return lambda: _drop(dense.fill(session, voxels, beyond)), 2 * voxels.nbytes + beyond.nbytes


def _carry(session: Session, surface: Surface, resolution: int) -> tuple[Callable[[], None], int]:
    grid = Grid.fit(surface, resolution=resolution)
    lattice = Lattice.fit(grid, surface.bounds)
    facets = upload_facets(session, lattice.snap(surface.vertices), surface.faces)
    marks = boundary.mark_cells(session, facets, lattice.bits, grid.shape, BRICK)
    x, y, z = (-(-count // 8) for count in grid.shape)
    cells = rank_cells(session, marks, (x, y, z), BRICK)
    bricks = Bricks.cleared(session, cells)
    crossings.flip_bricks(session, facets, lattice.bits, cells, bricks)
    # What carry changes it also reads; where it ran before it does the same work on other bits.
    changed = bricks.voxels.nbytes + bricks.entry.nbytes
    read = bricks.exits.nbytes + bricks.beyond.nbytes + cells.boundary.nbytes + cells.rank.nbytes
    written = cells.boundary.nbytes
    return lambda: _drop(carry(session, cells, bricks, grid.shape)), 2 * changed + read + written


def _drop(_: object) -> None:
    """Let the result go: scan, fill and carry have waited for the device."""
