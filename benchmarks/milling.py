"""Milling: moves a second on the blank of a part, and combinations of dexels beside meshes'."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from statistics import median
from typing import TYPE_CHECKING

import numpy as np
import trimesh
from numpy.typing import NDArray

import clvox
from benchmarks import peers
from clvox.bench import Contestant, Result, compare, meshes
from clvox.mesh import Surface, check

if TYPE_CHECKING:
    from benchmarks.cases import Plan


def milling(plan: Plan) -> Iterator[Result]:
    """Moves of three cutters over the blank of a part, down to the part's highest places.

    The path is made before; from dexels on the device to dexels on the device.
    """
    if plan.part is None:
        return
    surface = check(plan.part)
    grid = clvox.Grid.fit(surface, resolution=plan.pick(512, 24))
    device = plan.session.device
    box = trimesh.creation.box(bounds=surface.bounds)
    blank = clvox.dexelize(box, grid=grid, lattice_bits=12, device=device)
    radius = float(max(box.extents[:2])) / 30
    path = _path(clvox.dexelize(surface, grid=grid, device=device), radius, plan.pick(2000, 20))
    cutters = {
        "flat": clvox.Cutter.flat(radius),
        "ball": clvox.Cutter.ball(radius),
        "bull-nose": clvox.Cutter.bull(radius, radius / 3),
    }
    ways = [
        Contestant(f"clvox, {name}", partial(blank.cut, cutter, path))
        for name, cutter in cutters.items()
    ]
    rays = " x ".join(map(str, grid.shape[:2]))
    moves = len(path) - 1
    label = f"milling {rays}, {moves:,} moves, blank of {plan.part.name.split('.')[0]}"
    for result in compare(label, ways, repeats=plan.repeats):
        notes = {
            "moves a second": moves / median(result.seconds),
            "moves a CPU second": moves / median(result.cpu_seconds),
        }
        yield replace(result, notes=notes)


def _path(part: clvox.DexelModel, radius: float, moves: int) -> NDArray[np.float64]:
    """Lines along x, to and fro, the tip above all that the cutter could touch on its way."""
    heights = np.full(part.grid.shape[1::-1], part.grid.bounds[0][2])
    offsets, _, leave = part.intervals()
    ends = offsets.astype(np.int64)
    some = ends[1:] > ends[:-1]
    heights.reshape(-1)[some] = leave[ends[1:][some] - 1]
    (low_x, low_y, _), (high_x, high_y, _) = part.grid.bounds
    lines = max(2, round(float(np.sqrt(moves / 4))))
    stops = -(-moves // lines) + 1
    x = np.tile(np.linspace(low_x, high_x, stops), (lines, 1))
    x[1::2] = x[1::2, ::-1]
    y = np.repeat(np.linspace(low_y, high_y, lines), stops)
    reach = np.array([(high_x - low_x) / (stops - 1), (high_y - low_y) / (lines - 1)]) + radius
    points = np.column_stack([x.ravel(), y])
    width = np.array(part.grid.spacing[:2])
    first = np.floor((points - reach - (low_x, low_y)) / width).astype(int).clip(0)
    last = np.floor((points + reach - (low_x, low_y)) / width).astype(int) + 1
    tops = [
        heights[j:stop_j, i:stop_i].max(initial=part.grid.bounds[0][2])
        for (i, j), (stop_i, stop_j) in zip(first.tolist(), last.tolist(), strict=True)
    ]
    return np.column_stack([points, tops])[: moves + 1]


def dexel_boolean(plan: Plan) -> Iterator[Result]:
    """The union of a mesh with a turned and shifted copy, each side's construction included.

    As dexels by clvox, with both dexelized and the union's mesh not made; as a mesh by manifold3d.
    """
    one, other = plan.ball, check(meshes.turned(plan.ball.vertices, plan.ball.faces))
    low = np.minimum(one.bounds[0], other.bounds[0])
    extent = np.maximum(one.bounds[1], other.bounds[1]) - low
    pitch = float(extent[:2].max()) / plan.pick(1024, 32)
    grid = clvox.Grid(low, pitch, np.ceil(extent / pitch).astype(int))

    def dexels(mesh: Surface) -> clvox.DexelModel:
        return clvox.dexelize(mesh, grid=grid, lattice_bits=12, device=plan.session.device)

    def ours() -> clvox.DexelModel:
        return dexels(one) | dexels(other)

    a, b = dexels(one), dexels(other)
    ways = [Contestant("clvox", ours), Contestant("clvox, the union alone", lambda: a | b)]
    union = peers.union()
    if union is not None:
        ways.append(Contestant("manifold3d", partial(union, one, other)))
    rays = " x ".join(map(str, grid.shape[:2]))
    label = f"dexel union of two of {len(one.faces):,} triangles, {rays} rays"
    yield from compare(label, ways, repeats=plan.repeats)
