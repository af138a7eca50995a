"""Closed meshes of any size, by formula: the same on every machine."""

from __future__ import annotations

from typing import Any

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray


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


def drum(sections: int = 10_000) -> trimesh.Trimesh:
    """Return a cylinder of 4 * sections slivers: fans at both ends, and strips around it."""
    made: trimesh.Trimesh = trimesh.creation.cylinder(radius=1.0, height=2.0, sections=sections)
    return made


def turned(vertices: ArrayLike, faces: ArrayLike) -> trimesh.Trimesh:
    """Return a mesh turned about an axis that is none of the grid's, and shifted by a third."""
    points = np.asarray(vertices)
    rotation: Any = trimesh.transformations.rotation_matrix
    turn = rotation(1.1, (1.0, 2.0, 0.5))[:3, :3]
    return trimesh.Trimesh(
        points @ turn.T + np.ptp(points, axis=0).max() / 3, np.asarray(faces), process=False
    )


def kinds(subdivisions: int = 9) -> dict[str, trimesh.Trimesh]:
    """Return meshes that differ in the size and the form of their triangles, by name.

    The finest sphere has 20 * 4**subdivisions triangles: 5,242,880 by default.
    """
    box = trimesh.creation.box((2.0, 2.0, 2.0))
    found = {
        "large triangles (cube)": box,
        "medium triangles (bumpy sphere)": bumpy_sphere(subdivisions - 4),
        "small triangles (bumpy sphere)": bumpy_sphere(subdivisions - 1),
        "smallest triangles (bumpy sphere)": bumpy_sphere(subdivisions),
        "slivers (drum)": drum(),
        "slivers (drum, turned)": turned(drum().vertices, drum().faces),
    }
    parts = (found["small triangles (bumpy sphere)"], drum(), box)
    placed = [part.copy().apply_translation((3.0 * n, 0, 0)) for n, part in enumerate(parts)]
    return {**found, "mixture": trimesh.util.concatenate(placed)}


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    lengths: NDArray[np.float64] = np.linalg.norm(vectors, axis=0)
    return vectors / lengths
