"""From an open mesh to a voxel model, by guessing what it was to enclose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from clvox.device import Session
from clvox.grid import Lattice, Shape
from clvox.mesh import Surface
from clvox.models.construct import timed
from clvox.models.memory import Room
from clvox.models.pieces import Pieces
from clvox.models.report import MOST_DOUBTFUL, Report
from clvox.models.telling import Told
from clvox.models.voxels import VoxelModel

OPEN_FILLS = ("vote", "winding")
"""The fills that guess an inside."""


def build_open(
    session: Session,
    surface: Surface,
    lattice: Lattice,
    levels: tuple[Shape, ...],
    fill: str,
    budget: int,
    told: Told,
) -> VoxelModel:
    """Return the model of *surface* by one of `OPEN_FILLS`.

    budget: bytes of the device that may be taken at once, the model included.
    """
    seconds: dict[str, float] = {}
    doubtful: list[NDArray[np.int64]] = []
    with session.job(budget, told.again) as job:
        room = Room(session, job, lattice.grid, surface, levels)
        with timed(session, seconds, "upload"):
            pieces = Pieces(room, lattice, fill, told)
            collapsed = pieces.count_flat()
        with timed(session, seconds, fill):
            arrays = pieces.run()
            if fill == "vote":
                doubtful = pieces.odd_rays()
        if progress := told.part(0, 1):
            progress(1, 1)
    named = dict(zip("xyz", doubtful, strict=False))
    report = replace(
        Report.of_mesh(session.device, surface, lattice, fill),
        seconds=seconds,
        collapsed=collapsed,
        odd_rays=sum(map(len, doubtful)),
        doubtful_rays={axis: len(rays) for axis, rays in named.items()},
        first_doubtful_rays=tuple(
            (axis, u, v) for axis, rays in named.items() for u, v in rays[:MOST_DOUBTFUL].tolist()
        ),
        peak_nbytes=job.peak_nbytes,
        warnings=(*surface.warnings, *_doubts(named)),
    )
    return VoxelModel(session, lattice.grid, arrays, report, ((surface, lattice),))


def _doubts(rays: dict[str, NDArray[np.int64]]) -> list[str]:
    if not any(map(len, rays.values())):
        return []
    counts = ", ".join(f"{len(found)} along {axis}" for axis, found in rays.items())
    return [f"rays that cross the mesh an odd number of times were put to the vote: {counts}"]
