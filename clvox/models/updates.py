"""From a model and an edit of its mesh to the model of the edited mesh."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clvox._blocks import in_blocks
from clvox.device import Session
from clvox.errors import MeshError
from clvox.grid import Lattice
from clvox.mesh import MeshLike, Surface, check
from clvox.models.report import Report
from clvox.ops.boundary import count_flat
from clvox.ops.facets import upload_facets
from clvox.ops.layout import VoxelArrays
from clvox.ops.update import Edit, update, upload_corners

_BLOCK = 1 << 16
"""Triangles at a time."""

Source: TypeAlias = tuple[Surface, Lattice]
"""A mesh, and the lattice on which a model was made of it."""


def require_one_mesh(surfaces: tuple[Source, ...], report: Report) -> Source:
    """Return the mesh that a model is the voxels of, and nothing else.

    Raises
    ------
    MeshError
        There is none, or the model became another one since.
    """
    if len(surfaces) != 1 or not report.fill:
        raise MeshError(
            "this model is not that of one mesh: models read from a file, made from an array, "
            "combined or compacted cannot be updated. Update the models that it was made of."
        )
    return surfaces[0]


def check_edit(
    before: Surface, mesh: MeshLike | Surface, changed: ArrayLike
) -> tuple[Surface, NDArray[np.bool_]]:
    """Return the edited mesh, checked, and for each triangle of the caller's if it is in *changed*.

    Raises
    ------
    MeshError
        It has another number of triangles, or *changed* names some that are not there.
    """
    after = check(mesh)
    count = _given(before)
    if _given(after) != count:
        raise MeshError(
            f"the edited mesh has {_given(after)} triangles, the model's has {count}; an update "
            "needs the same triangles, moved. Voxelize it anew on the model's grid (grid=)."
        )
    return after, _listed(changed, count)


def update_arrays(
    session: Session,
    arrays: VoxelArrays,
    report: Report,
    source: Source,
    after: Surface,
    listed: NDArray[np.bool_],
) -> tuple[VoxelArrays, Report]:
    """Return the arrays of the edited mesh *after*, by parity, and how they were made.

    Not how much memory they took: that is for the caller's job to say.

    Parameters
    ----------
    arrays, report, source
        Of the model before.
    after, listed
        As from `check_edit`.

    Raises
    ------
    MeshError
        A triangle differs that is not listed.
    """
    before, lattice = source
    seconds = {}
    start = time.perf_counter()
    edit = _find_edit(before, after, listed, lattice)
    seconds["compare"] = time.perf_counter() - start
    start = time.perf_counter()
    facets = None
    if arrays.cells is not None:
        facets = upload_facets(session, lattice.snap(after.vertices), after.faces)
    seconds["upload"] = time.perf_counter() - start
    start = time.perf_counter()
    found = update(session, arrays, facets, edit, lattice.bits)
    gone, come = (count_flat(session, upload_corners(session, corners)) for corners in edit)
    session.finish()
    seconds["flip"] = time.perf_counter() - start
    return found, replace(
        report,
        seconds=seconds,
        triangles=len(after.faces),
        repeated=after.repeated,
        duplicates=after.duplicates,
        cancelled=after.cancelled,
        collapsed=report.collapsed - gone + come,
        warnings=after.warnings,
    )


def _given(surface: Surface) -> int:
    """Triangles of the mesh that the caller gave."""
    return len(surface.faces) + surface.repeated + surface.duplicates + surface.cancelled


def _listed(changed: ArrayLike, count: int) -> NDArray[np.bool_]:
    """A bool for each triangle: whether its number is in *changed*."""
    numbers = np.asarray(changed)
    if numbers.size == 0:
        numbers = numbers.astype(np.int64)
    if numbers.ndim != 1 or numbers.dtype.kind not in "iu":
        raise MeshError(
            f"changed must be triangle numbers, (n,) integers; got an array of "
            f"{numbers.dtype} of the shape {numbers.shape}"
        )
    wrong = numbers[(numbers < 0) | (numbers >= count)]
    if len(wrong):
        raise MeshError(f"changed names triangle {wrong[0]}; the mesh has {count}, numbered from 0")
    listed = np.zeros(count, np.bool_)
    listed[numbers] = True
    return listed


def _find_edit(
    before: Surface, after: Surface, listed: NDArray[np.bool_], lattice: Lattice
) -> Edit:
    """The triangles that differ.

    Only those *listed* may, and those that the check drops from one mesh and keeps in the other.
    """
    differ = _differing(before, after, len(listed))
    moved = np.flatnonzero((differ == _MOVED) & ~listed)
    if len(moved):
        raise MeshError(
            f"triangle {moved[0]} is not where it was, and not in changed; nor are "
            f"{len(moved) - 1} more. List all triangles that have a vertex that moved."
        )
    rows = [np.flatnonzero(_of_kept(differ, each) != _SAME) for each in (before, after)]
    corners = [
        lattice.snap(each.vertices.take(each.faces.take(some, axis=0).reshape(-1), axis=0))
        for each, some in zip((before, after), rows, strict=True)
    ]
    one, other = (each.reshape(-1, 3, 3) for each in corners)
    return Edit(one, other)


_SAME, _MOVED, _DROPPED = 0, 1, 2


def _differing(before: Surface, after: Surface, count: int) -> NDArray[np.int8]:
    """For each triangle that the caller gave: the same, moved, or kept in one mesh only."""
    if _alike(before, after):
        return _changed_rows(before, after)
    differ = np.full(count, _SAME, np.int8)
    rows = np.full((2, count), -1)
    for row, surface in zip(rows, (before, after), strict=True):
        row[_face_numbers(surface)] = np.arange(len(surface.faces))
    kept = rows >= 0
    differ[kept[0] != kept[1]] = _DROPPED
    both = np.flatnonzero(kept.all(axis=0))
    for start in range(0, len(both), _BLOCK):
        some = both[start : start + _BLOCK]
        one, other = (
            surface.vertices[surface.faces[row[some]]]
            for row, surface in zip(rows, (before, after), strict=True)
        )
        differ[some[(one != other).any(axis=(1, 2))]] = _MOVED
    return differ


def _alike(before: Surface, after: Surface) -> bool:
    """Whether vertices and triangles have the same numbers in both."""
    if before.face_numbers is not None or after.face_numbers is not None:
        return False
    if len(before.vertices) != len(after.vertices):
        return False
    # As many are left also if one was parted from another and two others were joined.
    one, other = before.vertex_numbers, after.vertex_numbers
    return one is other if one is None or other is None else np.array_equal(one, other)


def _changed_rows(before: Surface, after: Surface) -> NDArray[np.int8]:
    """The same for meshes whose numbers are alike."""
    moved = np.zeros(len(before.vertices), np.bool_)
    differ = np.zeros(len(before.faces), np.int8)

    def compare(at: int, end: int) -> None:
        apart = before.vertices[at:end] != after.vertices[at:end]
        moved[at:end] = apart[:, 0] | apart[:, 1] | apart[:, 2]

    def look_up(at: int, end: int) -> None:
        faces = after.faces[at:end]
        apart = (before.faces[at:end] != faces) | moved.take(faces)
        differ[at:end] = apart[:, 0] | apart[:, 1] | apart[:, 2]

    in_blocks(compare, len(moved))
    in_blocks(look_up, len(differ))
    return differ


def _of_kept(differ: NDArray[np.int8], surface: Surface) -> NDArray[np.int8]:
    """What is said of the triangles that the check has kept."""
    return differ if surface.face_numbers is None else differ[surface.face_numbers]


def _face_numbers(surface: Surface) -> NDArray[np.int64]:
    numbers = surface.face_numbers
    return np.arange(len(surface.faces)) if numbers is None else numbers
