"""glTF 2.0: a scene of nodes, in JSON, and buffers inside the file or beside it.

Only what shapes the solid is read: positions, triangles, and the transforms of nodes.  Each node
that draws a mesh makes one body, whatever materials its parts have.
"""

from __future__ import annotations

import base64
import binascii
import json
import math
from pathlib import Path
from typing import Any, TypeAlias
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from clvox.errors import FormatError
from clvox.formats.common import Body, Budget, Contents, joined, moved, shown

Json: TypeAlias = dict[str, Any]

_HARMLESS = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_", "MSFT_texture_")
"""Extensions that leave the shape alone begin so."""

_VALUES = 2**22
"""Most values in the JSON text; each may take some hundred bytes of memory."""

_INDEX_TYPES = {5121: "u1", 5123: "<u2", 5125: "<u4"}
_FLOAT = 5126
_LARGEST_BUFFER = 2**31
_LISTS = {
    "nodes": "node",
    "scenes": "scene",
    "meshes": "mesh",
    "accessors": "accessor",
    "bufferViews": "buffer view",
    "buffers": "buffer",
}
_UNITS = "meter"  # by the standard, whatever the file was made in
_BODY = 256
"""Bytes that a body takes besides its triangles, in round figures."""

Transform: TypeAlias = "NDArray[np.float64] | None"
"""(4, 4), for columns; None changes nothing."""


def read_glb(data: bytes, folder: Path) -> Contents:
    """Return the bodies of a binary glTF file."""
    if data[:4] != b"glTF":
        raise FormatError("no GLB file: it does not begin with 'glTF'")
    version, length = (int.from_bytes(data[at : at + 4], "little") for at in (4, 8))
    if version != 2:
        raise FormatError(f"the file says glTF version {version}; clvox reads version 2")
    if length != len(data):
        raise FormatError(
            f"the header says {length} bytes, but the file has {len(data)}; it was cut short, or "
            "bytes were added"
        )
    chunks: list[tuple[bytes, bytes]] = []
    at = 12
    while at < length:
        size = int.from_bytes(data[at : at + 4], "little")
        if size > length - at - 8:
            raise FormatError(f"a chunk of {size} bytes reaches beyond the end of the file")
        # Others than the first two are for extensions.
        if len(chunks) < 2:
            chunks.append((data[at + 4 : at + 8], data[at + 8 : at + 8 + size]))
        at += 8 + size
    if not chunks or chunks[0][0] != b"JSON":
        raise FormatError("the first chunk of the file is no JSON")
    binary = chunks[1][1] if chunks[1:] and chunks[1][0] == b"BIN\0" else None
    return _Scene(chunks[0][1], binary, folder, len(data)).contents()


def read_gltf(data: bytes, folder: Path) -> Contents:
    """Return the bodies of a glTF file, whose buffers are inside it or lie in *folder*."""
    return _Scene(data, None, folder, len(data)).contents()


class _Scene:
    def __init__(self, text: bytes, binary: bytes | None, folder: Path, length: int) -> None:
        self.root = _parsed(text)
        # Looked through once: files have as many accessors as uses of them.
        self.lists = {key: _objects(self.root, key) for key in _LISTS}
        self.binary = binary
        self.folder = folder
        self.budget = Budget(length)
        self.buffers: dict[int, bytes] = {}
        self.files: dict[str, bytes] = {}
        self.meshes: dict[int, Body] = {}

    def contents(self) -> Contents:
        """The bodies of the scene, as one mesh."""
        _refuse_strange(self.root)
        bodies = []
        waiting: list[tuple[int, Transform]] = [(root, None) for root in reversed(self._roots())]
        seen: set[int] = set()
        while waiting:
            index, outer = waiting.pop()
            node = self._picked("nodes", index)
            if index in seen:
                raise FormatError(f"node {index} has two parents, or is its own ancestor")
            seen.add(index)
            placed = _combined(outer, _local(node, index))
            if "mesh" in node:
                bodies.append(self._body(node, index, placed))
            children = _numbers(node, "children", f"node {index}")
            waiting += [(child, placed) for child in reversed(children)]
        return joined(bodies, _UNITS)

    def _picked(self, key: str, index: int) -> Json:
        things = self.lists[key]
        if index >= len(things):
            raise FormatError(
                f"{_LISTS[key]} {index} is used; the file has {len(things)}, from 0 on"
            )
        return things[index]

    def _roots(self) -> list[int]:
        if self.lists["scenes"]:
            scene = self._picked("scenes", _integer(self.root, "scene", "the file", 0))
            return _numbers(scene, "nodes", "the scene")
        nodes = self.lists["nodes"]
        children = {child for node in nodes for child in _numbers(node, "children", "a node")}
        return [index for index in range(len(nodes)) if index not in children]

    def _body(self, node: Json, index: int, placed: Transform) -> Body:
        if "skin" in node:
            raise FormatError(f"node {index} is bent by a skeleton; clvox reads rigid meshes only")
        mesh = self._mesh(_integer(node, "mesh", f"node {index}"), node)
        self.budget.spend(_BODY + mesh.vertices.nbytes + mesh.faces.nbytes)
        if placed is None:
            return mesh
        if not np.isfinite(placed).all():
            raise FormatError(f"the transform of node {index} is not finite")
        # The standard says so: a mirror image keeps its outside outside.
        return moved(mesh, placed[:3, :3].T, placed[:3, 3])

    def _mesh(self, index: int, node: Json) -> Body:
        mesh = self._picked("meshes", index)
        weights = node.get("weights", mesh.get("weights", []))
        if not isinstance(weights, list) or any(weight != 0 for weight in weights):
            raise FormatError(f"mesh {index} is morphed; clvox reads meshes at rest only")
        if index not in self.meshes:
            self.meshes[index] = self._read_mesh(mesh, index)
        return self.meshes[index]

    def _read_mesh(self, mesh: Json, index: int) -> Body:
        places: dict[int, tuple[int, int]] = {}
        vertices, faces = [np.empty((0, 3))], [np.empty((0, 3), np.int64)]
        total = 0
        for number, primitive in enumerate(_objects(mesh, "primitives")):
            name = f"primitive {number} of mesh {index}"
            mode = _integer(primitive, "mode", name, 4)
            if mode > 6:
                raise FormatError(f"{name} has the mode {mode}; 0 to 6 are known")
            if mode < 4:
                continue  # points and lines bound nothing
            attributes = primitive.get("attributes")
            if not isinstance(attributes, dict) or "POSITION" not in attributes:
                raise FormatError(f"{name} has no attribute POSITION")
            position = _integer(attributes, "POSITION", name)
            # Parts of a mesh often share their vertices, and differ by the material only.
            if position not in places:
                vertices.append(self._accessor(position, "VEC3", {_FLOAT: "<f4"}))
                places[position] = total, len(vertices[-1])
                total += len(vertices[-1])
            start, count = places[position]
            if "indices" in primitive:
                corners = self._accessor(
                    _integer(primitive, "indices", name), "SCALAR", _INDEX_TYPES
                ).reshape(-1)
            else:
                self.budget.spend(8 * count)
                corners = np.arange(count)
            if corners.max() >= count:
                raise FormatError(f"{name} uses vertex {corners.max()} of {count}")
            faces.append(_triangles(corners, mode, name) + start)
        return Body(np.concatenate(vertices), np.concatenate(faces))

    def _accessor(self, index: int, kind: str, types: dict[int, str]) -> NDArray[Any]:
        """The rows of an accessor, (n, 3) float64 or (n, 1) int64."""
        accessor = self._picked("accessors", index)
        name = f"accessor {index}"
        if accessor.get("type") != kind:
            raise FormatError(f"{name} must be of the type {kind}")
        width = 3 if kind == "VEC3" else 1
        count = _integer(accessor, "count", name)
        if not count:
            raise FormatError(f"{name} is empty")
        self.budget.spend(8 * width * count)
        wide = np.float64 if kind == "VEC3" else np.int64
        if "bufferView" in accessor:
            found = self._rows(accessor, name, types, count, width)
            with np.errstate(invalid="ignore"):  # a signalling NaN
                rows = found.astype(wide)
        else:
            rows = np.zeros((count, width), wide)
        if "sparse" in accessor:
            self._replace(_object(accessor, "sparse", name), rows, accessor, types)
        return rows

    def _replace(
        self, sparse: Json, rows: NDArray[Any], accessor: Json, types: dict[int, str]
    ) -> None:
        """Put the few rows that differ in their places."""
        name = "a sparse accessor"
        count = _integer(sparse, "count", name)
        if count > len(rows):
            raise FormatError(f"{name} replaces {count} of {len(rows)} rows")
        if not count:
            return
        where = _object(sparse, "indices", name)
        values = {**_object(sparse, "values", name), "componentType": accessor["componentType"]}
        places = self._rows(where, name, _INDEX_TYPES, count, 1).reshape(-1).astype(np.int64)
        if places.max() >= len(rows):
            raise FormatError(f"{name} replaces row {places.max()} of {len(rows)}")
        with np.errstate(invalid="ignore"):
            rows[places] = self._rows(values, name, types, count, rows.shape[1])

    def _rows(
        self, where: Json, name: str, types: dict[int, str], count: int, width: int
    ) -> NDArray[Any]:
        """Rows as they stand in a buffer."""
        kind = _integer(where, "componentType", name)
        if kind not in types:
            raise FormatError(f"{name} has the component type {kind}; expected one of {[*types]}")
        number = _integer(where, "bufferView", name)
        view = self._picked("bufferViews", number)
        name = f"{name}, by buffer view {number},"
        item = np.dtype(types[kind])
        size = item.itemsize * width
        stride = _integer(view, "byteStride", name, size)
        if stride < size:
            raise FormatError(f"{name} has rows of {size} bytes every {stride} bytes")
        start, length = (_integer(view, key, name, 0) for key in ("byteOffset", "byteLength"))
        offset = _integer(where, "byteOffset", name, 0)
        if offset + (count - 1) * stride + size > length:
            raise FormatError(f"{name} reaches beyond the view's {length} bytes")
        data = self._buffer(_integer(view, "buffer", name))
        if start + length > len(data):
            raise FormatError(f"{name} reaches beyond its buffer of {len(data)} bytes")
        return np.ndarray(
            (count, width), item, data, start + offset, strides=(stride, item.itemsize)
        )

    def _buffer(self, index: int) -> bytes:
        if index not in self.buffers:
            buffer = self._picked("buffers", index)
            name = f"buffer {index}"
            length = _integer(buffer, "byteLength", name)
            uri = buffer.get("uri")
            if uri is None:
                data = self.binary if index == 0 else None
                if data is None:
                    raise FormatError(f"{name} names no file, and the file has no binary chunk")
            elif isinstance(uri, str):
                data = self._data(uri, name) if uri[:5] == "data:" else self._file(uri, name)
            else:
                raise FormatError(f"the uri of {name} is no text")
            if length > len(data):
                raise FormatError(f"{name} is said to have {length} bytes; it has {len(data)}")
            self.buffers[index] = data[:length] if length < len(data) else data
        return self.buffers[index]

    def _data(self, uri: str, name: str) -> bytes:
        head, comma, text = uri.partition(",")
        if not comma or not head.endswith(";base64"):
            raise FormatError(f"{name} is embedded as {shown(head)}; expected base64")
        try:
            return base64.b64decode(text, validate=True)
        except (binascii.Error, ValueError):
            raise FormatError(f"the base64 data of {name} are damaged") from None

    def _file(self, uri: str, name: str) -> bytes:
        """What a file beside this one holds; no uri leads out of the folder."""
        file = unquote(uri)
        if not file or file.startswith(".") or not file.isprintable() or set(file) & set("/\\:"):
            raise FormatError(
                f"{name} is in {shown(uri)}; clvox reads files in the folder of this one only, by "
                "their plain name"
            )
        if file not in self.files:
            path = self.folder / file
            if path.is_symlink() or not path.is_file():
                raise FormatError(f"{name} is in {shown(file)}, and no such file is in the folder")
            size = path.stat().st_size
            if size > _LARGEST_BUFFER:
                raise FormatError(f"{shown(file)} has {size} bytes; at most 2^31 are read")
            self.files[file] = path.read_bytes()
            self.budget.length += size
        return self.files[file]


def _parsed(text: bytes) -> Json:
    # Base64 has none of these, so long buffers inside the text do not count.
    if sum(map(text.count, (b",", b"[", b"{"))) > _VALUES:
        raise FormatError(f"the JSON text has more than {_VALUES} values")
    try:
        root = json.loads(text.decode("utf-8"), parse_constant=_refuse_constant)
    except FormatError:
        raise
    except (ValueError, RecursionError) as error:
        words = "it is nested too deeply" if isinstance(error, RecursionError) else str(error)
        raise FormatError(f"the JSON text is damaged: {words[:200]}") from None
    if not isinstance(root, dict):
        raise FormatError("the JSON text is no object")
    return root


def _refuse_constant(word: str) -> None:
    raise FormatError(f"the JSON text says {word}, which is no number there")


def _refuse_strange(root: Json) -> None:
    version = _object(root, "asset", "the file").get("version")
    if not isinstance(version, str) or version.partition(".")[0] != "2":
        raise FormatError(f"the file says glTF version {version!r:.20}; clvox reads version 2")
    needed = root.get("extensionsRequired", [])
    if not isinstance(needed, list) or not all(isinstance(one, str) for one in needed):
        raise FormatError("extensionsRequired is no list of names")
    strange = [one for one in needed if not one.startswith(_HARMLESS)]
    if strange:
        raise FormatError(
            f"the file needs {', '.join(map(shown, strange[:5]))}, which clvox does not know; "
            "export it without extensions"
        )


def _combined(outer: Transform, inner: Transform) -> Transform:
    if outer is None or inner is None:
        return outer if inner is None else inner
    with np.errstate(over="ignore", invalid="ignore"):
        return outer @ inner


def _local(node: Json, index: int) -> Transform:
    """The transform of a node, within that of its parent."""
    name = f"node {index}"
    if not node.keys() & {"matrix", "translation", "rotation", "scale"}:
        return None
    if "matrix" in node:
        matrix = _reals(node, "matrix", 16, name).reshape(4, 4).T
        if (matrix[3] != [0, 0, 0, 1]).any():
            raise FormatError(f"the matrix of {name} is no affine transform")
        return matrix
    matrix = np.eye(4)
    if "rotation" in node:
        x, y, z, w = _reals(node, "rotation", 4, name).tolist()
        length = math.hypot(x, y, z, w)
        if not (0 < length < math.inf):
            raise FormatError(f"the rotation of {name} is no unit quaternion")
        x, y, z, w = x / length, y / length, z / length, w / length
        matrix[:3, :3] = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    if "scale" in node:
        matrix[:3, :3] *= _reals(node, "scale", 3, name)
    if "translation" in node:
        matrix[:3, 3] = _reals(node, "translation", 3, name)
    return matrix


def _triangles(corners: NDArray[np.int64], mode: int, name: str) -> NDArray[np.int64]:
    """Triangles one by one (4), as a strip (5), or as a fan (6)."""
    if mode == 4:
        if len(corners) % 3:
            raise FormatError(f"{name} has {len(corners)} corners, which make no whole triangles")
        return corners.reshape(-1, 3)
    if len(corners) < 3:
        raise FormatError(f"{name} has {len(corners)} corners; a strip or a fan has 3 or more")
    second, third = corners[1:-1], corners[2:]
    if mode == 6:
        return np.stack([second, third, np.full(len(second), corners[0])], axis=1)
    first = corners[:-2]
    turned = np.arange(len(first)) % 2 == 1
    return np.stack(
        [first, np.where(turned, third, second), np.where(turned, second, third)], axis=1
    )


# --- JSON whose types are not to be trusted -----------------------------------------------------


def _objects(parent: Json, key: str) -> list[Json]:
    found = parent.get(key, [])
    if not isinstance(found, list) or not all(isinstance(one, dict) for one in found):
        raise FormatError(f"{key} is no list of objects")
    return found


def _object(parent: Json, key: str, name: str) -> Json:
    found = parent.get(key)
    if not isinstance(found, dict):
        raise FormatError(f"{name} has no {key}")
    return found


def _integer(parent: Json, key: str, name: str, default: int | None = None) -> int:
    found = parent.get(key, default)
    if isinstance(found, bool) or not isinstance(found, int) or not 0 <= found < 2**53:
        raise FormatError(f"{key} of {name} is {_brief(found)}; expected a whole number")
    return found


def _numbers(parent: Json, key: str, name: str) -> list[int]:
    found = parent.get(key, [])
    if not isinstance(found, list):
        raise FormatError(f"{key} of {name} is no list")
    return [_integer({key: one}, key, name) for one in found]


def _reals(parent: Json, key: str, count: int, name: str) -> NDArray[np.float64]:
    found = parent[key]
    sound = isinstance(found, list) and len(found) == count
    if not sound or any(isinstance(x, bool) or not isinstance(x, int | float) for x in found):
        raise FormatError(f"{key} of {name} is no list of {count} numbers")
    try:
        return np.array([float(x) for x in found])
    except OverflowError:
        raise FormatError(f"{key} of {name} is not finite") from None


def _brief(value: object) -> str:
    if isinstance(value, str):
        return shown(value)
    plain = value is None or isinstance(value, int | float)
    return f"{value!r:.24}" if plain else f"a {type(value).__name__}"
