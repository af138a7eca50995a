"""The meshes that the ends of a dexel model come from."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from clvox.errors import MeshError
from clvox.mesh import Surface
from clvox.ops.dexels import CAP


@dataclass(frozen=True, eq=False)
class Source:
    """One mesh; of one that a file told of, no more is known than its number of triangles."""

    triangles: int
    surface: Surface | None = None

    def same(self, other: Source) -> bool:
        """Whether both are one mesh."""
        return self is other or (self.surface is not None and self.surface is other.surface)


@dataclass(frozen=True)
class Sources:
    """Meshes whose triangles are numbered through.

    kept: how many there were when those without an end were last dropped.
    """

    meshes: tuple[Source, ...] = ()
    kept: int = 0

    @property
    def starts(self) -> list[int]:
        """The first triangle of each mesh, and the number of all."""
        return [0, *itertools.accumulate(mesh.triangles for mesh in self.meshes)]

    def joined(self, others: Sources) -> tuple[Sources, list[tuple[int, int]]]:
        """Return the meshes of both, each once, and how those of *others* are renumbered."""
        meshes = list(self.meshes)
        places = []
        for other in others.meshes:
            place = next((at for at, mesh in enumerate(meshes) if mesh.same(other)), len(meshes))
            places.append(place)
            if place == len(meshes):
                meshes.append(other)
        joined = Sources(tuple(meshes), max(self.kept, others.kept))
        starts = joined.starts
        if starts[-1] >= CAP:
            raise MeshError(
                f"the meshes of a dexel model have {starts[-1]:,} triangles; fewer than {CAP:,} "
                "can be told apart"
            )
        renumbering = [
            (start, starts[place] - start)
            for start, place in zip(others.starts, places, strict=False)
        ]
        return joined, [] if all(by == 0 for _, by in renumbering) else renumbering

    def only(self, used: Sequence[bool]) -> tuple[Sources, list[tuple[int, int]]]:
        """Return the meshes that are used, and how their triangles are renumbered."""
        meshes = tuple(itertools.compress(self.meshes, used))
        renumbering, start = [], 0
        for old, mesh, kept in zip(self.starts, self.meshes, used, strict=False):
            renumbering.append((old, start - old))
            start += mesh.triangles if kept else 0
        return Sources(meshes, len(meshes)), renumbering

    def split(self, triangles: NDArray[np.int64]) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
        """Return of triangles numbered through the mesh, and the caller's number of each there.

        Both are -1 for `CAP`.
        """
        starts = np.array(self.starts)
        caps = triangles == CAP
        which = np.searchsorted(starts[1:], triangles, side="right").astype(np.int32)
        which[caps] = -1
        numbers = np.where(caps, -1, triangles - starts[which])
        for at, mesh in enumerate(self.meshes):
            if mesh.surface is not None and mesh.surface.face_numbers is not None:
                own = which == at
                numbers[own] = mesh.surface.face_numbers[numbers[own]]
        return which, numbers

    def normals(self, triangles: NDArray[np.int64]) -> NDArray[np.float64] | None:
        """Return the unit normal of triangles numbered through; None if a mesh is not at hand.

        Zero for `CAP` and for triangles without area.
        """
        found = np.zeros((len(triangles), 3))
        starts = self.starts
        for at, mesh in enumerate(self.meshes):
            own = (triangles >= starts[at]) & (triangles < starts[at + 1])
            if not own.any():
                continue
            if mesh.surface is None:
                return None
            faces = mesh.surface.faces[triangles[own] - starts[at]]
            a, b, c = (mesh.surface.vertices[faces[:, corner]] for corner in range(3))
            normal = np.cross(b - a, c - a)
            length = np.linalg.norm(normal, axis=1, keepdims=True)
            found[own] = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)
        return found
