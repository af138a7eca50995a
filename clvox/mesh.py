"""Load a mesh and check whether it is finite, closed, and oriented.

`load` reads a file as it is.  `check` welds the vertices, drops what encloses nothing, and counts
how often each edge is used; everything above works on the `Surface` that comes back and asks no
such question again.

Both questions are decided exactly.  A hash only ever says where to look: rows whose hashes agree
are compared in full, and edges are sorted by the numbers of their vertices.
"""

from __future__ import annotations

import math
import os
import weakref
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from clvox import _formats
from clvox.errors import FormatError, MeshError, NotClosedError, NotOrientedError

MeshLike: TypeAlias = trimesh.Trimesh | str | os.PathLike[str] | tuple[ArrayLike, ArrayLike]
"""What `check` takes: a mesh, the path of a file, or (vertices, faces)."""

WELD_TOLERANCE = 1e-8
"""Vertices of an open mesh are welded within this fraction of its longest side."""

LARGEST = 1e18
"""Largest coordinate: areas do not overflow float32, nor volumes a double."""

_MAX_VERTICES = 2**31 - 1
_BLOCK = 1 << 13
"""Rows worked on at a time: intermediate arrays stay in the cache, and in memory that is reused;
larger ones come fresh from the system each time, which costs more than the work on them."""

_SMALL = 1 << 16
"""Below this many items a second thread costs more than it saves."""


@dataclass(frozen=True, eq=False)
class Surface:
    """A welded and checked mesh, as `check` returns it.  Its arrays are read-only.

    Attributes
    ----------
    vertices : (n, 3) float64
        Each of them finite, different from all others, and used by a triangle.
    faces : (m, 3) int32
        Three different vertex numbers each; no two triangles have the same three vertices.
        Triangles without area are kept: they hold T-junctions shut.
    closed : bool
        Every edge belongs to an even number of triangles.
    oriented : bool
        Every edge is used equally often both ways; such a surface is closed, too.
    warnings : tuple of str
        What a user should know; empty for a flawless mesh.
    bounds : (2, 3) float64
        Lowest and highest corner.
    repeated : int
        Triangles dropped because a vertex number repeats after welding.
    duplicates : int
        Triangles dropped as copies of one with the same vertices and orientation.
    cancelled : int
        Triangles dropped in pairs with the same vertices and opposite orientation, both counted.
    welded_by : float
        The length within which vertices were merged; 0.0 if only equal ones were.
    face_numbers : (m,) int64 or None
        The caller's number of each triangle; None if no triangle was dropped.
    vertex_numbers : (n,) int64 or None
        The caller's number of each vertex, the lowest of those merged; None if all were kept.
    odd_edges, uneven_edges : (k, 2) int32
        The edges, as rows of `vertices`, that belong to an odd number of triangles, and that are
        not used equally often both ways.
    """

    vertices: NDArray[np.float64] = field(repr=False)
    faces: NDArray[np.int32] = field(repr=False)
    closed: bool
    oriented: bool
    warnings: tuple[str, ...]
    bounds: NDArray[np.float64]
    repeated: int
    duplicates: int
    cancelled: int
    welded_by: float
    face_numbers: NDArray[np.int64] | None = field(repr=False)
    vertex_numbers: NDArray[np.int64] | None = field(repr=False)
    odd_edges: NDArray[np.int32] = field(repr=False)
    uneven_edges: NDArray[np.int32] = field(repr=False)

    def require_closed(self) -> None:
        """Do nothing for a closed surface.

        Raises
        ------
        NotClosedError
            With the number of odd edges, and the caller's vertex numbers and the place of one.
        """
        if not self.closed:
            raise NotClosedError(
                f"{_open(self)}. A solid needs a closed surface; "
                "trimesh.repair.fill_holes may close it."
            )

    def require_oriented(self) -> None:
        """Do nothing for an oriented surface.

        Raises
        ------
        NotClosedError
            The surface is not even closed.
        NotOrientedError
            With the number of edges used more often one way than the other, and one of them.
        """
        self.require_closed()
        if not self.oriented:
            raise NotOrientedError(
                f"{_mixed(self)}. Winding numbers need each edge used equally often both ways; "
                'fill="parity" does not, trimesh.repair.fix_normals may orient it.'
            )


def load(path: str | os.PathLike[str]) -> trimesh.Trimesh:
    """Return the mesh in a file, as it is: nothing is merged, reordered or dropped.

    Parameters
    ----------
    path : str or path
        An STL file (ASCII or binary), OBJ or PLY, each also compressed as ``.gz``.  The objects
        of an OBJ file become one mesh, its polygons fans of triangles.

    Returns
    -------
    trimesh.Trimesh
        With float64 vertices.  Three vertices per triangle for STL, which knows no others.

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
        vertices, faces = _formats.read(where)
    except FormatError as error:
        raise FormatError(f"{where.name}: {error}") from None
    return trimesh.Trimesh(vertices, faces, process=False, validate=False)


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


@dataclass(frozen=True)
class _Mesh:
    """Vertices, triangles, and the caller's numbers of the vertices (None: as they are here)."""

    points: NDArray[np.float64]
    triangles: NDArray[np.int32]
    numbers: NDArray[np.int64] | None

    def limited(self, used: NDArray[np.bool_]) -> _Mesh:
        """The mesh with only those vertices that are *used*."""
        return self if used.all() else self._only(used, self.triangles)

    def merged(self, first: NDArray[np.intp]) -> _Mesh:
        """Each vertex replaced by vertex *first* of it, which is its own first."""
        used = first == np.arange(len(first))
        return self._only(used, first.astype(np.int32)[self.triangles])

    def _only(self, used: NDArray[np.bool_], triangles: NDArray[np.int32]) -> _Mesh:
        kept = np.flatnonzero(used)
        new = np.cumsum(used, dtype=np.int32) - np.int32(1)
        numbers = kept if self.numbers is None else self.numbers[kept]
        return _Mesh(self.points[kept], new[triangles], numbers)

    def of(self, index: int) -> int:
        return index if self.numbers is None else int(self.numbers[index])


def _check(vertices: ArrayLike, faces: ArrayLike) -> Surface:
    points, corners = _vertices(vertices), _faces(faces)
    triangles, used = _narrowed(corners, len(points))
    mesh = _Mesh(points, triangles, None).limited(used)
    bounds = _bounds(mesh)
    _refuse_flat(bounds)

    first = _first_equal(mesh.points)
    if first is not None:
        mesh = mesh.merged(first)
    rest = _resolve(mesh)
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
    return replace(surface, warnings=(*warnings, *_defects(surface, rest.crowded)))


def _merged_near(mesh: _Mesh, rest: _Rest, length: float) -> tuple[_Mesh, _Rest] | None:
    """The mesh with vertices of odd edges merged within *length*; None if that closes nothing."""
    first = _first_near(mesh.points, np.unique(rest.odd), length)
    if first is None:
        return None
    merged = mesh.merged(first)
    closer = _resolve(merged)
    return (merged, closer) if len(closer.odd) < len(rest.odd) and len(closer.kept) else None


def _trimmed(mesh: _Mesh, rest: _Rest) -> _Mesh:
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


def _open(surface: Surface) -> str:
    count = np.int64(len(surface.vertices))
    corners, odd = surface.faces.astype(np.int64), surface.odd_edges.astype(np.int64)
    ends = np.roll(corners, -1, axis=1)
    sides = np.minimum(corners, ends) * count + np.maximum(corners, ends)
    several = len(odd) < int(np.isin(sides, odd[:, 0] * count + odd[:, 1]).sum())
    share = "an odd number of triangles" if several else "one triangle only"
    return f"the mesh is open: {len(odd)} edges belong to {share}, {_first(surface, odd)}"


def _mixed(surface: Surface) -> str:
    edges = surface.uneven_edges
    return (
        f"the mesh is not oriented: {len(edges)} edges are used more often one way than the "
        f"other, {_first(surface, edges)}"
    )


def _first(surface: Surface, edges: NDArray[Any]) -> str:
    a, b = edges[0].tolist()
    middle = surface.vertices[a] / 2 + surface.vertices[b] / 2
    if surface.vertex_numbers is not None:
        a, b = surface.vertex_numbers[[a, b]].tolist()
    place = ", ".join(f"{x:.6g}" for x in middle)
    return f"the first between vertices {a} and {b} near ({place})"


def _triangles(count: int) -> str:
    return "1 triangle was" if count == 1 else f"{count} triangles were"


def _defects(surface: Surface, crowded: int) -> Iterator[str]:
    if surface.repeated:
        yield f"{_triangles(surface.repeated)} dropped, with a vertex number twice"
    if surface.duplicates:
        yield f"{_triangles(surface.duplicates)} dropped, equal to another one"
    if surface.cancelled:
        yield (
            f"{_triangles(surface.cancelled)} dropped in pairs: "
            "two opposite sides of one triangle enclose nothing"
        )
    if crowded:
        yield f"some edges ({crowded}) belong to more than two triangles: surfaces touch there"
    if not surface.closed:
        yield _open(surface)
    elif not surface.oriented:
        yield f"{_mixed(surface)}; inside and outside are still told apart by parity"
    else:
        share = _volume_share(surface)
        # Rounding may make a volume of nothing negative, never by this much of the bounding box.
        if share < -1e-12:
            volume = share * float(np.prod(surface.bounds[1] - surface.bounds[0]))
            yield f"the mesh is inside out: its signed volume is {volume:.6g}"


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

    def work(start: int, stop: int) -> None:
        for at in range(start, stop, _BLOCK):
            end = min(at + _BLOCK, stop)
            part = faces[at:end]
            if int(part.min()) < 0 or int(part.max()) >= count:
                row, column = np.argwhere((part < 0) | (part >= count))[0]
                wrong.append((at + int(row), int(part[row, column])))
                return
            triangles[at:end] = part
            used[part.reshape(-1).astype(np.intp, copy=False)] = True

    _in_halves(work, len(faces))
    if wrong:
        row, vertex = min(wrong)
        known = f"the vertices are 0 to {count - 1}" if count else "there are no vertices"
        raise MeshError(f"triangle {row} uses vertex {vertex}; {known}")
    return triangles, used


def _bounds(mesh: _Mesh) -> NDArray[np.float64]:
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


def _refuse_without_area(mesh: _Mesh, bounds: NDArray[np.float64]) -> None:
    # In the unit box nothing overflows, and "no area" means the same at every scale.
    low, high = bounds
    for start in range(0, len(mesh.triangles), _BLOCK):
        a, b, c = (mesh.points[mesh.triangles[start : start + _BLOCK].T] - low) / (high - low)
        ab, ac = (b - a).T, (c - a).T
        normal = np.stack([ab[i - 2] * ac[i - 1] - ab[i - 1] * ac[i - 2] for i in range(3)])
        scale = np.abs(ab).max(axis=0) * np.abs(ac).max(axis=0)
        if (np.abs(normal).max(axis=0) > 1e-14 * scale).any():
            return
    raise MeshError(
        f"none of the {len(mesh.triangles)} triangles has an area: all three corners of each "
        "lie on a line"
    )


def _volume_share(surface: Surface) -> float:
    """The signed volume, as a fraction of the bounding box."""
    x, y, z = np.ascontiguousarray(surface.vertices.T)
    low, high = surface.bounds
    parts: list[float] = []

    def add(start: int, stop: int) -> None:
        for at in range(start, stop, _BLOCK):
            part = surface.faces[at : min(at + _BLOCK, stop)]
            corners = np.ascontiguousarray(part.T, dtype=np.intp)
            ax, bx, cx = x.take(corners)
            ay, by, cy = y.take(corners)
            height = z.take(corners).sum(axis=0) - 3 * low[2]
            # The prism between a triangle and the lowest plane.
            parts.append(float(((bx - ax) * (cy - ay) - (by - ay) * (cx - ax)) @ height))

    _in_halves(add, len(surface.faces))
    share = math.fsum(parts) / 6
    for length in (high - low).tolist():
        share /= length  # one by one: the volume of a tiny box would underflow to zero
    return share


# --- equal rows ---------------------------------------------------------------------------------


def _hash(rows: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """A 64-bit number for each row of three words."""
    # float32 values leave the low half of a double empty, so the high half is folded in.
    folded = rows ^ (rows >> np.uint64(32))
    keys: NDArray[np.uint64] = folded[:, 0] * np.uint64(0x9E3779B97F4A7C15)
    keys += folded[:, 1] * np.uint64(0xC2B2AE3D27D4EB4F)
    keys += folded[:, 2] * np.uint64(0x165667B19E3779F9)
    return keys


def _first_equal(rows: NDArray[Any]) -> NDArray[np.intp] | None:
    """The number of the first row with the same bits as each row; None if all rows differ.

    *rows*: (n, 3), eight bytes each, C-contiguous.
    """
    words = rows.view(np.uint64)
    count = len(words)
    bits = np.uint64(max(count - 1, 1).bit_length())
    low = (np.uint64(1) << bits) - np.uint64(1)

    # The number of the row takes the low bits of its hash: sorting whole words is far faster
    # than argsort, and rows of one hash come in the order of their numbers.
    keys = np.empty(count, np.uint64)

    def fill(start: int, stop: int) -> None:
        for at in range(start, stop, _BLOCK):
            end = min(at + _BLOCK, stop)
            part = _hash(words[at:end])
            keys[at:end] = (part & ~low) | np.arange(at, end, dtype=np.uint64)

    _in_halves(fill, count)
    _sort(keys)
    same = np.zeros(count, bool)
    np.equal(keys[1:] >> bits, keys[:-1] >> bits, out=same[1:])
    if not same.any():
        return None
    order = (keys & low).astype(np.intp)
    starts = np.flatnonzero(~same)
    first = np.empty(count, np.intp)
    first[order] = np.repeat(order[starts], np.diff(starts, append=count))

    clash = np.zeros(count, bool)

    def compare(start: int, stop: int) -> None:
        for at in range(start, stop, _BLOCK):
            end = min(at + _BLOCK, stop)
            clash[at:end] = (words[at:end] != words.take(first[at:end], axis=0)).any(axis=1)

    _in_halves(compare, count)
    if clash.any():
        # Different rows, equal hashes: everything that shares such a hash is sorted in full.
        bad = np.zeros(count, bool)
        bad[first[clash]] = True
        members = np.flatnonzero(bad[first])
        exact = words[members]
        turn = np.lexsort((members, exact[:, 2], exact[:, 1], exact[:, 0]))
        members, exact = members[turn], exact[turn]
        begins = np.ones(len(members), bool)
        begins[1:] = (exact[1:] != exact[:-1]).any(axis=1)
        first[members] = members[np.flatnonzero(begins)[np.cumsum(begins) - 1]]
        if (first == np.arange(count)).all():
            return None
    return first


def _first_near(
    points: NDArray[np.float64], candidates: NDArray[np.int32], length: float
) -> NDArray[np.intp] | None:
    """Like `_first_equal`, for the *candidates* among the points, and within *length*.

    Points that differ by at most *length* along each axis are merged for certain, points that
    differ by twice as much or more only by way of others.  The cells of eight shifted grids do
    this at a bounded cost, however many points crowd into a cell.
    """
    if length == 0:
        return None
    places = points[candidates]
    scaled = (places - places.min(axis=0)) / (2 * length)
    pairs = []
    for shift in np.ndindex(2, 2, 2):
        first = _first_equal(np.floor(scaled + np.array(shift) / 2))
        if first is not None:
            moved = np.flatnonzero(first != np.arange(len(first)))
            pairs.append(np.stack([moved, first[moved]], axis=1))
    if not pairs:
        return None
    joined: Any = trimesh.graph.connected_component_labels  # it has no annotations
    labels = joined(np.concatenate(pairs), len(candidates))
    # The candidates ascend, so the first of a component is the lowest-numbered.
    _, lowest = np.unique(labels, return_index=True)
    result = np.arange(len(points))
    result[candidates] = candidates[lowest[labels]]
    return result


# --- edges --------------------------------------------------------------------------------------


@dataclass
class _Rest:
    """What is left of the triangles, and the edges that spoil it."""

    kept: NDArray[np.int64]
    repeated: int
    duplicates: int
    cancelled: int
    odd: NDArray[np.int32]
    uneven: NDArray[np.int32]
    crowded: int


_BACKWARD = np.int64(-(2**63))


def _resolve(mesh: _Mesh) -> _Rest:
    """Drop what encloses nothing, and count the uses of each edge."""
    count = len(mesh.points)
    none = np.empty((0, 2), np.int32)
    kept = np.arange(len(mesh.triangles))
    triangles = mesh.triangles
    keys, flawed = _edge_keys(triangles, count)
    if flawed:
        a, b, c = triangles.T
        kept = np.flatnonzero((a != b) & (b != c) & (c != a))
        triangles = triangles[kept]
        keys, _ = _edge_keys(triangles, count)
    repeated = len(mesh.triangles) - len(kept)
    if _is_simple(keys, count):
        return _Rest(kept, repeated, 0, 0, none, none, 0)

    single, paired = _distinct(triangles)
    duplicates = len(kept) - len(single)
    if duplicates or len(paired) < len(single):
        kept, triangles = kept[paired], triangles[paired]
        keys, _ = _edge_keys(triangles, count)
    odd, uneven, crowded = _flawed_edges(keys, count)
    return _Rest(kept, repeated, duplicates, len(single) - len(paired), odd, uneven, crowded)


def _widths(count: int) -> tuple[int, int]:
    """Bits for the number of a vertex, and bits left over in an edge's key."""
    bits = max(count - 1, 1).bit_length()
    return bits, 63 - 2 * bits


def _edge_keys(triangles: NDArray[np.int32], count: int) -> tuple[NDArray[np.int64], bool]:
    """A key for each side of each triangle, and whether some triangle uses a vertex twice.

    From the top: set if the side runs from the higher vertex number to the lower; the lower
    number; the higher; as many low bits as fit of the third vertex.
    """
    bits, spare = _widths(count)
    low = np.int64((1 << min(bits, spare)) - 1)
    keys = np.empty((3, len(triangles)), np.int64)
    flaws = [False, False]

    def fill(start: int, stop: int) -> None:
        for at in range(start, stop, _BLOCK):
            end = min(at + _BLOCK, stop)
            corners = triangles[at:end].T.astype(np.int64, order="C")
            # The fields are put in place before they are compared: that changes no order.
            lower, higher = corners << np.int64(bits + spare), corners << np.int64(spare)
            thirds = corners & low
            for p, q, r in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
                ahead = corners[q] - corners[p]
                if not ahead.all():
                    flaws[int(start > 0)] = True
                ahead &= _BACKWARD  # what is left is the sign
                ahead |= np.minimum(lower[p], lower[q])
                ahead |= np.maximum(higher[p], higher[q])
                np.bitwise_or(ahead, thirds[r], out=keys[p, at:end])

    _in_halves(fill, len(triangles))
    return keys.reshape(-1), any(flaws)


def _is_simple(keys: NDArray[np.int64], count: int) -> bool:
    """Whether each edge is used once each way, by triangles of different vertices.

    Then the surface is oriented, hence closed, and no two triangles have the same vertices: two
    of one orientation would share a side, two of opposite orientation an edge and the third
    vertex.  Where the third vertex does not fit, its low bits may say no to such a surface.
    """
    if len(keys) % 2 or not len(keys):
        return False
    _sort(keys)
    half = len(keys) // 2
    backward, forward = keys[:half], keys[half:]
    if backward[-1] >= 0 or forward[0] < 0:
        return False
    rest = np.int64(_widths(count)[1])
    flaws = [False, False]

    def compare(start: int, stop: int) -> None:
        for at in range(start, stop, _BLOCK):
            end = min(at + _BLOCK, stop)
            there = forward[at:end]
            apart = there ^ backward[at:end] ^ _BACKWARD
            after = forward[at + 1 : end + 1]
            again = (after ^ there[: len(after)]) >> rest
            if (apart >> rest).any() or not apart.all() or not again.all():
                flaws[int(start > 0)] = True
                return

    _in_halves(compare, half)
    return not any(flaws)


def _distinct(triangles: NDArray[np.int32]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """The triangles that are no copies, and those of them that have no opposite either."""
    a, b, c = triangles.T.astype(np.int64)
    low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
    turned = (a < b).astype(np.int64) + (b < c) + (c < a) == 1
    middle = a + b + c - low - high
    single = np.arange(len(triangles))
    first = _first_equal(np.stack([low, middle, 2 * high + turned], axis=1))
    if first is not None:
        single = np.flatnonzero(first == single)
    first = _first_equal(np.stack([low, middle, high], axis=1)[single])
    if first is None:
        return single, single
    uses = np.bincount(first, minlength=len(single))
    return single, single[uses[first] == 1]


def _flawed_edges(
    keys: NDArray[np.int64], count: int
) -> tuple[NDArray[np.int32], NDArray[np.int32], int]:
    """The edges with an odd number of triangles, and those not used equally often both ways.

    Third, the number of edges that belong to more than two triangles.
    """
    bits, spare = _widths(count)
    backward = (keys < 0).astype(np.int64)
    # An edge needs at most 62 bits: there is room for its direction below.
    sides = ((keys & ~_BACKWARD) >> np.int64(spare) << np.int64(1)) | backward
    _sort(sides)
    edges = sides >> np.int64(1)
    starts = np.flatnonzero(np.concatenate([[True], edges[1:] != edges[:-1]])[: len(edges)])
    uses = np.diff(starts, append=len(edges))
    back = np.add.reduceat(sides & np.int64(1), starts) if len(starts) else uses
    edges = edges[starts]
    pairs = np.stack([edges >> np.int64(bits), edges & np.int64((1 << bits) - 1)], axis=1)
    pairs = pairs.astype(np.int32)
    return pairs[uses % 2 == 1], pairs[2 * back != uses], int((uses > 2).sum())


# --- two threads --------------------------------------------------------------------------------


def _in_halves(work: Callable[[int, int], None], count: int) -> None:
    """Call *work* for both halves of range(count) at once; NumPy lets go of the interpreter."""
    if count < _SMALL:
        work(0, count)
        return
    half = count // 2
    with ThreadPoolExecutor(1) as other:
        second = other.submit(work, half, count)
        work(0, half)
        second.result()


def _sort(keys: NDArray[Any]) -> None:
    """Sort in place."""
    count = len(keys)
    if count < _SMALL:
        keys.sort()
        return
    keys.partition(count // 2)
    _in_halves(lambda start, stop: keys[start:stop].sort(), count)
