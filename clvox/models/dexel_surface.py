"""Vertices of marching cubes, moved along the edges they lie on to where rays cross a surface."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
import trimesh
from numpy.typing import NDArray

from clvox.errors import GridError
from clvox.ops import dexel_measure

if TYPE_CHECKING:
    from clvox.models.dexels import DexelModel


def move_vertices(mesh: trimesh.Trimesh, bundles: Iterable[DexelModel]) -> trimesh.Trimesh:
    """Return *mesh* with each vertex moved to the end of a piece on its edge.

    A vertex lies on an edge between two samples, one in and one out, half-way.  If one of the
    bundles has rays along the edge, there is an end between the two on that ray, and the first of
    them is where the vertex belongs.

    Parameters
    ----------
    mesh
        Of `VoxelModel.to_mesh`, on the bundles' grid.
    bundles
        Models whose samples inside are those that the mesh was made of.  If they are three, the
        result has vertex normals: those of the triangles that the rays cross.

    Raises
    ------
    GridError
        No end lies between two such samples: the bundles are not of one solid.
    """
    models = list(bundles)
    if not len(mesh.vertices):
        return mesh
    grid = models[0].grid
    vertices = np.array(mesh.vertices)
    # Twice the distance from the corner of the box: odd at a sample, even half-way between two.
    twice = np.rint((vertices - grid.origin) / grid.spacing * 2).astype(np.int64)
    axes = np.argmax(twice % 2 == 0, axis=1)
    normals: NDArray[np.float64] | None = np.zeros_like(vertices)
    for model in models:
        frame, session, pieces = model._frame, model._session, model._pieces
        own = np.flatnonzero(axes == frame.axis)
        u, v = (axis for axis in range(3) if axis != frame.axis)
        rays = twice[own, v] // 2 * frame.across[0] + twice[own, u] // 2
        before = (twice[own, frame.axis] // 2 - 1) << frame.fraction_bits
        depth, side = dexel_measure.find_ends(session, pieces, rays, before.astype(np.int32))
        beyond = depth - before
        if ((beyond <= 0) | (beyond > 1 << frame.fraction_bits)).any():
            raise GridError(
                f"the bundle along {model.axis} is of another solid than the others: its rays do "
                "not end where samples change. Make all three of one mesh: dexelize(axis='xyz')."
            )
        vertices[own, frame.axis] = model._along(depth)
        facing = model._sources.normals((side >> 1).astype(np.int64))
        if facing is None or normals is None:
            normals = None
            continue
        # Outwards: against the ray where it goes in; caps have no triangle.
        outwards = 1.0 - 2.0 * (side & 1)
        along = facing[:, frame.axis]
        facing *= np.where(along * outwards < 0, -1.0, 1.0)[:, None]
        flat = ~facing.any(axis=1)
        facing[flat, frame.axis] = outwards[flat]
        normals[own] = facing
    if len(models) < 3:
        normals = None
    return trimesh.Trimesh(vertices, mesh.faces, vertex_normals=normals, process=False)
