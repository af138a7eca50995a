"""How much volume the lattice may cost: see docs/algorithms/measures.md."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from clvox.grid import Lattice
from clvox.mesh import Surface

_BLOCK = 1 << 16
"""Triangles at a time."""

_ROUNDING = 2.0**-26
"""Largest error, in steps, of a lattice position below 2**24 that three roundings went into."""


def swept_volume(surface: Surface, lattice: Lattice) -> float:
    """Return a bound on the volume that a surface sweeps while its vertices move to the lattice.

    Only triangles that may come into the grid's box count.  Each point that the solid gains or
    loses is swept, so the volume within the box changes by no more than this.
    """
    grid = lattice.grid
    lowest, highest = -(2.0 ** (lattice.bits - 1)), 2.0**lattice.bits * (np.array(grid.shape) - 0.5)
    total = 0.0
    for start in range(0, len(surface.faces), _BLOCK):
        points = surface.vertices[surface.faces[start : start + _BLOCK]]
        exact = ((points - grid.origin) / grid.spacing - 0.5) * 2.0**lattice.bits
        snapped = np.rint(exact)
        # A step more than any vertex moves.
        near = (snapped.min(axis=1) <= highest + 1) & (snapped.max(axis=1) >= lowest - 1)
        held = near.all(axis=1)
        total += _swept(exact[held], snapped[held])
    # The sum's own rounding, generously.
    return total * (1 + 1e-9) * math.prod(lattice.step)


def _swept(exact: NDArray[np.float64], snapped: NDArray[np.float64]) -> float:
    """Bound for triangles (n, 3 corners, 3 axes), in cubic steps."""
    moved = np.abs(snapped - exact).max(axis=1) + _ROUNDING
    one, other = snapped[:, 1] - snapped[:, 0], snapped[:, 2] - snapped[:, 0]
    normal = np.abs(np.cross(one, other))
    length = np.abs(one) + np.abs(other)
    total = 0.0
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        # Twice the area across axis a, at any time: each edge changes by at most twice `moved`.
        across = (
            normal[:, a]
            + 2 * (length[:, b] * moved[:, c] + length[:, c] * moved[:, b])
            + 8 * moved[:, b] * moved[:, c]
        )
        total += float((moved[:, a] * across).sum()) / 2
    return total
