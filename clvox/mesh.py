"""Load a mesh and check whether it is finite, closed, and oriented.

`load` reads a file as it is.  `check` welds the vertices, drops what encloses nothing, and counts
how often each edge is used; everything above works on the `Surface` that comes back and asks no
such question again.
"""

from __future__ import annotations

import os
import weakref
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from clvox import formats
from clvox._blocks import BLOCK, in_blocks
from clvox._surface import Surface, describe_defects
from clvox._weld import Mesh, Rest, first_equal, first_near, resolve
from clvox.errors import FormatError, MeshError

__all__ = ["LARGEST", "WELD_TOLERANCE", "MeshLike", "Surface", "check", "load"]

MeshLike: TypeAlias = trimesh.Trimesh | str | os.PathLike[str] | tuple[ArrayLike, ArrayLike]
"""What `check` takes: a mesh, the path of a file, or (vertices, faces)."""

WELD_TOLERANCE = 1e-8
"""Vertices of an open mesh are welded within this fraction of its longest side."""

LARGEST = 1e18
"""Largest coordinate: areas do not overflow float32, nor volumes a double."""

_MAX_VERTICES = 2**31 - 1


def load(path: str | os.PathLike[str]) -> trimesh.Trimesh:
    """Return the mesh in a file, as it is: nothing is merged, reordered or dropped.

    Parameters
    ----------
    path : str or path
        An STL file (ASCII or binary), OBJ, PLY, OFF, GLB, glTF or 3MF, each also compressed as
        ``.gz``.  Polygons become fans of triangles; all objects of a file become one mesh, each
        where the file places it.

    Returns
    -------
    trimesh.Trimesh
        With float64 vertices.  Three vertices per triangle for STL, which knows no others.  From
        glTF and 3MF, `face_attributes` has ``"body"``, (m,) int32: the number of the body that
        each triangle belongs to, in the order of the file; and `units` is the file's unit of
        length, such as ``"millimeter"``: always ``"meter"`` for glTF.

    Raises
    ------
    FormatError
        The suffix is not one of these, or the content is not what the suffix or the header says.
    OSError
        The file cannot be opened; FileNotFoundError if there is none.
    """
    where = Path(path)
    if where.is_dir():
        raise FormatError(f"{where} is a folder; expected a mesh file")
    try:
        found = formats.read(where)
    except FormatError as error:
        raise FormatError(f"{where.name}: {error}") from None
    mesh = trimesh.Trimesh(found.vertices, found.faces, process=False, validate=False)
    if found.bodies is not None:
        mesh.face_attributes["body"] = found.bodies
    if found.units is not None:
        mesh.units = found.units
    return mesh


def check(mesh: MeshLike | Surface) -> Surface:
    """Return *mesh* welded and checked.

    Vertices are welded where they are equal and, if the mesh is open then, the vertices of its
    odd edges within `WELD_TOLERANCE` of its longest side, with a warning.  An open mesh is no
    error here: see `Surface.require_closed`.

    Parameters
    ----------
    mesh : trimesh.Trimesh, path, or (vertices, faces)
        Vertices (n, 3), any real numbers; faces (m, 3), integers.  A Trimesh is checked once: the
        result is kept until its vertices or faces change.  A Surface comes back as it is.

    Returns
    -------
    Surface

    Raises
    ------
    MeshError
        No triangles; a wrong shape or type; a vertex number out of range; a coordinate that is
        not finite or beyond `LARGEST`; no extent along some axis; or no triangle with an area.
    FormatError
        From `load`.
    """
    if isinstance(mesh, Surface):
        return mesh
    if isinstance(mesh, str | os.PathLike):
        mesh = load(mesh)
        return _check(mesh.vertices, mesh.faces)
    if isinstance(mesh, trimesh.Trimesh):
        return _check_once(mesh)
    if isinstance(mesh, Sequence) and len(mesh) == 2:
        return _check(*mesh)
    raise MeshError(
        f"a mesh must be a trimesh.Trimesh, a path, or (vertices, faces); got a "
        f"{type(mesh).__name__}. trimesh turns a Scene into a mesh with scene.to_mesh()."
    )


# --- one check per mesh -------------------------------------------------------------------------

_seen: dict[int, tuple[weakref.ref[trimesh.Trimesh], tuple[int, ...], Surface]] = {}


def _check_once(mesh: trimesh.Trimesh) -> Surface:
    key = id(mesh)
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    print_ = (*vertices.shape, *faces.shape, _fingerprint(vertices), _fingerprint(faces))
    known = _seen.get(key)
    if known is not None and known[0]() is mesh and known[1] == print_:
        return known[2]
    surface = _check(vertices, faces)

    def forget(dead: weakref.ref[trimesh.Trimesh]) -> None:
        # The number may have passed to a younger mesh by now, whose entry has to stay.
        if key in _seen and _seen[key][0] is dead:
            del _seen[key]

    _seen[key] = weakref.ref(mesh, forget), print_, surface
    return surface


_WEIGHTS = np.random.default_rng(20170508).integers(0, 2**64, 1 << 14, np.uint64) | np.uint64(1)


def _fingerprint(array: NDArray[Any]) -> int:
    """A 64-bit number that changes with the content.

    trimesh keeps a hash too, but without the optional xxhash that takes longer than the check.
    The weights are odd, so that a change of a single word never goes unnoticed.
    """
    words = np.ascontiguousarray(array).reshape(-1).view(np.uint64)
    total = 0
    for start in range(0, len(words), len(_WEIGHTS)):
        part = words[start : start + len(_WEIGHTS)]
        total = (total * 0x9E3779B97F4A7C15 + int(part @ _WEIGHTS[: len(part)])) % 2**64
    return total


# --- the check ----------------------------------------------------------------------------------


def _check(vertices: ArrayLike, faces: ArrayLike) -> Surface:
    points, corners = _vertices(vertices), _faces(faces)
    triangles, used = _narrowed(corners, len(points))
    mesh = Mesh(points, triangles, None).limited(used)
    bounds = _bounds(mesh)
    _refuse_flat(bounds)

    first = first_equal(mesh.points)
    if first is not None:
        mesh = mesh.merged(first)
    rest = resolve(mesh)
    warnings: list[str] = []
    welded_by = 0.0
    if len(rest.odd):
        near = WELD_TOLERANCE * float((bounds[1] - bounds[0]).max())
        merged = _merged_near(mesh, rest, near)
        if merged is not None:
            warnings.append(
                f"{len(mesh.points) - len(merged[0].points)} vertices were merged with others "
                f"within {near:.3g}, {WELD_TOLERANCE:g} of the mesh's size: welded by equal "
                "coordinates alone it is open"
            )
            (mesh, rest), welded_by = merged, near
    if not len(rest.kept):
        raise MeshError(
            f"nothing is left of {len(mesh.triangles)} triangles: {rest.repeated} use a vertex "
            f"twice, {rest.cancelled} are opposite sides of one triangle. A solid needs a closed "
            "surface around it."
        )
    whole = len(rest.kept) == len(mesh.triangles)
    if not whole:
        mesh = _trimmed(mesh, rest)
    if not whole or welded_by:
        bounds = _bounds(mesh)
        _refuse_flat(bounds)
    _refuse_without_area(mesh, bounds)
    arrays = (mesh.points, mesh.triangles, bounds, rest.odd, rest.uneven, rest.kept, mesh.numbers)
    for array in arrays:
        if array is not None:
            array.flags.writeable = False
    surface = Surface(
        vertices=mesh.points,
        faces=mesh.triangles,
        closed=not len(rest.odd),
        oriented=not len(rest.uneven),
        warnings=(),
        bounds=bounds,
        repeated=rest.repeated,
        duplicates=rest.duplicates,
        cancelled=rest.cancelled,
        welded_by=welded_by,
        face_numbers=None if whole else rest.kept,
        vertex_numbers=mesh.numbers,
        odd_edges=rest.odd,
        uneven_edges=rest.uneven,
    )
    return replace(surface, warnings=(*warnings, *describe_defects(surface, rest.crowded)))


def _merged_near(mesh: Mesh, rest: Rest, length: float) -> tuple[Mesh, Rest] | None:
    """The mesh with vertices of odd edges merged within *length*; None if that closes nothing."""
    first = first_near(mesh.points, np.unique(rest.odd), length)
    if first is None:
        return None
    merged = mesh.merged(first)
    closer = resolve(merged)
    return (merged, closer) if len(closer.odd) < len(rest.odd) and len(closer.kept) else None


def _trimmed(mesh: Mesh, rest: Rest) -> Mesh:
    """The mesh of the triangles that are kept; the edges in *rest* are renumbered with it."""
    triangles = mesh.triangles[rest.kept]
    used = np.zeros(len(mesh.points), bool)
    used[triangles.reshape(-1)] = True
    trimmed = replace(mesh, triangles=triangles).limited(used)
    if len(trimmed.points) < len(mesh.points):
        names = np.arange(len(mesh.points)) if mesh.numbers is None else mesh.numbers
        rest.odd, rest.uneven = (
            np.searchsorted(np.asarray(trimmed.numbers), names[edges]).astype(np.int32)
            for edges in (rest.odd, rest.uneven)
        )
    return trimmed


# --- what is refused ----------------------------------------------------------------------------


def _vertices(value: ArrayLike) -> NDArray[np.float64]:
    """A copy, with -0.0 turned into 0.0, so that equal coordinates have equal bits."""
    array = _array("vertices", value)
    if array.dtype.kind not in "iuf" or array.ndim != 2 or array.shape[1] != 3:
        raise MeshError(
            f"vertices must be real numbers of shape (n, 3), got {array.dtype} {array.shape}"
        )
    if len(array) > _MAX_VERTICES:
        raise MeshError(f"a mesh may have {_MAX_VERTICES} vertices, got {len(array)}")
    with np.errstate(over="ignore"):
        # An array may come with wider floats than float64, and in any order in memory.
        doubles = np.ascontiguousarray(array, dtype=np.float64)
    return doubles + 0.0


def _faces(value: ArrayLike) -> NDArray[Any]:
    array = _array("faces", value)
    if array.size == 0:
        raise MeshError("the mesh has no triangles")
    if array.dtype.kind not in "iu" or array.ndim != 2 or array.shape[1] != 3:
        raise MeshError(f"faces must be integers of shape (m, 3), got {array.dtype} {array.shape}")
    return np.ascontiguousarray(array)


def _array(name: str, value: ArrayLike) -> NDArray[Any]:
    try:
        return np.asarray(value)
    except ValueError:
        raise MeshError(f"{name} must be an array of three columns; its rows differ") from None


def _narrowed(faces: NDArray[Any], count: int) -> tuple[NDArray[np.int32], NDArray[np.bool_]]:
    """The faces as int32, and which of the *count* vertices they use; refuses the others."""
    triangles = np.empty(faces.shape, np.int32)
    used = np.zeros(count, bool)
    wrong = []

    def work(at: int, end: int) -> None:
        part = faces[at:end]
        if int(part.min()) < 0 or int(part.max()) >= count:
            row, column = np.argwhere((part < 0) | (part >= count))[0]
            wrong.append((at + int(row), int(part[row, column])))
            return
        triangles[at:end] = part
        used[part.reshape(-1).astype(np.intp, copy=False)] = True

    in_blocks(work, len(faces))
    if wrong:
        row, vertex = min(wrong)
        known = f"the vertices are 0 to {count - 1}" if count else "there are no vertices"
        raise MeshError(f"triangle {row} uses vertex {vertex}; {known}")
    return triangles, used


def _bounds(mesh: Mesh) -> NDArray[np.float64]:
    # Column by column: NumPy takes twenty times as long for a reduction along axis 0.
    columns = mesh.points.T
    bounds = np.array([[x.min() for x in columns], [x.max() for x in columns]])
    if not np.isfinite(bounds).all():
        row = int(np.argmin(np.isfinite(mesh.points).all(axis=1)))
        x, y, z = mesh.points[row].tolist()
        raise MeshError(
            f"vertex {mesh.of(row)} is ({x!r}, {y!r}, {z!r}); all coordinates must be finite."
        )
    if np.abs(bounds).max() > LARGEST:
        row = int(np.argmax(np.abs(mesh.points).max(axis=1)))
        x, y, z = mesh.points[row].tolist()
        raise MeshError(
            f"vertex {mesh.of(row)} is ({x:.6g}, {y:.6g}, {z:.6g}); coordinates must not exceed "
            f"{LARGEST:g}, or areas and volumes overflow. Is it an outlier?"
        )
    return bounds


def _refuse_flat(bounds: NDArray[np.float64]) -> None:
    low, high = bounds
    extent = high - low
    if extent.max() == 0:
        raise MeshError(f"the mesh is a single point, {tuple(low.tolist())}; it encloses nothing")
    if extent.min() == 0:
        axes = " and ".join(axis for axis, length in zip("xyz", extent, strict=True) if not length)
        raise MeshError(
            f"the mesh is flat: its extent is {tuple(extent.tolist())}, nothing along {axes}. "
            "A solid needs an extent along every axis."
        )


def _refuse_without_area(mesh: Mesh, bounds: NDArray[np.float64]) -> None:
    # In the unit box nothing overflows, and "no area" means the same at every scale.
    low, high = bounds
    for start in range(0, len(mesh.triangles), BLOCK):
        a, b, c = (mesh.points[mesh.triangles[start : start + BLOCK].T] - low) / (high - low)
        ab, ac = (b - a).T, (c - a).T
        normal = np.stack([ab[i - 2] * ac[i - 1] - ab[i - 1] * ac[i - 2] for i in range(3)])
        scale = np.abs(ab).max(axis=0) * np.abs(ac).max(axis=0)
        if (np.abs(normal).max(axis=0) > 1e-14 * scale).any():
            return
    raise MeshError(
        f"none of the {len(mesh.triangles)} triangles has an area: all three corners of each "
        "lie on a line"
    )
