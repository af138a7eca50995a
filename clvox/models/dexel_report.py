"""What a dexel model tells of itself."""

from __future__ import annotations

from dataclasses import dataclass

from clvox.models.report import Report


@dataclass(frozen=True)
class DexelReport(Report):
    """How a dexel model was built, and what its rays are like.

    Attributes besides those of `Report`, whose stages are snap, upload and list:

    Attributes
    ----------
    crossings : int
        Crossings of all rays; of a model made of others, ends of its pieces.
    deepest : int
        Most crossings of one ray.
    deepest_ray : (int, int)
        The first such ray, as an index into an array of the shape `DexelModel.rays_shape`.
    thinnest : float
        Length of the shortest piece; 0.0 if there is none.
    thinnest_ray : (int, int) or None
        The first ray that has such a piece.
    odd_triangles : tuple of int
        Triangles, a hundred at most, that odd rays cross; a closed mesh has no such rays.
    """

    crossings: int = 0
    deepest: int = 0
    deepest_ray: tuple[int, int] = (0, 0)
    thinnest: float = 0.0
    thinnest_ray: tuple[int, int] | None = None
    odd_triangles: tuple[int, ...] = ()
