"""Young's renderings: the models and sizes of his tables 5.2 and 5.3, and the frames he printed.

His models are not public; parts with as many triangles stand in for them.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

import clvox
from benchmarks import frames
from clvox.bench import Result, compare, meshes
from clvox.grid import Shape
from clvox.mesh import Surface, check

if TYPE_CHECKING:
    from benchmarks.cases import Plan

Row: TypeAlias = tuple[Shape, int, int | None]
"""Coarse cells, sides of the bricks (1: none), and frames a second; None where unreadable."""

ROWS: dict[str, tuple[Row, ...]] = {
    "Hammer": (
        ((8, 12, 4), 4, 61),
        ((8, 12, 4), 20, 61),
        ((12, 20, 8), 4, 61),
        ((12, 20, 8), 10, 45),
        ((12, 20, 8), 20, 61),
        ((48, 100, 28), 1, 61),
        ((48, 100, 28), 4, 61),
        ((48, 100, 28), 10, 52),
        ((100, 200, 52), 1, 61),
        ((100, 200, 52), 4, 53),
        ((100, 200, 52), 10, 45),
    ),
    "Engine": (
        ((8, 12, 12), 4, 61),
        ((8, 12, 12), 10, 61),
        ((8, 12, 12), 15, 51),
        ((12, 16, 20), 4, None),
        ((12, 16, 20), 10, 61),
        ((12, 16, 20), 20, 45),
        ((64, 76, 100), 1, 61),
        ((64, 76, 100), 4, 40),
        ((64, 76, 100), 10, 50),
        ((124, 156, 200), 1, 61),
        ((124, 156, 200), 4, 40),
        ((124, 156, 200), 6, 43),
    ),
    "Engine Cover": (
        ((12, 12, 4), 4, 50),
        ((12, 12, 4), 10, 39),
        ((12, 12, 4), 20, 48),
        ((20, 20, 8), 4, 45),
        ((20, 20, 8), 10, 44),
        ((20, 20, 8), 20, 45),
        ((100, 96, 40), 1, 61),
        ((100, 96, 40), 4, 36),
        ((100, 96, 40), 10, 35),
        ((200, 188, 76), 1, 61),
        ((200, 188, 76), 4, 35),
        ((200, 188, 76), 6, 34),
    ),
    "Trefoil": (
        ((12, 12, 12), 4, 65),
        ((12, 12, 12), 10, 62),
        ((12, 12, 12), 20, 61),
        ((20, 20, 20), 4, 63),
        ((20, 20, 20), 10, 61),
        ((20, 20, 20), 20, 61),
        ((100, 100, 100), 1, 61),
        ((100, 100, 100), 4, 61),
        ((100, 100, 100), 10, 61),
        ((200, 200, 200), 1, 61),
        ((200, 200, 200), 4, 50),
        ((200, 200, 200), 6, 60),
    ),
}
"""Where the printed counts are those of other bricks than the printed ones, theirs."""

STAND_INS = {
    "Hammer": "parts/nist_bracket_plate_pmi1_5k.stl",
    "Engine": "parts/nist_machined_part_pmi2_28k.stl.gz",
    "Engine Cover": "parts/nist_machined_part_pmi4_119k.stl.gz",
}

MOST_BYTES = 1 << 24
"""VTK takes a byte for each voxel, and seconds for each picture; it is asked up to so many."""


def young(plan: Plan) -> Iterator[Result]:
    """Young's tables 5.2 and 5.3: frames of 1920 x 1080, a ray a pixel.

    "seconds printed" is one by his frames a second, on a GTX Titan X; about 61 was the display's
    limit.
    """
    size = plan.pick(frames.SIZE, (32, 18))
    for name, surface in _surfaces(plan).items():
        for cells, side, printed in plan.pick(ROWS[name], ROWS[name][:1]):
            levels = [cells] if side == 1 else [cells, (side, side, side)]
            model = clvox.voxelize(
                surface, levels=levels, attributes=("normals",), device=plan.session.device
            )
            dense = not plan.quick and int(np.prod(model.grid.shape)) <= MOST_BYTES
            ways = frames.contestants(model, surface, size, dense=dense)
            label = f"{name}, {'x'.join(map(str, cells))}, {side}"
            plan.session.free()
            for result in compare(f"Young's frame, {label}", ways, repeats=plan.repeats):
                if printed is not None:
                    result.notes["seconds printed"] = 1 / printed
                yield result


def _surfaces(plan: Plan) -> dict[str, Surface]:
    """What stands in for Young's models, of those that are there."""
    folder = os.environ.get("CLVOX_DATA")
    found = {"Trefoil": check(plan.pick(meshes.trefoil(), meshes.trefoil(24, 5)))}
    if folder is None or plan.quick:
        return found
    paths = {name: Path(folder) / file for name, file in STAND_INS.items()}
    return {name: check(path) for name, path in paths.items() if path.exists()} | found
