"""From a model and an edit of its mesh to the model of the edited mesh."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clvox.errors import MeshError
from clvox.grid import Lattice
from clvox.mesh import MeshLike, Surface, check
from clvox.ops.boundary import count_flat
from clvox.ops.facets import upload_facets
from clvox.ops.update import Edit, update

if TYPE_CHECKING:
    from clvox.models.voxels import VoxelModel

_BLOCK = 1 << 16
"""Triangles at a time."""


def updated(model: VoxelModel, mesh: MeshLike | Surface, changed: ArrayLike) -> VoxelModel:
    """Return the model of *mesh*: see `VoxelModel.updated`."""
    before, lattice = _source(model)
    after = check(mesh)
    count = _given(before)
    if _given(after) != count:
        raise MeshError(
            f"the edited mesh has {_given(after)} triangles, the model's has {count}; an update "
            "needs the same triangles, moved. Voxelize it anew on the model's grid (grid=)."
        )
    listed = _numbers(changed, count)
    if model.report.fill != "parity":
        return _anew(model, after, lattice.bits)
    after.require_closed()
    # Also says whether the edited mesh has room on the lattice.
    lattice = Lattice.fit(model.grid, after.bounds, bits=lattice.bits)

    model._session.reset_peak()
    seconds = {}
    start = time.perf_counter()
    edit = _find_edit(before, after, listed, lattice)
    seconds["compare"] = time.perf_counter() - start
    start = time.perf_counter()
    facets = None
    if len(model.levels) > 1:
        facets = upload_facets(model._session, lattice.snap(after.vertices), after.faces)
    seconds["upload"] = time.perf_counter() - start
    start = time.perf_counter()
    arrays = update(model._session, model._arrays, facets, edit, lattice.bits)
    gone, come = (_flat(model, corners) for corners in edit)
    model._session.finish()
    seconds["flip"] = time.perf_counter() - start
    report = replace(
        model.report,
        seconds=seconds,
        triangles=len(after.faces),
        repeated=after.repeated,
        duplicates=after.duplicates,
        cancelled=after.cancelled,
        collapsed=model.report.collapsed - gone + come,
        peak_nbytes=model._session.peak_nbytes,
        warnings=after.warnings,
    )
    surfaces = ((after, lattice),)
    return replace(model, _arrays=arrays, report=report, _surfaces=surfaces)


def _source(model: VoxelModel) -> tuple[Surface, Lattice]:
    if len(model._surfaces) != 1 or not model.report.fill:
        raise MeshError(
            "this model is not that of one mesh: models read from a file, made from an array, "
            "combined or compacted cannot be updated. Update the models that it was made of."
        )
    return model._surfaces[0]


def _anew(model: VoxelModel, surface: Surface, bits: int) -> VoxelModel:
    """By any rule but parity a triangle may change voxels far from where it is."""
    from clvox.models.build import voxelize

    return voxelize(
        surface,
        grid=model.grid,
        levels=model.levels,
        fill=model.report.fill,  # type: ignore[arg-type]
        lattice_bits=bits,
        device=model._session.device,
    )


def _given(surface: Surface) -> int:
    """Triangles of the mesh that the caller gave."""
    return len(surface.faces) + surface.repeated + surface.duplicates + surface.cancelled


def _numbers(changed: ArrayLike, count: int) -> NDArray[np.bool_]:
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
        raise MeshError(
            f"changed names triangle {wrong[0]}; the mesh has {count}, numbered from 0"
        )
    listed = np.zeros(count, np.bool_)
    listed[numbers] = True
    return listed


def _find_edit(
    before: Surface, after: Surface, listed: NDArray[np.bool_], lattice: Lattice
) -> Edit:
    """The triangles that differ; only those *listed*, and those that are dropped by the check in
    one mesh and kept in the other, may."""
    differ = _differing(before, after, len(listed))
    moved = np.flatnonzero((differ == _MOVED) & ~listed)
    if len(moved):
        raise MeshError(
            f"triangle {moved[0]} is not where it was, and not in changed; nor are "
            f"{len(moved) - 1} more. List all triangles that have a vertex that moved."
        )
    rows = [np.flatnonzero(differ[_face_numbers(each)] != _SAME) for each in (before, after)]
    corners = [
        lattice.snap(each.vertices[each.faces[some]].reshape(-1, 3)).reshape(-1, 3, 3)
        for each, some in zip((before, after), rows, strict=True)
    ]
    return Edit(*corners)


_SAME, _MOVED, _DROPPED = 0, 1, 2


def _differing(before: Surface, after: Surface, count: int) -> NDArray[np.int8]:
    """For each triangle that the caller gave: the same, moved, or kept in one mesh only."""
    if _alike(before, after):
        gone = (before.vertices != after.vertices).any(axis=1)
        return (gone[after.faces].any(axis=1) | (before.faces != after.faces).any(axis=1)).astype(
            np.int8
        )
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
    return (
        before.face_numbers is None
        and after.face_numbers is None
        and len(before.vertices) == len(after.vertices)
    )


def _face_numbers(surface: Surface) -> NDArray[np.int64]:
    numbers = surface.face_numbers
    return np.arange(len(surface.faces)) if numbers is None else numbers


def _flat(model: VoxelModel, corners: NDArray[np.int32]) -> int:
    faces = np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3)
    facets = upload_facets(model._session, corners.reshape(-1, 3), faces)
    return count_flat(model._session, facets)
