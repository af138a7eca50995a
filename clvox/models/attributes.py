"""What a model keeps of the mesh that it was made of: touched voxels, normals, triangles."""

from __future__ import annotations

from collections.abc import Sequence
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
    if {"normals", "area_normals"} & set(names):
        given = triangle_normals(surface, by_area="area_normals" in names)
        normals = sum_normals(session, facets, lattice.bits, touched, given)
    if "links" in names:
        offsets, faces = link_faces(session, facets, lattice.bits, touched)
    a, b, c = (surface.vertices[surface.faces[:, corner]] for corner in range(3))
    inwards = float(np.einsum("ij,ij->", a - a[:1], np.cross(b - a[:1], c - a[:1]))) < 0
    return Attributes(names, touched, normals, offsets, faces, inwards)


def triangle_normals(surface: Surface, *, by_area: bool = False) -> NDArray[np.int32]:
    """Return the normal of each triangle as integers; 0, three times, without area.

    All of one length, `UNIT`; or, *by_area*, as long as the triangle is large, in proportion, but
    none so short that its direction would be lost.
    """
    a, b, c = (surface.vertices[surface.faces[:, corner]] for corner in range(3))
    vectors = np.cross(b - a, c - a)
    lengths = np.linalg.norm(vectors, axis=1)
    units = vectors / np.where(lengths > 0, lengths, 1.0)[:, None]
    if not by_area:
        return np.rint(units * UNIT).astype(np.int32)
    most = 2.0 ** min(HEAVIEST_BITS, SUM_BITS - 1 - len(units).bit_length())
    weights = lengths / max(lengths.max(initial=0.0), np.finfo(np.float64).tiny) * most
    weighted: NDArray[np.float64] = units * np.maximum(weights, 2.0**LIGHTEST_BITS)[:, None]
    return np.rint(weighted).astype(np.int32)
