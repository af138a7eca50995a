"""`clvox.mesh.load`: sound files, broken files, and files that mean harm."""

from __future__ import annotations

import contextlib
import gzip
import json
import os
import struct
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from clvox import _formats
from clvox.errors import ClvoxError, FormatError, MeshError
from clvox.mesh import check, load

SMALL = Path(__file__).parent.parent / "data"
READ = ("stl", "obj", "ply", "stl.gz", "obj.gz", "ply.gz")

MANIFEST = Path(os.environ.get("CLVOX_DATA", "")) / "manifest.json"
ENTRIES: list[dict[str, Any]] = (
    [one for one in json.loads(MANIFEST.read_text())["entries"] if one["format"] in READ]
    if "CLVOX_DATA" in os.environ
    else []
)


def entries(expected: str, *, hostile: bool = False) -> list[Any]:
    """The files of the data whose expected outcome begins with this word."""
    found = [
        one
        for one in ENTRIES
        if one["expected"].startswith(expected) and hostile == (one["category"] == "hostile")
    ]
    # Without the data, one test that is skipped says so.
    return [pytest.param(one, id=one["path"]) for one in found or [{"path": "manifest.json"}]]


def binary_stl(triangles: int, *, claim: int | None = None, header: bytes = b"") -> bytes:
    count = triangles if claim is None else claim
    corners = np.random.default_rng(0).normal(size=(triangles, 3, 3))
    table = np.zeros(triangles, _formats._STL)
    table["corners"] = corners
    return header.ljust(80, b" ") + struct.pack("<I", count) + table.tobytes()


FACET = "facet normal 0 0 1 outer loop vertex {} endloop endfacet\n"
CORNERS = "0 0 0 vertex 1 0 0 vertex 0 1 0.5"
ASCII = "solid a b\n" + FACET.format(CORNERS) + "endsolid a b\n"
OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\n"


def ply(body: bytes | str, *, order: str = "ascii", vertices: int = 3, faces: int = 1) -> bytes:
    head = (
        f"ply\nformat {order} 1.0\ncomment x\nelement vertex {vertices}\nproperty float x\n"
        f"property float y\nproperty float z\nelement face {faces}\n"
        "property list uchar int vertex_indices\nend_header\n"
    )
    return head.encode() + (body.encode() if isinstance(body, str) else body)


TRIANGLE = "0 0 0\n1 0 0\n0 1 0.5\n3 0 1 2\n"
POINTS = np.array([0, 0, 0, 1, 0, 0, 0, 1, 0.5], "<f4").tobytes()


# --- sound files --------------------------------------------------------------------------------


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("kind", ["stl", "stl_ascii", "obj", "ply", "ply_ascii"])
def test_what_trimesh_writes_is_read_as_it_is(tmp_path: Path, kind: str, packed: bool) -> None:
    mesh = trimesh.creation.icosphere(subdivisions=2)
    mesh.vertices = np.asarray(mesh.vertices, np.float32)
    options = {"encoding": "ascii"} if kind == "ply_ascii" else {}
    data = mesh.export(file_type=kind.removesuffix("_ascii") if options else kind, **options)
    data = data.encode() if isinstance(data, str) else data
    path = tmp_path / f"ball.{kind.removesuffix('_ascii').upper()}{'.gz' * packed}"
    path.write_bytes(gzip.compress(data) if packed else data)
    found = load(path)
    assert found.vertices.dtype == np.float64
    if "stl" in kind:
        assert len(found.vertices) == 3 * len(mesh.faces)
    else:
        np.testing.assert_array_equal(found.faces, mesh.faces)
    np.testing.assert_allclose(found.triangles, mesh.triangles, rtol=0, atol=1e-7)
    surface = check(str(path))
    assert surface.closed
    assert surface.oriented
    assert len(surface.vertices) == len(mesh.vertices)


@pytest.mark.parametrize("header", [b"solid of course", b"", b"\xff\x00"])
def test_binary_stl_is_known_by_its_length(tmp_path: Path, header: bytes) -> None:
    path = tmp_path / "a.stl"
    path.write_bytes(binary_stl(7, header=header))
    assert len(load(path).faces) == 7


@pytest.mark.parametrize(
    "text",
    [
        ASCII,
        ASCII.upper(),
        ASCII.replace("\n", "\r\n"),
        ASCII.replace("\n", "\r"),
        "\n  " + ASCII.replace(" ", "\t ") + "\n\n",
        ASCII.replace("endsolid a b", "end solid"),
        "solid\nendsolid\n" + ASCII,
        ASCII.replace("a b", "facet vertex"),
    ],
)
def test_ascii_stl_may_be_laid_out_freely(tmp_path: Path, text: str) -> None:
    path = tmp_path / "a.stl"
    path.write_bytes(text.encode())
    assert load(path).triangles.tolist() == [[[0, 0, 0], [1, 0, 0], [0, 1, 0.5]]]


def test_long_ascii_stl_is_read_in_pieces(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_formats, "_CHUNK", 300)
    corners = [CORNERS.replace("0.5", str(i)) for i in range(40)]
    path = tmp_path / "a.stl"
    path.write_text("solid\n" + "".join(map(FACET.format, corners)) + "endsolid")
    assert load(path).triangles[:, 2, 2].tolist() == list(range(40))
    corners[31] = corners[31].replace("31", "3l")
    path.write_text("solid\n" + "".join(map(FACET.format, corners)) + "endsolid")
    with pytest.raises(FormatError, match="'3l' stands where a number should"):
        load(path)


def test_obj_with_all_it_may_have(tmp_path: Path) -> None:
    path = tmp_path / "a.obj"
    path.write_text(
        "# c\nmtllib none.mtl\no one\nv 0 0 0 1.0\nv 1 0 0 0.5 0.5 0.5\nv 1 1 0\nv 0 1 0\n"
        "vt 0 0\nvn 0 0 1\ng a\nf 1/1/1 2//1 3 4/1\no two\nv 5 5 5\nf -1 \\\n -2 1\n\nl 1 2\n"
    )
    found = load(path)
    assert found.faces.tolist() == [[0, 1, 2], [0, 2, 3], [4, 3, 0]]
    assert len(found.vertices) == 5


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("mixed", [False, True])
def test_binary_ply_with_other_elements(tmp_path: Path, order: str, mixed: bool) -> None:
    name = {"<": "little", ">": "big"}[order]
    head = (
        f"ply\r\nformat binary_{name}_endian 1.0\r\nobj_info x\r\nelement strip 2\r\n"
        "property list ushort float w\r\nproperty short q\r\nelement vertex 4\r\n"
        "property uchar red\r\nproperty double x\r\nproperty double y\r\nproperty double z\r\n"
        "element face 2\r\nproperty list uchar uint vertex_index\r\nproperty float area\r\n"
        "end_header\r\n"
    )
    body = struct.pack(order + "HffhHh", 2, 1.0, 2.0, 3, 0, 4)
    corners = [(0.0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 1e-9)]
    for corner in corners:
        body += struct.pack(order + "Bddd", 9, *corner)
    faces = [(0, 1, 2), (3, 2, 1, 0) if mixed else (3, 2, 1)]
    for face in faces:
        body += struct.pack(order + f"B{len(face)}If", len(face), *face, 1.0)
    path = tmp_path / "a.ply"
    path.write_bytes(head.encode() + body)
    found = load(path)
    assert found.vertices.tolist() == [list(map(float, corner)) for corner in corners]
    assert found.faces.tolist() == [[0, 1, 2], [3, 2, 1], [3, 1, 0]][: 3 if mixed else 2]


def test_ascii_ply_with_polygons(tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    path.write_bytes(ply("0 0 0 1 0 0 1 1 0 0 1 0\n3 0 1 2\n4 0 1 2 3\n", vertices=4, faces=2))
    assert load(path).faces.tolist() == [[0, 1, 2], [0, 1, 2], [0, 2, 3]]


@given(counts=st.lists(st.integers(3, 7), min_size=1, max_size=6))
def test_fan_has_the_boundary_of_its_polygon(counts: list[int]) -> None:
    flat = np.arange(sum(counts))
    fans = _formats._fans(flat, np.array(counts))
    assert len(fans) == sum(counts) - 2 * len(counts)
    sides = {(a, b) for face in fans.tolist() for a, b in zip(face, face[1:] + face[:1])}  # noqa: B905
    rim = {(a, b) for a, b in sides if (b, a) not in sides}
    begins = np.cumsum([0, *counts])
    for begin, count in zip(begins, counts):  # noqa: B905
        assert {(begin + i, begin + (i + 1) % count) for i in range(count)} <= rim
    assert len(rim) == sum(counts)


# --- broken files -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("a.step", b"x", "cannot read a file with the suffix '.step'; clvox reads STL, OBJ, PLY"),
        ("a.glb.gz", b"x", "cannot read a file with the suffix '.glb.gz'"),
        ("a", b"x", "cannot read a file with no suffix"),
        ("a.gz", b"x", "cannot read a file with the suffix '.gz'"),
        ("a.stl", b"", "the file is empty"),
        ("a.stl", binary_stl(3, claim=4), "its header says 4 triangles, which take 284 bytes, but"),
        ("a.stl", binary_stl(3, claim=2**32 - 1), "says 4294967295 triangles, which take 21474836"),
        ("a.stl", binary_stl(3) + b"x", "3 triangles, which take 234 bytes, but it has 235"),
        ("a.stl", binary_stl(0), "the file holds no triangles"),
        ("a.stl", b"hello", "no STL file: it has 5 bytes and does not begin with 'solid'"),
        ("a.stl", b"solid", "the file does not end with 'endsolid'; it was cut short"),
        ("a.stl", ASCII.replace("endsolid", "end"), "does not end with 'endsolid'"),
        ("a.stl", ASCII.replace("outer", "inner"), "triangle 0 is malformed: 'inner' stands where"),
        ("a.stl", ASCII.replace("endfacet", ""), "triangle 0 is cut short"),
        ("a.stl", ASCII.replace("0.5", "0.5 7"), "'7' stands where 'endloop' should"),
        ("a.stl", ASCII.replace("0.5", "1_0"), "'1_0' stands where a number should"),
        ("a.stl", ASCII.replace("0.5", "x" * 9999), "'xxxxxxxxxxxxxxxxxxxxxxxx...' stands where"),
        ("a.obj", b"\0\1", "no OBJ file: it is binary"),
        ("a.obj", "v 0 0 0\n", "the file holds no faces"),
        ("a.obj", OBJ + "v 1 2\n", "line 6: a vertex needs three coordinates"),
        ("a.obj", OBJ + "v 1 2 x\n", "'x' stands where a number should"),
        ("a.obj", OBJ + "f 1 2\n", "line 6: a face needs at least three vertices"),
        ("a.obj", OBJ + "f 1 2 5\n", "a face uses vertex 5 of 4"),
        ("a.obj", OBJ + "f 1 2 0\n", "line 6: 0 is no vertex; they count from 1, or from -1"),
        ("a.obj", OBJ + "f 1 2 -5\n", "line 6: -5 is no vertex; they count from 1, or from -1"),
        ("a.obj", OBJ + "f 1 2 a/b\n", "line 6: 'a/b' is no vertex of a face"),
        ("a.obj", OBJ + "f 1 2 " + "9" * 99, "line 6: '999999999999999999999999...' is no vertex"),
        ("a.ply", b"hello", "no PLY file: it does not begin with 'ply' and a header"),
        ("a.ply", ply("").replace(b"end_header\n", b""), "no PLY file"),
        ("a.ply", ply(TRIANGLE).replace(b"comment", b"commend"), "means nothing: 'commend x'"),
        ("a.ply", ply(TRIANGLE).replace(b"ascii 1.0", b"ascii 2.0"), "line that means nothing"),
        ("a.ply", ply(TRIANGLE).replace(b"float y", b"float x"), "names something twice: x, x, z"),
        ("a.ply", ply(TRIANGLE).replace(b"float y", b"float u"), "vertices need x, y and z; the"),
        ("a.ply", ply(TRIANGLE).replace(b"vertex_indices", b"q"), "need a list vertex_indices"),
        ("a.ply", ply(TRIANGLE).replace(b"format ascii 1.0\n", b""), "header names no format"),
        ("a.ply", ply(TRIANGLE, faces=0), "the file holds no faces"),
        ("a.ply", ply(TRIANGLE, faces=2), "the file is shorter than its header says"),
        ("a.ply", ply(TRIANGLE, vertices=10**9), "the header says 1000000000 rows of vertex, more"),
        ("a.ply", ply(TRIANGLE.replace("3 0", "2 0")), "face 0 has 2 vertices"),
        ("a.ply", ply(TRIANGLE.replace("3 0", "-3 0")), "a list in the file has the length -3"),
        ("a.ply", ply(TRIANGLE.replace("3 0", "nan 0")), "a list in the file has the length nan"),
        (
            "a.ply",
            ply(TRIANGLE.replace("0 1 2", "0 1 3")),
            "a face uses vertex 3; the file holds 3",
        ),
        ("a.ply", ply(TRIANGLE.replace("0 1 2", "0 1 -1")), "a face uses vertex -1; the file"),
        ("a.ply", ply(TRIANGLE.replace("0 1 2", "0 1 1.5")), "a face uses vertex 1.5; the file"),
        ("a.ply", ply(TRIANGLE.replace("0 1 2", "0 1 nan")), "a face uses vertex nan; the file"),
        ("a.ply", ply(TRIANGLE.replace("0.5", "zero")), "'zero' stands where a number should"),
        (
            "a.ply",
            ply(POINTS + b"\xff\0\0\0\0", order="binary_little_endian"),
            "the file is shorter than its header says",
        ),
        (
            "a.ply",
            ply(POINTS, order="binary_little_endian", vertices=10**17),
            "the header says 100000000000000000 rows of vertex",
        ),
    ],
)
def test_broken_file_is_refused(tmp_path: Path, name: str, data: bytes | str, message: str) -> None:
    path = tmp_path / name
    path.write_bytes(data.encode() if isinstance(data, str) else data)
    with pytest.raises(FormatError) as caught:
        load(path)
    assert str(caught.value).startswith(f"{name}: ")
    assert message in str(caught.value)


@pytest.mark.parametrize("token", ["nan", "inf", "-1e999"])
@pytest.mark.parametrize("kind", ["stl", "obj", "ply"])
def test_number_that_is_not_finite_is_refused(tmp_path: Path, kind: str, token: str) -> None:
    text = {"stl": ASCII, "obj": OBJ.replace("1 0\n", "1 0.5\n"), "ply": ply(TRIANGLE).decode()}
    path = tmp_path / f"a.{kind}"
    path.write_text(text[kind].replace("0.5", token))
    with pytest.raises(MeshError, match=r"vertex 2 is \(0\.0, 1\.0, -?(nan|inf)\); all coord"):
        check(path)


def test_signalling_nan_is_refused_in_the_same_words(tmp_path: Path) -> None:
    data = bytearray(binary_stl(2))
    data[96:100] = struct.pack("<I", 0x7F800001)
    path = tmp_path / "a.stl"
    path.write_bytes(data)
    with pytest.raises(MeshError, match=r"vertex 0 is \(nan, "):
        check(path)


def test_damaged_gzip_is_refused(tmp_path: Path) -> None:
    data = gzip.compress(binary_stl(50))
    path = tmp_path / "a.stl.gz"
    for broken in (b"not gzip at all", data[:-20], data[:60] + b"\xff" * 20 + data[80:]):
        path.write_bytes(broken)
        with pytest.raises(FormatError, match="the gzip data are damaged"):
            load(path)


def test_gzip_bomb_stops_early(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_formats, "GZIP_FLOOR", 2**20)
    path = tmp_path / "a.stl.gz"
    path.write_bytes(gzip.compress(bytes(2**26)))
    tracemalloc.start()
    try:
        with pytest.raises(FormatError, match=r"65\d\d\d bytes expand to more than 7\d{6}; "):
            load(path)
        assert tracemalloc.get_traced_memory()[1] < 2**25
    finally:
        tracemalloc.stop()


def test_missing_file_and_folder(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        load(tmp_path / "none.stl")
    (tmp_path / "folder.stl").mkdir()
    with pytest.raises(FormatError, match="is a folder; expected a mesh file"):
        load(tmp_path / "folder.stl")


@given(data=st.data(), kind=st.sampled_from(["stl", "ascii.stl", "obj", "ply", "ascii.ply"]))
def test_garbled_file_is_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject, kind: str
) -> None:
    """Whatever bytes are changed, removed or repeated: a mesh, or one of our errors."""
    sound = {
        "stl": binary_stl(3),
        "ascii.stl": ASCII.encode(),
        "obj": OBJ.encode(),
        "ply": ply(POINTS + b"\3" + bytes(4) + b"\1\0\0\0\2\0\0\0", order="binary_little_endian"),
        "ascii.ply": ply(TRIANGLE),
    }[kind]
    garbled = bytearray(sound)
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(garbled)))
        cut = data.draw(st.integers(0, 8))
        garbled[at : at + cut] = data.draw(st.binary(max_size=8))
    path = tmp_path_factory.mktemp("garbled") / f"a.{kind}"
    path.write_bytes(garbled)
    with contextlib.suppress(ClvoxError):
        check(path)


# --- the meshes of the repository ---------------------------------------------------------------

OPEN = {"triangle_soup_100.stl"}
WARNED = {
    "angle_block.stl": "vertices were merged with others within 1.35e-08",
    "grid_aligned_boxes.ply": "belong to more than two triangles",
    "two_bodies_inconsistent_winding.stl": "the mesh is not oriented: 12 edges",
    "triangle_soup_100.stl": "the mesh is open: 300 edges belong to one triangle only",
}


@pytest.mark.parametrize("name", sorted(path.name for path in SMALL.glob("*.[sop][tbl]*")))
def test_small_mesh(name: str) -> None:
    surface = check(SMALL / name)
    assert surface.closed == (name not in OPEN)
    assert len(surface.warnings) == (name in WARNED)
    assert WARNED.get(name, "") in "".join(surface.warnings)
    table = (SMALL / "README.md").read_text()
    assert f"| {name} | {len(load(SMALL / name).faces)} |" in table


# --- the meshes of CLVOX_DATA -------------------------------------------------------------------


@pytest.mark.parametrize("entry", entries("solid"))
def test_solid_is_closed(data_file: Callable[[str], Path], entry: dict[str, Any]) -> None:
    mesh = load(data_file(entry["path"]))
    assert len(mesh.faces) == entry["triangles"]
    surface = check(mesh)
    assert surface.closed
    # Triangles without area hold T-junctions shut; nothing but exact copies may be dropped.
    assert surface.oriented
    assert not surface.repeated
    assert bool(surface.welded_by) == entry["watertight_needs_tolerance_weld"]
    assert bool(surface.welded_by) == ("were merged" in "".join(surface.warnings))
    np.testing.assert_allclose(surface.bounds, entry["bbox"], rtol=1e-6)


@pytest.mark.parametrize("entry", entries("warns"))
def test_doubtful_mesh_gets_a_diagnosis(
    data_file: Callable[[str], Path], entry: dict[str, Any]
) -> None:
    path = data_file(entry["path"])
    if entry["path"].endswith("single_sheet_square.stl"):
        with pytest.raises(MeshError, match="the mesh is flat"):
            check(path)
        return
    surface = check(path)
    # Nobody sees from the edges alone that a surface runs through itself.
    assert surface.warnings or "self_intersecting" in entry["path"]


@pytest.mark.timeout(10)
@pytest.mark.parametrize("entry", entries("", hostile=True))
def test_hostile_file_is_refused(data_file: Callable[[str], Path], entry: dict[str, Any]) -> None:
    path = data_file(entry["path"])
    tracemalloc.start()
    try:
        with pytest.raises(ClvoxError) as caught:
            check(path)
        assert tracemalloc.get_traced_memory()[1] < 32 * path.stat().st_size + 2**25
    finally:
        tracemalloc.stop()
    assert len(str(caught.value)) > 20
