"""From an open mesh to a voxel model, by guessing what it was to enclose."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from clvox.device import Session
from clvox.grid import Lattice, Shape
from clvox.mesh import Surface
from clvox.models.construct import timed
from clvox.models.report import MOST_DOUBTFUL, Report
from clvox.models.telling import Told
from clvox.models.voxels import VoxelModel
from clvox.ops import boundary, vote, winding
from clvox.ops.facets import upload_facets

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

    budget: bytes of the device that may be taken at once; what needs more is refused.
    """
    seconds: dict[str, float] = {}
    bits, shape, triangles = lattice.bits, lattice.grid.shape, len(surface.faces)
    doubtful: list[NDArray[np.int64]] = []
    with session.job(budget, told.again) as job:
        with timed(session, seconds, "upload"):
            vertices = lattice.snap(surface.vertices)
            facets = upload_facets(session, vertices, surface.faces)
            collapsed = boundary.count_flat(session, facets)
        with timed(session, seconds, fill):
            progress = told.part(0, 1)
            if fill == "vote":
                mesh = vertices, surface.faces, surface.odd_edges
                arrays = vote.fill_vote(session, *mesh, bits, shape, levels, progress=progress)
                doubtful = vote.odd_rays(session, facets, bits, shape)
            else:
                rim = winding.upload_rim(session, vertices, directed_rim(surface), lattice.step)
                arrays = winding.fill_winding(
                    session, facets, rim, bits, shape, levels, progress=progress
                )
        if progress is not None:
            progress(1, 1)
        del facets
    named = dict(zip("xyz", doubtful, strict=False))
    report = Report(
        device=str(session.device),
        fill=fill,
        seconds=seconds,
        triangles=triangles,
        repeated=surface.repeated,
        duplicates=surface.duplicates,
        cancelled=surface.cancelled,
        collapsed=collapsed,
        odd_rays=sum(map(len, doubtful)),
        doubtful_rays={axis: len(rays) for axis, rays in named.items()},
        first_doubtful_rays=tuple(
            (axis, u, v) for axis, rays in named.items() for u, v in rays[:MOST_DOUBTFUL].tolist()
        ),
        lattice_bits=bits,
        peak_nbytes=job.peak_nbytes,
        warnings=(*surface.warnings, *_doubts(named)),
    )
    return VoxelModel(session, lattice.grid, arrays, report, ((surface, lattice),))


def directed_rim(surface: Surface) -> NDArray[np.int32]:
    """Return the edges that are used more often one way than the other, the way they are.

    Returns
    -------
    (n, 2) int32
        Rows of `surface.vertices`; an edge comes as often as it is used more one way.
    """
    count = len(surface.vertices)
    on_rim = np.zeros(count, np.bool_)
    on_rim[surface.uneven_edges] = True
    faces = surface.faces[on_rim[surface.faces].sum(axis=1) >= 2].astype(np.int64)
    ends = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2)
    # Both ends on the rim: then all triangles of the edge are here.
    ends = ends[on_rim[ends].all(axis=1)]
    keys, edge = np.unique(ends.min(axis=1) * count + ends.max(axis=1), return_inverse=True)
    forward = np.where(ends[:, 0] < ends[:, 1], 1, -1)
    net = np.bincount(edge, weights=forward, minlength=len(keys)).astype(np.int64)
    pairs = np.stack(np.divmod(keys, count), axis=1)
    pairs[net < 0] = pairs[net < 0, ::-1]
    return np.repeat(pairs, np.abs(net), axis=0).astype(np.int32)


def _doubts(rays: dict[str, NDArray[np.int64]]) -> list[str]:
    if not any(map(len, rays.values())):
        return []
    counts = ", ".join(f"{len(found)} along {axis}" for axis, found in rays.items())
    return [f"rays that cross the mesh an odd number of times were put to the vote: {counts}"]
