"""3MF: a zip archive with parts in XML.

The root relationships name the model part; its build items place objects, which are meshes or
made of other objects.  Each mesh that is placed makes one body.  Of the extensions that a file
may require, those that leave the shape alone are passed over, and the production extension, which
spreads objects over several parts, is read; the others are refused by name.
"""

from __future__ import annotations

import io
import posixpath
import re
import zipfile
import zlib
from array import array
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import IO, TypeAlias
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from clvox.errors import FormatError
from clvox.formats.common import (
    Body,
    Budget,
    Contents,
    Numbers,
    floats,
    joined,
    moved,
    shown,
    unpacked_limit,
)

_CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
_PRODUCTION = "http://schemas.microsoft.com/3dmanufacturing/production/2015/06"
_KNOWN = {
    _CORE,
    _PRODUCTION,
    "http://schemas.microsoft.com/3dmanufacturing/material/2015/02",
    "http://schemas.microsoft.com/3dmanufacturing/trianglesets/2021/07",
}
_COMPATIBILITY = "http://schemas.openxmlformats.org/markup-compatibility/2006"
_RELATIONSHIPS = "http://schemas.openxmlformats.org/package/2006/relationships"
_MODEL_TYPE = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
_ROOT = "/_rels/.rels"

# The elements that mean something, by the one around them and their own name.
_TREE: dict[tuple[str | None, str], str] = {
    (outer, f"{_CORE} {inner}"): inner
    for outer, inner in [
        ("", "model"),
        ("model", "resources"),
        ("resources", "object"),
        ("object", "mesh"),
        ("mesh", "vertices"),
        ("vertices", "vertex"),
        ("mesh", "triangles"),
        ("triangles", "triangle"),
        ("object", "components"),
        ("components", "component"),
        ("model", "build"),
        ("build", "item"),
    ]
}

_UNITS = ("micron", "millimeter", "centimeter", "inch", "foot", "meter")
_NUMBER = re.compile(r"[0-9]{1,10}")

_PARTS = 2**14
"""Most entries of the archive."""

_DEPTH = 64
"""Most levels of XML elements, and of objects within objects."""

_READ = 2**20
_TAG = 2**22
"""Bytes that are parsed at a time, and bytes of the longest tag or comment."""

_THINGS = 2**18
"""Most objects, components and items of a part: in the file, each is a few bytes."""

_PLACE = 512
"""Bytes that placing an object takes besides its triangles, in round figures."""

Attributes: TypeAlias = dict[str, str]
Key: TypeAlias = tuple[str, str]
"""An object: its part and its id."""


@dataclass
class _Use:
    """An object placed by a build item or by another object."""

    key: Key
    transform: NDArray[np.float64] | None
    """(4, 3), for rows: three to turn, one to shift."""


@dataclass
class _Object:
    mesh: Body | None = None
    uses: list[_Use] = field(default_factory=list)


@dataclass
class _Model:
    """What one model part says."""

    units: str
    objects: dict[str, _Object]
    items: list[_Use]


def read_3mf(data: bytes) -> Contents:
    """Return the bodies of a 3MF file, in its unit of length."""
    package = _Package(data)
    return _Build(package, package.model_part()).contents()


class _Package:
    """The archive: parts by name, read as they are parsed and never written anywhere."""

    def __init__(self, data: bytes) -> None:
        if data.count(b"PK\1\2") > _PARTS:
            raise FormatError(f"the archive has more than {_PARTS} entries")
        self.budget = Budget(len(data))
        self.left = unpacked_limit(len(data))
        try:
            self.archive = zipfile.ZipFile(io.BytesIO(data))
        except _DAMAGES as error:
            raise FormatError(f"no 3MF file: no sound zip archive ({error})") from None
        self.parts: dict[str, zipfile.ZipInfo | None] = {}
        for entry in self.archive.infolist():
            name = _part_name(entry.filename)
            # Readers disagree on which of two is meant.
            self.parts[name] = None if name in self.parts else entry

    def model_part(self) -> str:
        """Return the name of the part that the root relationships call the model."""
        found: list[str] = []

        def start(name: str, attributes: Attributes, depth: int) -> None:
            link = depth == 1 and name == f"{_RELATIONSHIPS} Relationship"
            if link and attributes.get("Type") == _MODEL_TYPE:
                found.append(_part_name(attributes.get("Target", "")))

        self.parse(_ROOT, start)
        if len(found) != 1:
            raise FormatError(f"{_ROOT} names {len(found)} model parts; a 3MF file has exactly one")
        return found[0]

    def parse(
        self,
        part: str,
        start: Callable[[str, Attributes, int], None],
        end: Callable[[str, int], None] | None = None,
        prefix: Callable[[str, str], None] | None = None,
    ) -> None:
        """Call *start* and *end* for each element of a part, with its depth, 0 for the root."""
        entry = self.parts.get(part.lower())
        if entry is None:
            words = "twice" if part.lower() in self.parts else "not"
            raise FormatError(f"the part {shown(part)} is {words} in the archive")
        if entry.flag_bits & 0x41:
            raise FormatError(f"the part {shown(part)} is encrypted")
        if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise FormatError(f"the part {shown(part)} is compressed by a method 3MF does not know")
        # zipfile reads no more than the entry says, and its sum would not agree then.
        self.left -= entry.file_size
        if self.left < 0:
            raise FormatError(
                f"the part {shown(part)} expands to {entry.file_size} bytes, many times the length "
                "of the file; meshes never do"
            )
        parser = expat.ParserCreate(namespace_separator=" ")
        depth = 0

        def open_element(name: str, attributes: Attributes) -> None:
            nonlocal depth
            if depth == _DEPTH:
                raise FormatError(f"{part} has elements nested more than {_DEPTH} deep")
            start(name, attributes, depth)
            depth += 1

        def close_element(name: str) -> None:
            nonlocal depth
            depth -= 1
            if end is not None:
                end(name, depth)

        def refuse(*_: object) -> None:
            raise FormatError(f"{part} has a document type, which 3MF forbids: entities may expand")

        parser.StartElementHandler = open_element
        parser.EndElementHandler = close_element
        parser.StartDoctypeDeclHandler = refuse
        parser.StartNamespaceDeclHandler = prefix
        try:
            with self.archive.open(entry) as stream:
                _feed(parser, stream, part)
        except FormatError:
            raise
        except _DAMAGES as error:
            raise FormatError(f"the archive is damaged at {part}: {error}") from None


# Whatever zipfile raises over a damaged archive: NotImplementedError for a version or a method
# that it does not know, the others where it does not look twice.
_DAMAGES = (
    zipfile.BadZipFile,
    zlib.error,
    EOFError,
    NotImplementedError,
    RuntimeError,
    OverflowError,
    ValueError,
)


def _feed(parser: expat.XMLParserType, stream: IO[bytes], part: str) -> None:
    given = 0
    while piece := stream.read(_READ):
        _parse(parser, piece, part, last=False)
        given += len(piece)
        # A tag that does not end is gone through anew with each piece.
        if given - parser.CurrentByteIndex > _TAG:
            raise FormatError(f"{part} has a tag of more than {_TAG} bytes")
    _parse(parser, b"", part, last=True)


def _parse(parser: expat.XMLParserType, piece: bytes, part: str, *, last: bool) -> None:
    try:
        parser.Parse(piece, last)
    except FormatError:
        raise
    except (expat.ExpatError, LookupError, ValueError) as error:
        # The latter two for an encoding that Python does not know, or not byte by byte.
        raise FormatError(f"{part} is no sound XML: {error}") from None


def _part_name(name: str) -> str:
    """Names of parts are absolute and do not tell upper from lower case."""
    return posixpath.normpath("/" + name.lstrip("/")).lower()


class _Reader:
    """Takes in the elements of one model part."""

    def __init__(self, part: str) -> None:
        self.part = part
        self.model = _Model("millimeter", {}, [])
        self.sections: set[str] = set()
        self.prefixes: dict[str, str] = {}
        self.object = _Object()
        self.vertices, self.corners = Numbers(), array("q")
        self.things = 0
        # The elements around the one at hand; None for one that means nothing here.
        self.around: list[str | None] = [""]
        self.take: dict[str, Callable[[Attributes], None]] = {
            "model": self._take_model,
            "resources": lambda _: self.sections.add("resources"),
            "build": lambda _: self.sections.add("build"),
            "object": self._take_object,
            "mesh": self._take_mesh,
            "vertex": self._take_vertex,
            "triangle": self._take_triangle,
            "component": lambda a: self._take_use(self.object.uses, a, "component"),
            "item": lambda a: self._take_use(self.model.items, a, "item"),
        }

    def prefix(self, name: str | None, uri: str) -> None:
        """A prefix stands for a namespace from here on."""
        self.prefixes[name or ""] = uri

    def start(self, name: str, attributes: Attributes, depth: int) -> None:
        """An element begins."""
        tag = _TREE.get((self.around[-1], name))
        if tag is not None and tag in self.take:
            self.take[tag](attributes)
        elif depth == 0:
            raise FormatError(f"{self.part} is no 3MF model but {shown(name)}")
        self.around.append(tag)

    def end(self, _: str, __: int) -> None:
        """An element ends."""
        if self.around.pop() == "mesh":
            vertices = self.vertices.array().reshape(-1, 3)
            faces = np.array(self.corners, dtype=np.int64).reshape(-1, 3)
            if len(faces) and faces.max() >= len(vertices):
                raise FormatError(
                    f"a triangle uses vertex {faces.max()}; its mesh has {len(vertices)}, from 0 on"
                )
            self.object.mesh = Body(vertices, faces)

    def _take_model(self, attributes: Attributes) -> None:
        self._refuse_strange(attributes)
        self.model.units = attributes.get("unit", "millimeter")
        if self.model.units not in _UNITS:
            raise FormatError(
                f"the unit is {shown(self.model.units)}; expected one of {', '.join(_UNITS)}"
            )

    def _take_object(self, attributes: Attributes) -> None:
        number = self._required(attributes, "id", "object")
        if number in self.model.objects:
            raise FormatError(f"the object {shown(number)} is defined twice in {self.part}")
        self._count()
        self.object = self.model.objects[number] = _Object()

    def _take_mesh(self, _: Attributes) -> None:
        if self.object.mesh is not None:
            raise FormatError(f"an object in {self.part} has two meshes")
        self.vertices, self.corners = Numbers(), array("q")

    def _take_vertex(self, attributes: Attributes) -> None:
        self.vertices.add([self._required(attributes, axis, "vertex").encode() for axis in "xyz"])

    def _take_triangle(self, attributes: Attributes) -> None:
        for name in ("v1", "v2", "v3"):
            found = self._required(attributes, name, "triangle")
            if not _NUMBER.fullmatch(found):
                raise FormatError(
                    f"{name} of a triangle is {shown(found)}; expected a whole number"
                )
            self.corners.append(int(found))

    def _take_use(self, uses: list[_Use], attributes: Attributes, tag: str) -> None:
        part = attributes.get(f"{_PRODUCTION} path")
        key = (
            self.part if part is None else _part_name(part),
            self._required(attributes, "objectid", tag),
        )
        self._count()
        text = attributes.get("transform")
        if text is None:
            uses.append(_Use(key, None))
            return
        numbers = floats(text.encode().split())
        if len(numbers) != 12 or not np.isfinite(numbers).all():
            raise FormatError(f"the transform {shown(text)} is not of twelve finite numbers")
        uses.append(_Use(key, numbers.reshape(4, 3)))

    def _count(self) -> None:
        self.things += 1
        if self.things > _THINGS:
            raise FormatError(f"{self.part} has more than {_THINGS} objects, components and items")

    def _refuse_strange(self, attributes: Attributes) -> None:
        words = attributes.get("requiredextensions", "").split()
        words += attributes.get(f"{_COMPATIBILITY} MustUnderstand", "").split()
        for word in words:
            uri = self.prefixes.get(word)
            if uri not in _KNOWN:
                raise FormatError(
                    f"the file requires the extension {shown(word)} ({shown(uri or 'no namespace')}"
                    "), which clvox does not know; export it without"
                )

    def _required(self, attributes: Attributes, name: str, tag: str) -> str:
        found = attributes.get(name)
        if found is None:
            raise FormatError(f"an element {tag} in {self.part} has no {name}")
        return found


class _Build:
    """Places the objects of the build."""

    def __init__(self, package: _Package, root: str) -> None:
        self.package = package
        self.root = root
        self.models: dict[str, _Model] = {}
        self.sizes: dict[Key, tuple[int, int]] = {}

    def contents(self) -> Contents:
        """The bodies of all build items, as one mesh."""
        model = self._model(self.root)
        if not model.items:
            raise FormatError("the build has no items: nothing is placed")
        # All is counted before anything is placed: ten objects of ten of ten ... are soon many.
        self.package.budget.spend(sum(self._size(item.key, ())[0] for item in model.items))
        bodies: list[Body] = []
        for item in model.items:
            self._place(item, None, bodies)
        return joined(bodies, model.units)

    def _model(self, part: str) -> _Model:
        if part not in self.models:
            reader = _Reader(part)
            self.package.parse(part, reader.start, reader.end, reader.prefix)
            # A part that others take objects from may do without a build of its own.
            needed = {"resources", "build"} if part == self.root else {"resources"}
            missing = needed - reader.sections
            if missing:
                raise FormatError(f"{part} lacks the element {' and '.join(sorted(missing))}")
            self.models[part] = reader.model
        return self.models[part]

    def _object(self, key: Key) -> _Object:
        found = self._model(key[0]).objects.get(key[1])
        if found is None:
            raise FormatError(f"the object {shown(key[1])} is used; {key[0]} does not define it")
        return found

    def _size(self, key: Key, above: tuple[Key, ...]) -> tuple[int, int]:
        """Bytes that placing an object takes, and the levels of objects below it."""
        if key in above:
            raise FormatError(f"the object {shown(key[1])} is a component of itself")
        if key not in self.sizes and len(above) < _DEPTH:
            placed = self._object(key)
            size, height = _PLACE, 0
            if placed.mesh is not None:
                size += placed.mesh.vertices.nbytes + placed.mesh.faces.nbytes
            for use in placed.uses:
                more, levels = self._size(use.key, (*above, key))
                size, height = size + more, max(height, levels + 1)
            self.sizes[key] = size, height
        if key not in self.sizes or self.sizes[key][1] + len(above) >= _DEPTH:
            raise FormatError(f"components are nested more than {_DEPTH} deep")
        return self.sizes[key]

    def _place(self, use: _Use, outer: NDArray[np.float64] | None, bodies: list[Body]) -> None:
        inner = use.transform
        if inner is not None and outer is not None:
            with np.errstate(over="ignore", invalid="ignore"):
                inner = inner @ outer[:3]
                inner[3] += outer[3]
        elif inner is None:
            inner = outer
        placed = self._object(use.key)
        if placed.mesh is not None and len(placed.mesh.faces):
            mesh = placed.mesh
            if inner is not None:
                if not np.isfinite(inner).all() or np.linalg.det(inner[:3]) == 0:
                    raise FormatError(
                        f"the transform of the object {shown(use.key[1])} is singular: it leaves "
                        "the mesh without volume"
                    )
                mesh = moved(mesh, inner[:3], inner[3])
            bodies.append(mesh)
        for part in placed.uses:
            self._place(part, inner, bodies)
