"""Closed meshes of any size, by formula: the same on every machine."""

from __future__ import annotations

import numpy as np
import trimesh
from numpy.typing import NDArray


def sphere(subdivisions: int = 8) -> trimesh.Trimesh:
    """Return the unit icosphere of 20 * 4**subdivisions triangles: 1,310,720 by default."""
    ball: trimesh.Trimesh = trimesh.creation.icosphere(subdivisions=subdivisions)
    return ball


def bumpy_sphere(subdivisions: int = 8) -> trimesh.Trimesh:
    """Return `sphere` with every radius changed by up to a tenth, by a product of three sines.

    Each ray from the centre meets it once, so that it does not cut itself.
    """
    ball = sphere(subdivisions)
    x, y, z = np.asarray(ball.vertices).T
    radius = 1 + 0.1 * np.sin(5 * x) * np.sin(4 * y) * np.sin(6 * z)
    return trimesh.Trimesh(np.asarray(ball.vertices) * radius[:, None], ball.faces, process=False)


def trefoil(along: int = 360, around: int = 31, radius: float = 0.4) -> trimesh.Trimesh:
    """Return a tube of 2 * along * around triangles about a trefoil knot: 22,320 by default."""
    t = np.arange(along) * (2 * np.pi / along)
    centre = np.stack(
        [np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -np.sin(3 * t)]
    )
    ahead = np.stack(
        [np.cos(t) + 4 * np.cos(2 * t), -np.sin(t) + 4 * np.sin(2 * t), -3 * np.cos(3 * t)]
    )
    bend = np.stack(
        [-np.sin(t) - 8 * np.sin(2 * t), -np.cos(t) + 8 * np.cos(2 * t), 9 * np.sin(3 * t)]
    )
    # The knot is nowhere straight, so its Frenet frame closes after one turn.
    binormal = _unit(np.cross(ahead, bend, axis=0))
    normal = np.cross(binormal, _unit(ahead), axis=0)
    angle = np.arange(around) * (2 * np.pi / around)
    ring = normal[..., None] * np.cos(angle) + binormal[..., None] * np.sin(angle)
    vertices = (centre[..., None] + radius * ring).reshape(3, -1).T

    here = np.arange(along * around).reshape(along, around)
    next_ring = np.roll(here, -1, axis=0)
    a, b, c, d = here, next_ring, np.roll(next_ring, -1, axis=1), np.roll(here, -1, axis=1)
    faces = np.stack([a, c, b, a, d, c], axis=-1).reshape(-1, 3)
    return trimesh.Trimesh(vertices, faces, process=False)


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    lengths: NDArray[np.float64] = np.linalg.norm(vectors, axis=0)
    return vectors / lengths
