"""Small sound files of the formats with structure, made from nothing but the standards."""

from __future__ import annotations

import base64
import io
import json
import struct
import zipfile
from typing import Any

TETRAHEDRON = [(0, 0, 0), (10, 0, 0), (0, 10, 0), (0, 0, 10)]
SIDES = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]

CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
PRODUCTION = "http://schemas.microsoft.com/3dmanufacturing/production/2015/06"
MODEL = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
RELATIONSHIPS = "http://schemas.openxmlformats.org/package/2006/relationships"

OFF = (
    "OFF # a tetrahedron\n\n4 4 6\n"
    + "".join(f"{x} {y} {z}\n" for x, y, z in TETRAHEDRON)
    + "".join(f"3 {a} {b} {c}\n" for a, b, c in SIDES)
)


# --- glTF ---------------------------------------------------------------------------------------

POINTS = b"".join(struct.pack("<3f", *point) for point in TETRAHEDRON)
CORNERS = b"".join(struct.pack("<3H", *side) for side in SIDES)


def scene(**changes: Any) -> dict[str, Any]:
    """Return a tetrahedron as glTF, whose buffer is to be told yet."""
    return {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 12, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 48},
            {"buffer": 0, "byteOffset": 48, "byteLength": 24},
        ],
        "buffers": [{"byteLength": 72}],
    } | changes


def embedded(data: bytes) -> list[dict[str, Any]]:
    """Return the list of buffers with *data* inside it."""
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    return [{"byteLength": len(data), "uri": uri}]


def gltf(**changes: Any) -> bytes:
    """Return a glTF file of a tetrahedron, with its buffer inside."""
    return json.dumps(scene(**({"buffers": embedded(POINTS + CORNERS)} | changes))).encode()


def glb(binary: bytes = POINTS + CORNERS, **changes: Any) -> bytes:
    """Return a GLB file of a tetrahedron."""
    text = json.dumps(scene(**changes)).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    if binary:
        chunks += struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


# --- 3MF ----------------------------------------------------------------------------------------

MESH = (
    "<mesh><vertices>"
    + "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in TETRAHEDRON)
    + "</vertices><triangles>"
    + "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in SIDES)
    + "</triangles></mesh>"
)


def thing(number: int, content: str = MESH) -> str:
    """Return an object of a model."""
    return f'<object id="{number}">{content}</object>'


def model(
    resources: str = thing(1), build: str = '<item objectid="1"/>', attributes: str = ""
) -> str:
    """Return the text of a model part."""
    return (
        f'<?xml version="1.0" encoding="UTF-8"?><model xmlns="{CORE}" {attributes}>'
        f"<resources>{resources}</resources><build>{build}</build></model>"
    )


def relationships(*targets: str) -> str:
    """Return the text of the root relationships."""
    links = "".join(f'<Relationship Id="r" Type="{MODEL}" Target="{one}"/>' for one in targets)
    return f'<Relationships xmlns="{RELATIONSHIPS}">{links}</Relationships>'


def archive(parts: dict[str, str | bytes]) -> bytes:
    """Return a zip archive."""
    written = io.BytesIO()
    with zipfile.ZipFile(written, "w", zipfile.ZIP_DEFLATED) as opened:
        for name, text in parts.items():
            opened.writestr(zipfile.ZipInfo(name), text, zipfile.ZIP_DEFLATED)
    return written.getvalue()


def threemf(text: str | bytes | None = None, **parts: str) -> bytes:
    """Return a 3MF file of a tetrahedron, or of the model part given."""
    known: dict[str, str | bytes] = {
        "_rels/.rels": relationships("/3D/3dmodel.model"),
        "3D/3dmodel.model": model() if text is None else text,
    }
    return archive({**known, **parts})
