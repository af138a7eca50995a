"""Dexels: the tables of Inui 2021 on generated meshes, beside Open3D's ray caster.

His meshes are not public; these are knots of as many triangles.  His seconds are those of an
RTX 2080 with ray-tracing cores (CAD&A 18(4), 2021, tables 1 and 2); he counts, as here, from a mesh
in memory to sorted crossings.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING

import clvox
from benchmarks import peers
from clvox.bench import Contestant, Result, compare, meshes
from clvox.mesh import Surface, check

if TYPE_CHECKING:
    from benchmarks.cases import Plan

TABLE_1 = {1000: 0.442, 2000: 0.474, 2500: 0.469, 4000: 0.544, 6000: 0.687}
"""Rays along a side: the paper's seconds, for 2,700,707 polygons."""

TABLE_2 = {197_450: 0.431, 393_832: 0.427, 787_664: 0.447, 1_572_504: 0.510, 3_145_008: 0.564}
"""Polygons: the paper's seconds, for 4000 x 4000 rays."""


def dexels(plan: Plan) -> Iterator[Result]:
    """Sorted crossings of rays along z, upload included; Open3D's tree is built before.

    The notes have the crossings, and the seconds that the paper printed for as many polygons and
    rays.  Open3D's hits are sorted by ray and depth, as ours are.
    """
    for resolution in plan.pick((1000, 4000), (32,)):
        yield from _compare(plan, plan.ball, "bumpy_sphere", resolution)
    mesh = knot(plan.pick(2_700_707, 200))
    for resolution, printed in plan.pick(TABLE_1, {32: 0.0}).items():
        yield from _compare(plan, mesh, "table 1, knot", resolution, printed)
    for count, printed in plan.pick(TABLE_2, {}).items():
        yield from _compare(plan, knot(count), "table 2, knot", 4000, printed)


def knot(triangles: int) -> Surface:
    """Return a knotted tube of about so many triangles, about as long as wide."""
    around = round(math.sqrt(triangles / 8))
    return check(meshes.trefoil(4 * around, around))


def _compare(
    plan: Plan, surface: Surface, name: str, resolution: int, printed: float = 0.0
) -> list[Result]:
    grid = clvox.Grid.fit(surface, resolution=resolution)
    device = plan.session.device
    ours = partial(clvox.dexelize, surface, grid=grid, device=device)

    def describe(model: clvox.DexelModel) -> dict[str, float]:
        found = {
            "crossings": float(model._crossings.count),
            "device MB": model._built.peak_nbytes / 1e6,
        }
        return found | ({"Inui 2021, s": printed} if printed else {})

    ways = [Contestant("clvox", ours, describe)]
    caster = peers.ray_caster()
    if caster is not None:
        scene = caster.prepare(surface, grid)
        hits = partial(caster.list_hits, scene, grid)
        ways.append(Contestant("Open3D, sorted", hits, lambda count: {"crossings": float(count)}))
    plan.session.free()
    x, y, _ = grid.shape
    label = f"dexels {x} x {y}, {name}, {len(surface.faces):,} triangles"
    return compare(label, ways, repeats=plan.repeats)
