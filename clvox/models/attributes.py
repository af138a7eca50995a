"""What a model keeps of the mesh that it was made of: touched voxels, normals, triangles."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from clvox.device import Session
from clvox.errors import GridError, MeshError
from clvox.grid import Lattice
from clvox.mesh import Surface
from clvox.ops.attributes import (
    Touched,
    faces_of,
    link_faces,
    normals_of,
    number_touched,
    sum_normals,
)
from clvox.ops.facets import upload_facets
from clvox.ops.layout import VoxelArrays
from clvox.reference.attributes import unpack_normals

if TYPE_CHECKING:
    import pyopencl.array as cla

Attribute: TypeAlias = Literal["edge", "normals", "area_normals", "links"]
"""What `voxelize` can keep: see there."""

UNIT = 32767
"""Length of a triangle's normal, as integers, where all triangles count alike."""

SUM_BITS, HEAVIEST_BITS, LIGHTEST_BITS = 46, 30, 8
"""Bits of the sum of all normals weighted by area, and of the longest and the shortest of them."""

PART = 1 << 14
"""Triangles whose normals are worked out at once."""


@dataclass(frozen=True)
class Attributes:
    """Arrays on the device, as docs/layouts draws them.

    names: what was asked for.  normals: (touched voxels,) uint32.  offsets, faces: the triangles
    of each boundary cell, as compressed rows.  inwards: the mesh's triangles face inwards.
    """

    names: tuple[Attribute, ...]
    touched: Touched
    normals: cla.Array | None = None
    offsets: cla.Array | None = None
    faces: cla.Array | None = None
    inwards: bool = False

    @property
    def nbytes(self) -> int:
        """Bytes on the device."""
        held = self.touched.edge, self.touched.rank, self.normals, self.offsets, self.faces
        return sum(array.nbytes for array in held if array is not None)

    def normals_at(self, session: Session, voxels: NDArray[np.int32]) -> NDArray[np.float64]:
        """Return the unit normals of *voxels*; 0, three times, for one that is not touched."""
        if self.normals is None:
            raise MeshError(
                "this model has no normals. Ask for them when it is made: "
                'voxelize(..., attributes=("normals",)).'
            )
        return unpack_normals(normals_of(session, self.touched, self.normals, voxels))

    def faces_at(
        self, session: Session, voxels: NDArray[np.int32], numbers: NDArray[np.int64] | None
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the caller's numbers of the triangles in the cells of *voxels*, as rows."""
        if self.offsets is None or self.faces is None:
            raise MeshError(
                "this model has no links to triangles. Ask for them when it is made: "
                'voxelize(..., attributes=("links",)).'
            )
        ends, faces = faces_of(session, self.touched, self.offsets, self.faces, voxels)
        return ends, faces.astype(np.int64) if numbers is None else numbers[faces]


def check_names(names: Sequence[str]) -> tuple[Attribute, ...]:
    """Return what is to be kept, without repetitions.

    Raises
    ------
    GridError
        There is no such attribute, or both kinds of normals are asked for.
    """
    known = get_args(Attribute)
    wrong = [name for name in ([names] if isinstance(names, str) else names) if name not in known]
    if isinstance(names, str) or wrong:
        raise GridError(
            f"attributes must be a sequence of {', '.join(map(repr, known))}, got {names!r}"
        )
    found = tuple(name for name in known if name in names)
    if {"normals", "area_normals"} <= set(found):
        raise GridError(
            "a model keeps one normal of a voxel: ask for 'normals', in which all triangles count "
            "alike, or for 'area_normals'"
        )
    return found


def build_attributes(
    session: Session,
    arrays: VoxelArrays,
    edge: cla.Array,
    surface: Surface,
    lattice: Lattice,
    names: tuple[Attribute, ...],
) -> Attributes:
    """Return the attributes *names* of a model made of one surface.

    edge: which voxels are touched, laid out like the voxels.
    """
    touched = number_touched(session, arrays, edge)
    facets = upload_facets(session, lattice.snap(surface.vertices), surface.faces)
    normals = offsets = faces = None
    vectors, inwards = _area_vectors(surface)
    if {"normals", "area_normals"} & set(names):
        given = triangle_normals(vectors, by_area="area_normals" in names)
        normals = sum_normals(session, facets, lattice.bits, touched, given)
    if "links" in names:
        offsets, faces = link_faces(session, facets, lattice.bits, touched)
    return Attributes(names, touched, normals, offsets, faces, inwards)


def _area_vectors(surface: Surface) -> tuple[NDArray[np.float64], bool]:
    """Return the normal of each triangle, twice as long as it is large, and if they point inwards.

    They do where the mesh holds less than nothing.
    """
    vectors, volume = np.empty((len(surface.faces), 3)), 0.0
    origin = surface.vertices[:1]
    for part in _parts(len(vectors)):
        a, b, c = (surface.vertices[surface.faces[part, corner]] for corner in range(3))
        vectors[part] = np.cross(b - a, c - a)
        volume += float(np.einsum("ij,ij->", a - origin, vectors[part]))
    return vectors, volume < 0


def _parts(count: int) -> Iterator[slice]:
    """Triangles, some after the other, whose numbers fit into a processor's cache."""
    return (slice(first, first + PART) for first in range(0, count, PART))


def triangle_normals(vectors: NDArray[np.float64], *, by_area: bool = False) -> NDArray[np.int32]:
    """Return the normal of each triangle as integers; 0, three times, without area.

    All of one length, `UNIT`; or, *by_area*, as long as the triangle is large, in proportion, but
    none so short that its direction would be lost.  vectors: normals, as long as triangles are
    large.
    """
    lengths = np.sqrt(np.einsum("ij,ij->i", vectors, vectors))
    most = 2.0 ** min(HEAVIEST_BITS, SUM_BITS - 1 - len(vectors).bit_length())
    scale = most / max(lengths.max(initial=0.0), np.finfo(np.float64).tiny)
    normals = np.empty(vectors.shape, np.int32)
    for part in _parts(len(vectors)):
        length = lengths[part]
        wanted = np.maximum(length * scale, 2.0**LIGHTEST_BITS) if by_area else float(UNIT)
        factor = wanted / np.where(length > 0, length, 1.0)
        normals[part] = np.rint(vectors[part] * factor[:, None])
    return normals
