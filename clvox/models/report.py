"""How a model was built."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Self

from clvox.grid import Lattice
from clvox.mesh import Surface

MOST_DOUBTFUL = 1000
"""Most doubtful rays of each axis that a report names."""


@dataclass(frozen=True)
class Report:
    """How a model was built.

    Attributes
    ----------
    device : str
    fill : str
        The rule that says what is inside, see `voxelize`; "" for a model made of others.
    seconds : dict
        Seconds per stage.  `voxelize`: snap, upload, mark, rank, clear, flip and carry, those of
        them that the levels and the fill need; by "vote" and "winding" upload, with the snapping
        in it, and all the rest by the name of the fill; in either case attributes, if some are
        kept.  `VoxelModel.updated`: compare, upload, which snaps, and flip.
    triangles : int
        Triangles cast; `repeated` were dropped since a vertex number repeats, of `duplicates`
        one each was kept, and `cancelled` lay back to back.
    collapsed : int
        Triangles without area on the lattice; they are kept, since they hold surfaces shut.
    odd_rays : int
        Rays that cross the mesh an odd number of times: 0 on a closed mesh.
    doubtful_rays : dict of str to int
        For the fill "vote" such rays along "x", "y" and "z" apart: there one end of the ray says
        in where the other says out.
    first_doubtful_rays : tuple of (str, int, int)
        The first of them, `MOST_DOUBTFUL` for each axis: the axis, and the voxel indices along
        the other two, the earlier of x, y, z first.
    lattice_bits : int
        Steps of the lattice in a voxel, as a power of two.
    peak_nbytes : int
        Most bytes of device memory that building took at once, the model included; those of
        other models do not count.
    warnings : tuple of str
        What a user should know about the mesh.
    """

    device: str
    fill: str = ""
    seconds: dict[str, float] = field(default_factory=dict)
    triangles: int = 0
    repeated: int = 0
    duplicates: int = 0
    cancelled: int = 0
    collapsed: int = 0
    odd_rays: int = 0
    doubtful_rays: dict[str, int] = field(default_factory=dict)
    first_doubtful_rays: tuple[tuple[str, int, int], ...] = ()
    lattice_bits: int = 0
    peak_nbytes: int = 0
    warnings: tuple[str, ...] = ()

    @classmethod
    def of_mesh(cls, device: object, surface: Surface, lattice: Lattice, fill: str) -> Self:
        """What is known before anything is built."""
        return cls(
            device=str(device),
            fill=fill,
            triangles=len(surface.faces),
            repeated=surface.repeated,
            duplicates=surface.duplicates,
            cancelled=surface.cancelled,
            lattice_bits=lattice.bits,
            warnings=surface.warnings,
        )
