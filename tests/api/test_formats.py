"""OFF, glTF and 3MF: what they may hold, what is refused, and what must not take long."""

from __future__ import annotations

import gzip
import json
import os
import re
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from clvox.cli import main
from clvox.errors import FormatError
from clvox.mesh import check, load
from tests.mesh_files import (
    CORE,
    CORNERS,
    MESH,
    OFF,
    POINTS,
    PRODUCTION,
    SIDES,
    TETRAHEDRON,
    archive,
    glb,
    gltf,
    model,
    relationships,
    thing,
    threemf,
)
from tests.repository import ROOT


def loaded(folder: Path, name: str, data: bytes | str) -> trimesh.Trimesh:
    path = folder / name
    path.write_bytes(data.encode() if isinstance(data, str) else data)
    return load(path)


def rows(array: Any) -> Any:
    """As lists, which compare at once."""
    return np.asarray(array).tolist()


def bodies_of(mesh: trimesh.Trimesh) -> Any:
    """The number of the body of each triangle."""
    return rows(mesh.face_attributes["body"])


def is_tetrahedron(mesh: trimesh.Trimesh) -> bool:
    places, sides = [[*point] for point in TETRAHEDRON], [[*side] for side in SIDES]
    return bool(rows(mesh.vertices) == places and rows(mesh.faces) == sides)


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("name", ["a.off", "a.glb", "a.gltf", "a.3mf"])
def test_sound_file_is_read(tmp_path: Path, name: str, packed: bool) -> None:
    data = {"a.off": OFF.encode(), "a.glb": glb(), "a.gltf": gltf(), "a.3mf": threemf()}[name]
    mesh = loaded(tmp_path, name + ".gz" * packed, gzip.compress(data) if packed else data)
    assert is_tetrahedron(mesh)
    surface = check(mesh)
    assert surface.oriented
    assert not surface.warnings


@pytest.mark.parametrize("kind", ["off", "glb"])
def test_what_trimesh_writes_is_read(tmp_path: Path, kind: str) -> None:
    ball = trimesh.creation.icosphere(subdivisions=2)
    ball.vertices = np.asarray(ball.vertices, np.float32)
    ball.export(tmp_path / f"a.{kind}")
    mesh = load(tmp_path / f"a.{kind}")
    np.testing.assert_allclose(mesh.vertices, ball.vertices, rtol=0, atol=1e-7)
    np.testing.assert_array_equal(mesh.faces, ball.faces)


# --- OFF ----------------------------------------------------------------------------------------

PYRAMID = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n0 0 1\n4 0 3 2 1\n3 0 1 4\n3 1 2 4\n3 2 3 4\n3 3 0 4\n"


@pytest.mark.parametrize(
    "text",
    [
        "OFF 5 5 0\n" + PYRAMID,
        "OFF\r\n5 5 8\r\n" + PYRAMID.replace("\n", "\r\n"),
        "# c\n\nOFF\n# c\n5 5 0 # c\n\n" + PYRAMID.replace("\n", " # 7\n\n"),
        "COFF\n5 5 0\n" + PYRAMID.replace("\n", " 255 0 0 255\n", 5),
        "COFF\n5 5 0\n" + PYRAMID.replace("\n", " 0.5 0 0\n", 5),
        "NOFF\n5 5 0\n" + PYRAMID.replace("\n", " 0 0 1\n", 5),
        "STCNOFF\n5 5 0\n" + PYRAMID.replace("\n", " 0 0 1 1 1 1 1 0 0\n", 5),
        "OFF\n5 5 0\n" + PYRAMID.replace("0 4\n", "0 4 255 0 0\n"),
    ],
)
def test_off_with_all_it_may_have(tmp_path: Path, text: str) -> None:
    mesh = loaded(tmp_path, "a.off", text)
    assert len(mesh.vertices) == 5
    assert rows(mesh.faces[:2]) == [[0, 3, 2], [0, 2, 1]]
    assert rows(mesh.faces[2:]) == [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]
    assert "body" not in mesh.face_attributes
    assert mesh.units is None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("5 5 0\n" + PYRAMID, "begins with '5'; expected OFF"),
        ("4OFF\n5 5 0\n" + PYRAMID, "begins with '4OFF'; expected OFF"),
        ("OFF BINARY\n", "a binary OFF file; clvox reads those in text only"),
        ("OFF\n5 5\n" + PYRAMID, "line 2: '5 5' stands where the numbers of vertices, faces and"),
        ("OFF\n5 -5 0\n" + PYRAMID, "line 2: '5 -5 0' stands where"),
        ("OFF\n", "the file ends where the counts should be; it was cut short"),
        ("#\n", "the file ends where the keyword should be"),
        ("OFF\n5 10000000000 0\n" + PYRAMID, "5 vertices and 10000000000 faces, more than the"),
        ("OFF\n5 0 0\n" + PYRAMID, "the file holds no faces"),
        ("OFF\n5 6 0\n" + PYRAMID, "the file ends where face 5 of 6 should be"),
        ("OFF\n5 4 0\n" + PYRAMID, "line 12: '3' follows the last face"),
        ("OFF\n6 4 0\n" + PYRAMID, "line 8: vertex 5 has 5 numbers; in a file of the kind OFF it"),
        ("COFF\n5 5 0\n" + PYRAMID, "vertex 0 has 3 numbers; in a file of the kind COFF it has 6"),
        ("OFF\n5 5 0\n" + PYRAMID.replace("0 0 0", "0 0 o"), "'o' stands where a number should"),
        ("OFF\n5 5 0\n" + PYRAMID.replace("4 0 3", "2 0 3"), "line 8: face 0 begins with '2'"),
        ("OFF\n5 5 0\n" + PYRAMID.replace("4 0 3", "9 0 3"), "face 0 is cut short: 4 of 9 ver"),
        ("OFF\n5 5 0\n" + PYRAMID.replace("4 0 3", "4 0 -3"), "line 8: '-3' is no vertex of a"),
        ("OFF\n5 5 0\n" + PYRAMID.replace("4 0 3", "4 0 5"), "a face uses vertex 5; the file hol"),
        ("OFF\n5 5 0\n" + PYRAMID.replace("4 0 3", "4 0 " + "9" * 99), "'9999999999999999999999"),
    ],
)
def test_broken_off_is_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(FormatError) as caught:
        loaded(tmp_path, "a.off", text)
    assert message in str(caught.value)


# --- glTF ---------------------------------------------------------------------------------------


def test_gltf_places_what_its_nodes_say(tmp_path: Path) -> None:
    """A tree of nodes: the outer transform last; a mirror image keeps its outside outside."""
    half = 0.5**0.5
    mesh = loaded(
        tmp_path,
        "a.glb",
        glb(
            nodes=[
                {"children": [2, 1], "translation": [100, 0, 0]},
                {"mesh": 0, "scale": [1, 1, -2]},
                {"mesh": 0, "rotation": [0, 0, half, half], "translation": [0, 0, 5]},
                {"mesh": 0, "matrix": [0, 1, 0, 0, 0, 0, 1, 0, 1, 0, 0, 0, 1, 2, 3, 1]},
                {"mesh": 0},
            ],
            scenes=[{"nodes": []}, {"nodes": [0, 3]}],
            scene=1,
        ),
    )
    bodies = [
        [[100, 0, 5], [100, 10, 5], [90, 0, 5], [100, 0, 15]],
        [[100, 0, 0], [110, 0, 0], [100, 10, 0], [100, 0, -20]],
        [[1, 2, 3], [1, 12, 3], [1, 2, 13], [11, 2, 3]],
    ]
    np.testing.assert_allclose(mesh.vertices, np.concatenate(bodies), rtol=0, atol=1e-13)
    assert bodies_of(mesh) == [0] * 4 + [1] * 4 + [2] * 4
    assert np.asarray(mesh.face_attributes["body"]).dtype == np.int32
    assert mesh.units == "meter"
    surface = check(mesh)
    assert surface.oriented
    assert not surface.warnings  # none is inside out
    assert mesh.volume == pytest.approx(4000 / 6)


def test_gltf_without_a_scene_shows_all_its_roots(tmp_path: Path) -> None:
    data = glb(nodes=[{"mesh": 0}, {"children": [0]}, {"mesh": 0}], scenes=[])
    assert len(loaded(tmp_path, "a.glb", data).faces) == 8


def test_gltf_parts_of_a_mesh_share_their_vertices(tmp_path: Path) -> None:
    """Materials split a mesh into parts; lines and points bound nothing."""
    part = {"attributes": {"POSITION": 0}}
    accessors = [
        {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
        {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"},
        {"bufferView": 1, "byteOffset": 12, "componentType": 5123, "count": 6, "type": "SCALAR"},
    ]
    primitives = [part | {"indices": 1}, part | {"mode": 1}, part | {"indices": 2}]
    data = glb(meshes=[{"primitives": primitives, "weights": [0]}], accessors=accessors)
    mesh = loaded(tmp_path, "a.glb", data)
    assert is_tetrahedron(mesh)
    assert bodies_of(mesh) == [0] * 4


@pytest.mark.parametrize(
    ("mode", "faces"),
    [(5, [[0, 1, 2], [1, 3, 2]]), (6, [[1, 2, 0], [2, 3, 0]])],
)
def test_gltf_strips_and_fans(tmp_path: Path, mode: int, faces: list[list[int]]) -> None:
    meshes = [{"primitives": [{"attributes": {"POSITION": 0}, "mode": mode}]}]
    assert rows(loaded(tmp_path, "a.glb", glb(meshes=meshes)).faces) == faces


def test_gltf_rows_may_lie_apart_and_be_replaced(tmp_path: Path) -> None:
    """Vertices with a stride and an offset, one byte per corner, and a sparse accessor."""
    spread = b"".join(b"...." + struct.pack("<3f", *point) for point in TETRAHEDRON)
    sparse = b"\3" + struct.pack("<3f", 1, 2, 3)
    corners = bytes(i for side in SIDES for i in side)
    views = [
        {"buffer": 0, "byteLength": 64, "byteStride": 16},
        {"buffer": 0, "byteOffset": 64, "byteLength": 12},
        {"buffer": 0, "byteOffset": 76, "byteLength": 13},
    ]
    accessors: list[dict[str, Any]] = [
        {"bufferView": 0, "byteOffset": 4, "componentType": 5126, "count": 4, "type": "VEC3"},
        {"bufferView": 1, "componentType": 5121, "count": 12, "type": "SCALAR"},
    ]
    changes = {"buffers": [{"byteLength": 89}], "bufferViews": views, "accessors": accessors}
    binary = spread + corners + sparse
    assert is_tetrahedron(loaded(tmp_path, "a.glb", glb(binary, **changes)))
    accessors[0]["sparse"] = {
        "count": 1,
        "indices": {"bufferView": 2, "componentType": 5121},
        "values": {"bufferView": 2, "byteOffset": 1},
    }
    mesh = loaded(tmp_path, "a.glb", glb(binary, **changes))
    assert rows(mesh.vertices) == [*map(list, TETRAHEDRON[:3]), [1, 2, 3]]
    del accessors[0]["bufferView"]  # then all others are zero
    mesh = loaded(tmp_path, "a.glb", glb(binary, **changes))
    assert rows(mesh.vertices) == [[0, 0, 0]] * 3 + [[1, 2, 3]]


def test_gltf_reads_buffers_beside_it(tmp_path: Path) -> None:
    (tmp_path / "a part.bin").write_bytes(POINTS + CORNERS + b"more")
    data = gltf(buffers=[{"byteLength": 72, "uri": "a%20part.bin"}])
    assert is_tetrahedron(loaded(tmp_path, "a.gltf", data))
    assert is_tetrahedron(loaded(tmp_path, "a.gltf.gz", gzip.compress(data)))


@pytest.mark.parametrize(
    "uri",
    ["../a.bin", "%2e%2e/a.bin", "..%2fa.bin", "sub/a.bin", "{folder}/a.bin", "file://{folder}/a.bin",
     "..\\a.bin", "C:a.bin", "", ".", "..", ".a.bin", "a.bin%00", "http://host/a.bin"],
)  # fmt: skip
def test_gltf_reads_no_file_elsewhere(tmp_path: Path, uri: str) -> None:
    """Nor does it say whether there is one."""
    folder = tmp_path / "inner" / "sub"
    folder.mkdir(parents=True)
    for place in (tmp_path, tmp_path / "inner", folder):
        for name in ("a.bin", ".a.bin"):
            (place / name).write_bytes(POINTS + CORNERS)
    uri = uri.replace("{folder}", str(folder))
    with pytest.raises(FormatError, match="in the folder of this one only, by their plain name"):
        loaded(folder, "a.gltf", gltf(buffers=[{"byteLength": 72, "uri": uri}]))


def test_gltf_follows_no_link_and_opens_no_device(tmp_path: Path) -> None:
    (tmp_path / "inner").mkdir()
    (tmp_path / "a.bin").write_bytes(POINTS + CORNERS)
    (tmp_path / "inner" / "a.bin").symlink_to(tmp_path / "a.bin")
    if hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / "inner" / "pipe.bin")
    for name in ("a.bin", "pipe.bin", "none.bin"):
        with pytest.raises(FormatError, match="no such file is in the folder"):
            loaded(tmp_path / "inner", "a.gltf", gltf(buffers=[{"byteLength": 72, "uri": name}]))


ACCESSOR = {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"}
INDICES = {"bufferView": 1, "componentType": 5123, "count": 12, "type": "SCALAR"}
VIEWS = [
    {"buffer": 0, "byteOffset": 0, "byteLength": 48},
    {"buffer": 0, "byteOffset": 48, "byteLength": 24},
]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"asset": {"version": "1.0"}}, "says glTF version '1.0'; clvox reads version 2"),
        ({"asset": 2}, "the file has no asset"),
        ({"extensionsRequired": ["KHR_draco_mesh_compression"]}, "needs 'KHR_draco_mesh_compress"),
        ({"nodes": {}}, "nodes is no list of objects"),
        ({"nodes": []}, "node 0 is used; the file has 0"),
        ({"scenes": [], "nodes": []}, "the file holds no triangles"),
        ({"nodes": [{"children": [0]}]}, "node 0 has two parents, or is its own ancestor"),
        ({"scenes": [{"nodes": [0, 0]}]}, "node 0 has two parents"),
        ({"nodes": [{"mesh": -1}]}, "mesh of node 0 is -1; expected a whole number"),
        ({"nodes": [{"mesh": True}]}, "mesh of node 0 is True; expected a whole number"),
        ({"nodes": [{"mesh": 0, "skin": 0}]}, "node 0 is bent by a skeleton"),
        ({"nodes": [{"mesh": 0, "weights": [1]}]}, "mesh 0 is morphed"),
        ({"nodes": [{"mesh": 0, "scale": [1, 1]}]}, "scale of node 0 is no list of 3 numbers"),
        ({"nodes": [{"mesh": 0, "scale": [1, 1, 10**400]}]}, "scale of node 0 is not finite"),
        ({"nodes": [{"mesh": 0, "rotation": [0, 0, 0, 0]}]}, "is no unit quaternion"),
        ({"nodes": [{"mesh": 0, "matrix": [1] * 16}]}, "matrix of node 0 is no affine transform"),
        (
            {"nodes": [{"children": [1], "scale": [1e300] * 3}, {"mesh": 0, "scale": [1e300] * 3}]},
            "the transform of node 1 is not finite",
        ),
        ({"meshes": [{"primitives": [{}]}]}, "primitive 0 of mesh 0 has no attribute POSITION"),
        ({"meshes": [{"primitives": [{"mode": 7}]}]}, "primitive 0 of mesh 0 has the mode 7"),
        ({"meshes": []}, "mesh 0 is used; the file has 0, from 0 on"),
        ({"accessors": [ACCESSOR | {"count": 5}, INDICES]}, "reaches beyond the view's 48 bytes"),
        ({"accessors": [ACCESSOR | {"count": 10**12}, INDICES]}, "bodies of this file of"),
        ({"accessors": [ACCESSOR | {"type": "VEC2"}, INDICES]}, "must be of the type VEC3"),
        ({"accessors": [ACCESSOR | {"componentType": 5122}, INDICES]}, "component type 5122"),
        ({"accessors": [ACCESSOR, INDICES | {"count": 11}]}, "11 corners, which make no whole"),
        ({"accessors": [ACCESSOR, INDICES | {"count": 0}]}, "accessor 1 is empty"),
        ({"accessors": [ACCESSOR | {"count": 3}, INDICES]}, "uses vertex 3 of 3"),
        ({"bufferViews": [VEC := VIEWS[0] | {"byteOffset": 40}, VIEWS[1]]}, "beyond its buffer of"),
        ({"bufferViews": [VEC | {"byteStride": 8}, VIEWS[1]]}, "rows of 12 bytes every 8 bytes"),
        ({"buffers": [{"byteLength": 73}]}, "buffer 0 is said to have 73 bytes; it has 72"),
        ({"buffers": [{"byteLength": 72, "uri": 7}]}, "the uri of buffer 0 is no text"),
        ({"buffers": [{"byteLength": 1, "uri": "data:,x"}]}, "is embedded as 'data:'; expected b"),
        ({"buffers": [{"byteLength": 1, "uri": "data:;base64,x*"}]}, "the base64 data of buffer 0"),
    ],
)
def test_broken_gltf_is_refused(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(FormatError) as caught:
        loaded(tmp_path, "a.glb", glb(**changes))
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"glTG", "it does not begin with 'glTF'"),
        (glb().replace(b"F\2", b"F\1"), "says glTF version 1; clvox reads version 2"),
        (glb()[:-1], "but the file has"),
        (glb() + b"x", "it was cut short, or bytes were added"),
        (glb().replace(b"BIN", b"BIM"), "buffer 0 names no file, and the file has no binary chunk"),
        (glb().replace(b"JSON", b"JSOM"), "the first chunk of the file is no JSON"),
        (glb().replace(b"\x48\0\0\0BIN", b"\x4c\0\0\0BIN"), "a chunk of 76 bytes reaches beyond"),
        (glb().replace(b'"scene":', b'"scene" '), "the JSON text is damaged"),
        (glb().replace(b'"scene": 0', b'"scene":1e'), "the JSON text is damaged"),
    ],
)
def test_broken_glb_is_refused(tmp_path: Path, data: bytes, message: str) -> None:
    with pytest.raises(FormatError) as caught:
        loaded(tmp_path, "a.glb", data)
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[" * 10**5, "it is nested too deeply"),
        ("[]", "the JSON text is no object"),
        ('{"a": NaN}', "the JSON text says NaN"),
        ('{"a": ' + "9" * 5000 + "}", "the JSON text is damaged"),
        ('{"a": [' + "{}," * 2**22 + "{}]}", "the JSON text has more than 4194304 values"),
        ("\udcff", "the JSON text is damaged"),
    ],
)
def test_strange_json_is_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(FormatError) as caught:
        loaded(tmp_path, "a.gltf", text.encode("utf-8", "surrogateescape"))
    assert message in str(caught.value)


# --- 3MF ----------------------------------------------------------------------------------------


def uses(*numbers: int, transform: str = "") -> str:
    words = f' transform="{transform}"' if transform else ""
    return (
        "<components>"
        + "".join(f'<component objectid="{one}"{words}/>' for one in numbers)
        + "</components>"
    )


def test_3mf_places_what_its_build_says(tmp_path: Path) -> None:
    """Components within items: the outer transform last; a mirror image stays right way out."""
    resources = (
        thing(1)
        + thing(2, uses(1, 1, transform="0 1 0 -1 0 0 0 0 1 1 2 3"))
        + thing(9, "<mesh><vertices/><triangles/></mesh>")
    )
    build = (
        '<item objectid="2" transform="1 0 0 0 1 0 0 0 -2 100 0 0"/><item objectid="9"/>'
        '<item objectid="1"/>'
    )
    mesh = loaded(tmp_path, "a.3mf", threemf(model(resources, build, 'unit="inch"')))
    moved = [[101, 2, -6], [101, 12, -6], [91, 2, -6], [101, 2, -26]]
    assert rows(mesh.vertices) == [*moved, *moved, *map(list, TETRAHEDRON)]
    assert bodies_of(mesh) == [0] * 4 + [1] * 4 + [2] * 4
    assert mesh.units == "inch"
    assert mesh.volume == pytest.approx(5000 / 6)


def test_3mf_measures_in_millimetres_unless_it_says_otherwise(tmp_path: Path) -> None:
    assert loaded(tmp_path, "a.3mf", threemf()).units == "millimeter"


def test_3mf_in_utf_16_and_with_what_we_do_not_read(tmp_path: Path) -> None:
    """Other elements, also of the same names elsewhere, mean nothing."""
    text = model(
        thing(1, MESH + "<metadatagroup><vertex/><object/></metadatagroup>")
        + '<x:object xmlns:x="urn:x"><mesh><triangle/></mesh></x:object><object id="3"/>',
        attributes='xmlns:m="http://schemas.microsoft.com/3dmanufacturing/material/2015/02" '
        'requiredextensions="m"',
    )
    assert is_tetrahedron(loaded(tmp_path, "a.3mf", threemf(text)))
    wide = text.replace("UTF-8", "UTF-16").encode("utf-16")
    assert is_tetrahedron(loaded(tmp_path, "a.3mf", threemf(wide)))
    assert is_tetrahedron(loaded(tmp_path, "a.3mf", threemf("\ufeff" + text)))


def test_3mf_objects_may_be_in_other_parts(tmp_path: Path) -> None:
    """The production extension; names of parts do not tell upper from lower case."""
    component = '<components><component objectid="1" p:path="/3D/Other.model"/></components>'
    attributes = f'xmlns:p="{PRODUCTION}" requiredextensions="p"'
    main = model(thing(1, component), attributes=attributes)
    other = f'<model xmlns="{CORE}" unit="inch"><resources>{thing(1)}</resources></model>'
    mesh = loaded(tmp_path, "a.3mf", threemf(main, **{"3d/other.MODEL": other}))
    assert is_tetrahedron(mesh)
    assert mesh.units == "millimeter"
    with pytest.raises(FormatError, match=r"the part '/3d/other\.model' is not in the archive"):
        loaded(tmp_path, "a.3mf", threemf(main))


SINGULAR = '<item objectid="1" transform="1 0 0 0 1 0 0 0 0 0 0 0"/>'
BILLION = thing(1) + "".join(thing(n, uses(*[n - 1] * 10)) for n in range(2, 12))
CHAIN = thing(1) + "".join(thing(n, uses(n - 1)) for n in range(2, 2000))
ENTITY = model().replace("<model", '<!DOCTYPE model [<!ENTITY a "b">]><model', 1)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (model().replace("</model>", ""), "/3d/3dmodel.model is no sound XML: "),
        (model().replace("UTF-8", "UTF-7"), "/3d/3dmodel.model is no sound XML: "),
        (model().replace("UTF-8", "big5"), "/3d/3dmodel.model is no sound XML: "),
        (ENTITY, "/3d/3dmodel.model has a document type, which 3MF forbids"),
        (model().replace(CORE, "urn:x"), "is no 3MF model but 'urn:x model'"),
        (f'<model xmlns="{CORE}"><build/></model>', "lacks the element resources"),
        (f'<model xmlns="{CORE}"><resources/></model>', "lacks the element build"),
        (model(attributes='unit="mile"'), "the unit is 'mile'; expected one of micron"),
        (model(attributes='requiredextensions="b"'), "requires the extension 'b' ('no namespace')"),
        (
            model(attributes='xmlns:b="urn:beams" requiredextensions="b"'),
            "the file requires the extension 'b' ('urn:beams'), which clvox does not know",
        ),
        (
            model(
                attributes='xmlns:b="urn:beams" mc:MustUnderstand="b" xmlns:mc='
                '"http://schemas.openxmlformats.org/markup-compatibility/2006"'
            ),
            "the file requires the extension 'b' ('urn:beams')",
        ),
        (model(build=""), "the build has no items"),
        (model(build="<item/>"), "an element item in /3d/3dmodel.model has no objectid"),
        (model(build='<item objectid="7"/>'), "the object '7' is used; /3d/3dmodel.model does not"),
        (model(build='<item objectid="1" transform="1 2"/>'), "'1 2' is not of twelve finite"),
        (model(build=SINGULAR), "the transform of the object '1' is singular"),
        (model(thing(1) + thing(1)), "the object '1' is defined twice"),
        (model(thing(1, MESH + MESH)), "has two meshes"),
        (model(thing(1, "")), "the file holds no triangles"),
        (model(thing(1, uses(1))), "the object '1' is a component of itself"),
        (model(thing(1, uses(2)) + thing(2, uses(1))), "the object '1' is a component of itself"),
        (model(CHAIN, '<item objectid="1999"/>'), "components are nested more than 64 deep"),
        (
            model(CHAIN, "".join(f'<item objectid="{n}"/>' for n in range(1, 2000))),
            "components are nested more than 64 deep",
        ),
        (model(BILLION, '<item objectid="11"/>'), "because they are repeated"),
        (model().replace('z="10"', ""), "an element vertex in /3d/3dmodel.model has no z"),
        (model().replace('z="10"', 'z="ten"'), "'ten' stands where a number should"),
        (model().replace('v3="3"', 'v3="-3"'), "v3 of a triangle is '-3'; expected a whole number"),
        (model().replace('v3="3"', 'v3="\u0663"'), "v3 of a triangle is '\\\\xd9\\\\xa3'"),
        (model().replace('v3="3"', 'v3="4"'), "a triangle uses vertex 4; its mesh has 4, from 0"),
        (model("<a>" * 99 + "</a>" * 99), "elements nested more than 64 deep"),
        (model("<!--" + "x" * 2**23 + "-->"), "has a tag of more than 4194304 bytes"),
        (model(" " * 2**25), "expands to 33554"),
        (model("<object/>"), "an element object in /3d/3dmodel.model has no id"),
        (model("".join(f'<object id="{n}"/>' for n in range(2**18 + 1))), "more than 262144 obj"),
    ],
)  # fmt: skip
def test_broken_3mf_is_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(FormatError) as caught:
        loaded(tmp_path, "a.3mf", threemf(text))
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"PK\3\4 and no more", "no 3MF file: no sound zip archive"),
        (archive({"a": ""}), "the part '/_rels/.rels' is not in the archive"),
        (archive({"_rels/.rels": relationships()}), "names 0 model parts; a 3MF file has exactly"),
        (archive({"_rels/.rels": relationships("/a", "/b")}), "names 2 model parts"),
        (archive({"_rels/.rels": relationships("/a")}), "the part '/a' is not in the archive"),
        (threemf(**{"3d/3DMODEL.model": ""}), "'/3d/3dmodel.model' is twice in the archive"),
        (archive({f"{n}": "" for n in range(2**14 + 1)}), "the archive has more than 16384 entr"),
    ],
)
def test_broken_archive_is_refused(tmp_path: Path, data: bytes, message: str) -> None:
    with pytest.raises(FormatError) as caught:
        loaded(tmp_path, "a.3mf", data)
    assert message in str(caught.value)


def test_3mf_entries_outside_of_the_archive_are_never_written(tmp_path: Path) -> None:
    folder = tmp_path / "a" / "b"
    folder.mkdir(parents=True)
    text = model().encode()
    data = archive(
        {
            "_rels/.rels": relationships("../../3D/3dmodel.model"),
            "../../3D/3dmodel.model": text,
            "../../outside.txt": "x",
        }
    )
    assert is_tetrahedron(loaded(folder, "a.3mf", data))
    assert [path.name for path in sorted(tmp_path.rglob("*"))] == ["a", "b", "a.3mf"]


def test_many_placed_bodies_are_counted_before_they_are_made(tmp_path: Path) -> None:
    """In glTF, too: nodes that draw one mesh again and again."""
    zeros = {"componentType": 5126, "count": 3 * 10**4, "type": "VEC3"}
    meshes = [{"primitives": [{"attributes": {"POSITION": 0}}]}]
    nodes = [{"mesh": 0}] * 999
    with pytest.raises(FormatError, match="because they are repeated"):
        loaded(tmp_path, "a.gltf", gltf(accessors=[zeros], meshes=meshes, nodes=nodes, scenes=[]))


# --- the files of CLVOX_DATA, each in a process with a gigabyte ---------------------------------

GUARDED = """
import resource, sys
from clvox.cli import main
resource.setrlimit(resource.RLIMIT_AS, (2**32, 2**32))
statuses = [main(["info", path]) for path in sys.argv[1:]]
print(*statuses, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="limits and kilobytes as Linux has them")
@pytest.mark.timeout(60)
def test_hostile_files_stay_within_a_gigabyte_and_write_nothing(
    tmp_path: Path, data_file: Callable[[str], Path]
) -> None:
    manifest = json.loads(data_file("manifest.json").read_text())
    kinds = {"stl", "obj", "ply", "off", "glb", "3mf"}
    entries = [
        entry
        for entry in manifest["entries"]
        if entry["category"] == "hostile" and entry["format"] in kinds
    ]
    run = subprocess.run(
        [sys.executable, "-c", GUARDED, *(data_file(entry["path"]) for entry in entries)],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"},
        check=True,
        capture_output=True,
        text=True,
        timeout=50,
    )
    *statuses, kilobytes = run.stdout.splitlines()[-1].split()
    complaints = [line for line in run.stderr.splitlines() if line.startswith("clvox: error: ")]
    assert len(statuses) == len(entries)
    for entry, status in zip(entries, statuses, strict=True):
        outcome = {"0": "solid", "1": "refused"}[status]
        assert outcome in entry["expected"].split(), entry["path"]
    assert len(complaints) == statuses.count("1")
    assert "Traceback" not in run.stderr
    assert int(kilobytes) < 2**20
    assert not list(tmp_path.iterdir())


def test_info_tells_bodies_and_units(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "a.3mf"
    build = '<item objectid="1"/><item objectid="1" transform="1 0 0 0 1 0 0 0 1 99 0 0"/>'
    path.write_bytes(threemf(model(build=build, attributes='unit="inch"')))
    assert main(["info", str(path), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["bodies"], found["units"]) == (2, "inch")
    assert main(["info", str(path)]) == 0
    said = capsys.readouterr().out
    assert re.search("bodies +2", said)
    assert re.search("unit +inch", said)
