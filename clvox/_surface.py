"""A checked mesh, and what is said of its faults."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clvox._blocks import in_blocks
from clvox.errors import NotClosedError, NotOrientedError


@dataclass(frozen=True, eq=False)
class Surface:
    """A welded and checked mesh, as `check` returns it.  Its arrays are read-only.

    Attributes
    ----------
    vertices : (n, 3) float64
        Each of them finite, different from all others, and used by a triangle.
    faces : (m, 3) int32
        Three different vertex numbers each; no two triangles have the same three vertices.
        Triangles without area are kept: they hold T-junctions shut.
    closed : bool
        Every edge belongs to an even number of triangles.
    oriented : bool
        Every edge is used equally often both ways; such a surface is closed, too.
    warnings : tuple of str
        What a user should know; empty for a flawless mesh.
    bounds : (2, 3) float64
        Lowest and highest corner.
    repeated : int
        Triangles dropped because a vertex number repeats after welding.
    duplicates : int
        Triangles dropped as copies of one with the same vertices and orientation.
    cancelled : int
        Triangles dropped in pairs with the same vertices and opposite orientation, both counted.
    welded_by : float
        The length within which vertices were merged; 0.0 if only equal ones were.
    face_numbers : (m,) int64 or None
        The caller's number of each triangle; None if no triangle was dropped.
    vertex_numbers : (n,) int64 or None
        The caller's number of each vertex, the lowest of those merged; None if all were kept.
    odd_edges, uneven_edges : (k, 2) int32
        The edges, as rows of `vertices`, that belong to an odd number of triangles, and that are
        not used equally often both ways.
    """

    vertices: NDArray[np.float64] = field(repr=False)
    faces: NDArray[np.int32] = field(repr=False)
    closed: bool
    oriented: bool
    warnings: tuple[str, ...]
    bounds: NDArray[np.float64]
    repeated: int
    duplicates: int
    cancelled: int
    welded_by: float
    face_numbers: NDArray[np.int64] | None = field(repr=False)
    vertex_numbers: NDArray[np.int64] | None = field(repr=False)
    odd_edges: NDArray[np.int32] = field(repr=False)
    uneven_edges: NDArray[np.int32] = field(repr=False)

    def require_closed(self) -> None:
        """Do nothing for a closed surface.

        Raises
        ------
        NotClosedError
            With the number of odd edges, and the caller's vertex numbers and the place of one.
        """
        if not self.closed:
            raise NotClosedError(
                f'{_open(self)}. A solid needs a closed surface; fill="winding" or fill="vote" '
                "guesses one, trimesh.repair.fill_holes may close it."
            )

    def require_oriented(self) -> None:
        """Do nothing for an oriented surface.

        Raises
        ------
        NotClosedError
            The surface is not even closed.
        NotOrientedError
            With the number of edges used more often one way than the other, and one of them.
        """
        self.require_closed()
        if not self.oriented:
            raise NotOrientedError(
                f"{_mixed(self)}. Winding numbers need each edge used equally often both ways; "
                'fill="parity" does not, trimesh.repair.fix_normals may orient it.'
            )

    def require_oriented_but_for_holes(self) -> None:
        """Do nothing for a surface whose triangles agree wherever they meet.

        Each edge that an even number of triangles share is then used equally often both ways; the
        others are the edges of holes.

        Raises
        ------
        NotOrientedError
            With the number of edges used more often one way than the other, and one of them.
        """
        # An odd edge cannot be even, so there is another one if there are more.
        if len(self.uneven_edges) == len(self.odd_edges):
            return
        count = np.int64(len(self.vertices))
        uneven, odd = (
            edges[:, 0] * count + edges[:, 1] for edges in (self.uneven_edges, self.odd_edges)
        )
        shared = self.uneven_edges[~np.isin(uneven, odd)]
        raise NotOrientedError(
            f"the triangles face different ways: {len(shared)} edges that several of them share "
            f"are used more often one way than the other, {_first(self, shared)}. Winding numbers "
            'need triangles that agree wherever they meet; fill="vote" does not, '
            "trimesh.repair.fix_normals may orient them."
        )


def _open(surface: Surface) -> str:
    count = np.int64(len(surface.vertices))
    corners, odd = surface.faces.astype(np.int64), surface.odd_edges.astype(np.int64)
    ends = np.roll(corners, -1, axis=1)
    sides = np.minimum(corners, ends) * count + np.maximum(corners, ends)
    several = len(odd) < int(np.isin(sides, odd[:, 0] * count + odd[:, 1]).sum())
    share = "an odd number of triangles" if several else "one triangle only"
    return f"the mesh is open: {len(odd)} edges belong to {share}, {_first(surface, odd)}"


def _mixed(surface: Surface) -> str:
    edges = surface.uneven_edges
    return (
        f"the mesh is not oriented: {len(edges)} edges are used more often one way than the "
        f"other, {_first(surface, edges)}"
    )


def _first(surface: Surface, edges: NDArray[Any]) -> str:
    a, b = edges[0].tolist()
    middle = surface.vertices[a] / 2 + surface.vertices[b] / 2
    if surface.vertex_numbers is not None:
        a, b = surface.vertex_numbers[[a, b]].tolist()
    place = ", ".join(f"{x:.6g}" for x in middle)
    return f"the first between vertices {a} and {b} near ({place})"


def _triangles(count: int) -> str:
    return "1 triangle was" if count == 1 else f"{count} triangles were"


def describe_defects(surface: Surface, crowded: int) -> Iterator[str]:
    """Yield a sentence for each thing that a user should know.

    crowded: edges that belong to more than two triangles.
    """
    if surface.repeated:
        yield f"{_triangles(surface.repeated)} dropped, with a vertex number twice"
    if surface.duplicates:
        yield f"{_triangles(surface.duplicates)} dropped, equal to another one"
    if surface.cancelled:
        yield (
            f"{_triangles(surface.cancelled)} dropped in pairs: "
            "two opposite sides of one triangle enclose nothing"
        )
    if crowded:
        yield f"some edges ({crowded}) belong to more than two triangles: surfaces touch there"
    if not surface.closed:
        yield _open(surface)
    elif not surface.oriented:
        yield f"{_mixed(surface)}; inside and outside are still told apart by parity"
    else:
        share = _volume_share(surface)
        # Rounding may make a volume of nothing negative, never by this much of the bounding box.
        if share < -1e-12:
            volume = share * float(np.prod(surface.bounds[1] - surface.bounds[0]))
            yield f"the mesh is inside out: its signed volume is {volume:.6g}"


def _volume_share(surface: Surface) -> float:
    """The signed volume, as a fraction of the bounding box."""
    x, y, z = np.ascontiguousarray(surface.vertices.T)
    low, high = surface.bounds
    parts: list[float] = []

    def add(at: int, end: int) -> None:
        part = surface.faces[at:end]
        corners = np.ascontiguousarray(part.T, dtype=np.intp)
        ax, bx, cx = x.take(corners)
        ay, by, cy = y.take(corners)
        height = z.take(corners).sum(axis=0) - 3 * low[2]
        # The prism between a triangle and the lowest plane.
        parts.append(float(((bx - ax) * (cy - ay) - (by - ay) * (cx - ax)) @ height))

    in_blocks(add, len(surface.faces))
    share = math.fsum(parts) / 6
    for length in (high - low).tolist():
        share /= length  # one by one: the volume of a tiny box would underflow to zero
    return share
