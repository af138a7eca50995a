"""The mesh of a build: on the device if there is room, else sent there part by part."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from clvox.device import Session
from clvox.ops.facets import FacetChunks, Facets, Mesh, pad

BYTES_PER_TRIANGLE = 72
"""What a triangle of a part takes: corners 36, numbers 12, lists 16; and what the pool rounds."""

VISIT_BYTES = 18
"""What visiting a triangle takes: its entries in lists, and what the pool rounds."""


class SentMesh:
    """A mesh on the lattice, on the device as far as there is room.

    vertices: (n, 3) int32, lattice steps; faces: (m, 3) int32; both on the host.
    """

    def __init__(
        self, session: Session, vertices: NDArray[np.int32], faces: NDArray[np.int32]
    ) -> None:
        self._session = session
        self._vertices = vertices
        self._faces = faces
        self._row: NDArray[np.int32] | None = None
        self.facets: Mesh = FacetChunks(vertices, faces, 1)

    @property
    def nbytes(self) -> int:
        """Bytes that it takes on the device as long as nobody visits it."""
        if not isinstance(self.facets, Facets):
            return 0
        return sum(self._session.size_of(array.nbytes) for array in self.facets)

    def fit(self, room: int) -> None:
        """Let the mesh, and what visiting it takes, be in *room* bytes."""
        size_of, largest = self._session.size_of, self._session.device.largest_allocation
        padded = self._vertices.nbytes + self._vertices.itemsize
        sizes = size_of(padded), size_of(self._faces.nbytes)
        whole = sum(sizes) + VISIT_BYTES * len(self._faces)
        if whole > room or max(sizes) > largest:
            most = max(min(room, largest) // BYTES_PER_TRIANGLE, 1)
            self.facets = FacetChunks(self._vertices, self._faces, most)
        elif not isinstance(self.facets, Facets):
            # They stay here as long as they are visited.
            self._row = pad(self._vertices)
            share = self._session.share
            self.facets = Facets(share(self._row), share(self._faces))
