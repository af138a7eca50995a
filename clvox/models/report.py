"""How a model was built."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Report:
    """How a model was built.

    Attributes
    ----------
    device : str
    fill : str
        The rule that says what is inside, see `voxelize`; "" for a model made of others.
    seconds : dict
        Seconds per stage: snap, upload, mark, rank, clear, flip, carry.
    triangles : int
        Triangles cast; `repeated` were dropped since a vertex number repeats, of `duplicates`
        one each was kept, and `cancelled` lay back to back.
    collapsed : int
        Triangles without area on the lattice; they are kept, since they hold surfaces shut.
    odd_rays : int
        Rays that cross the mesh an odd number of times: 0 on a closed mesh.
    lattice_bits : int
        Steps of the lattice in a voxel, as a power of two.
    peak_nbytes : int
        Most bytes of device memory in use while it was built.
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
    lattice_bits: int = 0
    peak_nbytes: int = 0
    warnings: tuple[str, ...] = ()
