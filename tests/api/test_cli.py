"""The command line: what it prints, what it writes, and how it ends."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pytest
import trimesh
from PIL import Image

import clvox
from clvox.cli import main
from clvox.cli.arguments import parse
from clvox.cli.files import bytes_in_words
from tests.repository import ROOT

Shell = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def ball(tmp_path: Path) -> Path:
    path = tmp_path / "ball.stl"
    trimesh.creation.icosphere(radius=10.0).export(path)
    return path


@pytest.fixture
def open_ball(tmp_path: Path) -> Path:
    path = tmp_path / "open.ply"
    whole = trimesh.creation.icosphere(subdivisions=1)
    trimesh.Trimesh(whole.vertices, whole.faces[1:], process=False).export(path)
    return path


@pytest.fixture
def shell(tmp_path: Path) -> Shell:
    """Run Python in a process of its own, far from the tree."""

    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, *arguments],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            check=False,
            capture_output=True,
            text=True,
        )

    return run


def only_file(folder: Path) -> str:
    """Name of the one file in a folder."""
    (path,) = folder.iterdir()
    return path.name


# What is said


def test_version_and_help_load_nothing_heavy(shell: Shell) -> None:
    """They answer at once, and where no driver is installed."""
    for argument in ("--version", "--help"):
        script = (
            "import sys\nfrom clvox.cli import main\n"
            f"try: main(['{argument}'])\nexcept SystemExit as end: assert end.code == 0\n"
            "print([m for m in ('pyopencl', 'trimesh', 'skimage', 'PIL', 'tqdm') "
            "if m in sys.modules])"
        )
        lines = shell("-c", script).stdout.splitlines()
        assert lines[-1] == "[]"
        assert clvox.__version__ in lines[0] or "usage: clvox" in lines[0]


def test_module_is_the_command(shell: Shell) -> None:
    done = shell("-m", "clvox", "--version")
    assert (done.returncode, done.stdout) == (0, f"clvox {clvox.__version__}\n")


def test_devices_are_those_of_the_library(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["devices", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["devices"]
    assert [device["name"] for device in found] == [device.name for device in clvox.devices()]
    assert [device["number"] for device in found] == list(range(len(found)))
    assert main(["devices"]) == 0
    assert found[0]["name"] in capsys.readouterr().out


def test_info_of_a_closed_mesh(ball: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", str(ball), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    mesh = trimesh.creation.icosphere(radius=10.0)
    assert found["triangles"] == len(mesh.faces)
    assert found["vertices"] == len(mesh.vertices)
    assert found["closed"]
    assert found["oriented"]
    assert found["volume"] == pytest.approx(mesh.volume, rel=1e-6)
    assert found["grid"]["shape"] == [256, 256, 256]
    assert main(["info", str(ball), "--pitch", "1"]) == 0
    assert "20 x 20 x 20 voxels of 1 with --pitch 1" in capsys.readouterr().out


def test_info_of_a_mesh_far_away(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """About the origin its volume would drown in rounding."""
    path = tmp_path / "far.ply"
    box = trimesh.creation.box((1.0, 2.0, 3.0))
    trimesh.Trimesh(box.vertices + 2.0**20, box.faces, process=False).export(path)
    assert main(["info", str(path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["volume"] == pytest.approx(6.0, rel=1e-9)


def test_info_of_an_open_mesh_is_no_error(
    open_ball: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["info", str(open_ball)]) == 0
    said = capsys.readouterr()
    assert "open: 3 edges with an odd number of triangles" in said.out
    assert "the mesh is open" in said.err
    assert main(["info", str(open_ball), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["closed"], found["volume"], found["odd_edges"]) == (False, None, 3)


def test_voxelize_tells_what_the_library_tells(
    ball: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "ball.npz"
    command = ["voxelize", str(ball), "-r", "40", "-o", str(output), "--json", "--volume-bounds"]
    assert main(command) == 0
    said = capsys.readouterr()
    found = json.loads(said.out)
    assert said.err == ""
    model = clvox.voxelize(ball, resolution=40)
    assert found["count"] == model.count
    assert found["volume"] == model.volume
    assert found["volume_bounds"] == list(model.volume_bounds)
    assert found["levels"] == [list(level) for level in model.levels]
    assert found["grid"]["shape"] == [40, 40, 40]
    assert found["report"]["triangles"] == 1280
    assert {"load", "check", "voxelize", "write"} <= set(found["seconds"])
    assert found["files"] == [{"path": str(output), "nbytes": output.stat().st_size}]
    assert clvox.open(output) == model


def test_voxelize_speaks_to_people(ball: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["voxelize", str(ball), "--pitch", "0.5", "--levels", "10,10,10", "4,4,4"]) == 0
    said = capsys.readouterr().out
    assert "40 x 40 x 40 voxels of 0.5" in said
    assert "10 x 10 x 10 cells of 4 x 4 x 4 voxels" in said
    assert re.search(r"^inside +[\d,]+ voxels$", said, re.MULTILINE)
    assert re.search(r"^seconds +load .* in all$", said, re.MULTILINE)


def test_warnings_go_to_the_standard_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """And stay out of what a program reads."""
    path = tmp_path / "mixed.ply"
    box = trimesh.creation.box()
    faces = box.faces.copy()
    faces[0] = faces[0, ::-1]
    trimesh.Trimesh(box.vertices, faces, process=False).export(path)
    assert main(["voxelize", str(path), "-r", "8", "--json"]) == 0
    said = capsys.readouterr()
    warnings = json.loads(said.out)["warnings"]
    assert len(warnings) == 1
    assert said.err == f"clvox: warning: {warnings[0]}\n"


def test_bars_are_for_terminals(ball: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Elsewhere nothing is drawn; nor with --quiet."""
    assert main(["mesh", str(ball), "-r", "16", "-o", str(ball.with_suffix(".ply"))]) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("quiet", [False, True])
def test_bars_on_a_terminal(
    ball: Path,
    quiet: bool,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    assert main(["voxelize", str(ball), "-r", "16", *["--quiet"] * quiet]) == 0
    assert ("voxelize" in capsys.readouterr().err) is not quiet


@pytest.mark.parametrize(
    ("count", "words"), [(0, "0 bytes"), (999, "999 bytes"), (1234, "1.2 kB"), (5e12, "5000.0 GB")]
)
def test_bytes_in_words(count: float, words: str) -> None:
    assert bytes_in_words(count) == words


# What is written


@pytest.mark.parametrize("suffix", [".ply", ".stl", ".obj", ".PLY"])
def test_mesh_comes_back_closed(ball: Path, tmp_path: Path, suffix: str) -> None:
    output = tmp_path / "out" / f"again{suffix}"
    output.parent.mkdir()
    assert main(["mesh", str(ball), "-r", "32", "-o", str(output)]) == 0
    assert only_file(output.parent) == output.name
    found = clvox.load(output)
    found.merge_vertices()
    assert found.is_watertight
    expected = clvox.voxelize(ball, resolution=32).to_mesh()
    assert found.volume == pytest.approx(expected.volume, rel=1e-5)


def test_saved_models_are_read(
    ball: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    voxels, surface, picture = (tmp_path / f"a{suffix}" for suffix in (".npz", ".ply", ".png"))
    assert main(["voxelize", str(ball), "-r", "24", "-o", str(voxels)]) == 0
    assert main(["mesh", str(voxels), "-o", str(surface)]) == 0
    assert main(["render", str(voxels), "-o", str(picture), "--size", "64x48"]) == 0
    said = capsys.readouterr().out
    assert str(picture) in said
    with Image.open(picture) as image:
        assert image.size == (64, 48)
        np.testing.assert_array_equal(
            np.asarray(image), clvox.render(clvox.open(voxels), size=(64, 48))
        )
    style = ["--style", "volume", "--size", "40x30"]
    assert main(["render", str(ball), "-r", "24", "-o", str(picture), *style]) == 0
    with Image.open(picture) as image:
        assert np.ptp(np.asarray(image)[..., 3]) > 100


def test_pictures_are_cut_and_coloured(ball: Path, tmp_path: Path) -> None:
    """By a plane through the middle or through a point; and body by body."""
    pictures = []
    for options in ([], ["--cut", "0,-1,0"], ["--cut=0,1,0,0,99,0"], ["--colours", "bodies"]):
        target = str(tmp_path / "a.png")
        assert (
            main(["render", str(ball), "-r", "24", "-o", target, "--size", "64x48", *options]) == 0
        )
        with Image.open(target) as image:
            pictures.append(np.asarray(image).astype(int))
    whole, half, beyond, coloured = pictures
    orange = half[..., 0] > half[..., 2] + 20
    assert orange.mean() > 0.05
    assert not (whole[..., 0] > whole[..., 2] + 20).any()
    np.testing.assert_array_equal(beyond, whole)
    assert (coloured[..., 3] > 0).any()


@pytest.mark.parametrize(
    ("words", "cut"),
    [
        (["--cut", "-1,0,0"], (-1, 0, 0)),
        (["--cut", "-.5,0,-2,-3,4,5"], (-0.5, 0, -2, -3, 4, 5)),
        (["--cut=-1,0,0"], (-1, 0, 0)),
        (["--cut", "1,-1,0"], (1, -1, 0)),
    ],
)
def test_a_cut_may_begin_with_a_minus_sign(words: list[str], cut: tuple[float, ...]) -> None:
    for order in (["a.stl", *words], [*words, "a.stl"], [*words, "--", "a.stl"]):
        options = parse(["render", "-r", "8", "-o", "a.png", *order])
        assert options.cut == cut
        assert options.file == "a.stl"


def test_demo(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """From the part in the package to a picture, voxels and a mesh of the same volume."""
    folder = tmp_path / "made" / "here"
    assert main(["demo", "--out", str(folder), "--resolution", "64"]) == 0
    said = capsys.readouterr()
    assert sorted(path.name for path in folder.iterdir()) == [
        "bracket.npz",
        "bracket.ply",
        "bracket.png",
    ]
    assert all(str(path) in said.out for path in folder.iterdir())
    model = clvox.open(folder / "bracket.npz")
    assert max(model.grid.shape) == 64
    assert model.device in said.out
    surface = clvox.load(folder / "bracket.ply")
    assert surface.is_watertight
    assert surface.volume == pytest.approx(model.volume, rel=0.02)
    with Image.open(folder / "bracket.png") as image:
        colours = np.asarray(image)
    assert colours.shape == (1000, 1600, 4)
    assert 0.15 < (colours[..., :3] != 255).any(axis=2).mean() < 0.7
    assert said.err == ""


def test_demo_for_programs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["demo", "--out", str(tmp_path), "-r", "32", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [Path(made["path"]).suffix for made in found["files"]] == [".png", ".npz", ".ply"]
    assert found["volume"] == pytest.approx(found["input_volume"], rel=0.1)


# How it fails


def fails(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> str:
    """The one sentence that is said on the way to status 1."""
    assert main([str(argument) for argument in arguments]) == 1
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith("clvox: error: ")
    assert said.err.count("\n") == 1
    return said.err.removeprefix("clvox: error: ").rstrip("\n")


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["paint"],
        ["info"],
        ["mesh", "a.stl", "-r", "8"],
        ["voxelize", "a.stl"],
        ["voxelize", "a.stl", "-r", "many"],
        ["voxelize", "a.stl", "-r", "8", "--pitch", "1"],
        ["voxelize", "a.stl", "--levels", "8,8"],
        ["voxelize", "a.npz", "-r", "8"],
        ["render", "a.npz", "-r", "8", "-o", "a.png"],
        ["render", "a.stl", "-r", "8", "-o", "a.png", "--size", "big"],
        ["render", "a.stl", "-r", "8", "-o", "a.png", "--size", "0x8"],
        ["render", "a.stl", "-r", "8", "-o", "a.png", "--size", "8x16385"],
        ["render", "a.stl", "-r", "8", "-o", "a.png", "--cut", "1,2"],
        ["render", "a.stl", "-r", "8", "-o", "a.png", "--cut", "0,0,0"],
        ["render", "a.stl", "-r", "8", "-o", "a.png", "--cut", "1,2,nan"],
        ["render", "a.stl", "-r", "8", "-o", "a.png", "--colours", "bodies", "--style", "volume"],
        ["render", "a.stl", "-r", "8", "-o", "a.png", "--cut", "-r", "8"],
        ["render", "a.stl", "-r", "8", "-o", "a.png", "--colours", "faces"],
    ],
)
def test_wrong_arguments_are_status_2(
    arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as end:
        main(arguments)
    assert end.value.code == 2
    assert "usage: clvox" in capsys.readouterr().err


def test_absent_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = fails(capsys, "info", tmp_path / "none.stl")
    assert said == f"{tmp_path / 'none.stl'}: No such file or directory"


def test_open_mesh(open_ball: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "the mesh is open: 3 edges" in fails(capsys, "voxelize", open_ball, "-r", "8", "--json")


def test_wrong_numbers(ball: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "resolution must be between 1" in fails(capsys, "voxelize", ball, "-r", "0")
    assert fails(capsys, "voxelize", ball, "--pitch", "-1") == "pitch must be positive, got -1.0"
    assert "levels" in fails(capsys, "voxelize", ball, "-r", "8", "--levels", "2,2,2", "3,3,3")


def test_absent_device(ball: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = fails(capsys, "voxelize", ball, "-r", "8", "--device", "abacus")
    assert said.startswith("no OpenCL device matches 'abacus'; devices here: 0: ")


def test_devices_are_chosen_by_number_and_kind(
    ball: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for number, device in enumerate(clvox.devices()):
        for choice in (str(number), device.name):
            assert main(["voxelize", str(ball), "-r", "8", "--device", choice, "--json"]) == 0
            assert json.loads(capsys.readouterr().out)["report"]["device"] == str(device)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("zero.stl", b"", "zero.stl"),
        ("short.stl", b"\0" * 80 + b"\x05\0\0\0" + b"\0" * 60, "5 triangles"),
        ("noise.ply", bytes(range(256)) * 8, "noise.ply"),
        ("text.obj", b"once upon a time\n", "text.obj"),
        ("index.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "9"),
        ("nan.obj", b"v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "finite"),
        ("flat.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 3 2 1\n", "extent"),
        ("drawing.dwg", b"", ".dwg"),
    ],
)
def test_hostile_files(
    tmp_path: Path, name: str, content: bytes, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / name).write_bytes(content)
    assert message in fails(capsys, "info", tmp_path / name)
    assert message in fails(capsys, "voxelize", tmp_path / name, "-r", "8")


@pytest.mark.parametrize(
    "content", [b"", b"not a model", b"PK\x05\x06" + b"\0" * 18, b"\x93NUMPY\1\0"]
)
def test_hostile_models(tmp_path: Path, content: bytes, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "a.npz"
    path.write_bytes(content)
    assert "model" in fails(capsys, "mesh", path, "-o", tmp_path / "a.ply")


@pytest.mark.parametrize(
    ("text", "count"), [("700000", 700_000), ("700k", 700_000), ("0.7M", 700_000), ("1g", 10**9)]
)
def test_memory_budget(ball: Path, text: str, count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is written is what the library is given."""
    given = []
    voxelize = clvox.voxelize

    def note(*arguments: Any, memory_budget: int | None, **options: Any) -> Any:
        given.append(memory_budget)
        return voxelize(*arguments, memory_budget=memory_budget, **options)

    monkeypatch.setattr(clvox, "voxelize", note)
    assert main(["voxelize", str(ball), "-r", "16", "--memory-budget", text]) == 0
    assert given == [count]


@pytest.mark.parametrize("text", ["", "much", "1.5x", "M", "inf", "nan"])
def test_memory_budgets_that_are_none(
    ball: Path, text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main(["voxelize", str(ball), "-r", "16", "--memory-budget", text])
    assert "bytes such as 500000, 200M or 1.5G are expected" in capsys.readouterr().err


def test_too_small_a_memory_budget(ball: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = fails(capsys, "voxelize", ball, "-r", "512", "--memory-budget", "100k")
    assert "512 x 512 x 512 voxels need" in said
    assert "would fit" in said
    assert "positive" in fails(capsys, "voxelize", ball, "-r", "16", "--memory-budget", "-1")


def test_outputs_are_looked_at_first(
    ball: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Before anything takes long; and nothing is left behind."""
    monkeypatch.setattr(clvox, "load", lambda _: pytest.fail("the mesh was read"))
    mesh = "mesh", ball, "-r", "8", "-o"
    voxelize = "voxelize", ball, "-r", "8", "-o"
    folder = tmp_path / "folder.ply"
    folder.mkdir()
    assert "the suffix must be .ply or .stl or .obj, got .off" in fails(capsys, *mesh, "a.off")
    assert "the suffix must be .npz, got none" in fails(capsys, *voxelize, tmp_path / "a")
    absent = tmp_path / "nowhere"
    assert fails(capsys, *mesh, absent / "a.ply") == f"{absent}: there is no such folder"
    assert fails(capsys, *mesh, folder) == f"{folder}: is a folder; a file is expected"
    assert "is the file that is read" in fails(capsys, *mesh, ball)
    assert "No such file" not in fails(capsys, "demo", "--out", ball)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["ball.stl", "folder.ply"]
    assert not list(folder.iterdir())


def test_unwritable_folder(
    ball: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever the reason: permissions do not bind every user that runs this test."""

    def refuse(path: Path, *_: object, **__: object) -> NoReturn:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(Path, "touch", refuse)
    said = fails(capsys, "voxelize", ball, "-r", "8", "-o", ball.parent / "a.npz")
    assert said.endswith("Permission denied")


def test_full_disk_leaves_the_old_file(
    ball: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The new one is written beside it first."""
    output = ball.parent / "out" / "a.ply"
    output.parent.mkdir()
    output.write_text("old")

    def fill(_: trimesh.Trimesh, file: Any, **__: object) -> NoReturn:
        file.write(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(trimesh.Trimesh, "export", fill)
    assert main(["mesh", str(ball), "-r", "8", "-o", str(output)]) == 1
    assert capsys.readouterr().err == "clvox: error: No space left on device\n"
    assert only_file(output.parent) == "a.ply"
    assert output.read_text() == "old"


def test_nothing_inside_makes_no_mesh(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = clvox.VoxelModel.from_array(
        np.zeros((4, 4, 4), bool), clvox.Grid((0, 0, 0), 1.0, (4, 4, 4))
    )
    model.save(tmp_path / "a.npz")
    assert main(["mesh", str(tmp_path / "a.npz"), "-o", str(tmp_path / "a.ply")]) == 1
    assert "no voxel is inside" in capsys.readouterr().err
    assert only_file(tmp_path) == "a.npz"


def test_traceback_only_with_debug(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", str(tmp_path / "none.stl"), "--debug"]) == 1
    said = capsys.readouterr().err
    assert said.startswith("Traceback")
    assert said.splitlines()[-1].startswith("clvox: error: ")


def test_no_room_on_the_computer(
    ball: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> NoReturn:
        raise MemoryError("Unable to allocate 9 TiB")

    monkeypatch.setattr(clvox, "voxelize", refuse)
    assert "no room for the work: Unable to allocate" in fails(capsys, "voxelize", ball, "-r", "8")


@pytest.fixture
def listening() -> Generator[None, None, None]:
    """SIGINT interrupts, although a shell has jobs in the background ignore it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such signal")
@pytest.mark.usefixtures("listening")
@pytest.mark.parametrize("where", ["voxelize", "write"])
def test_ctrl_c(
    ball: Path, where: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the midst of the work, and half-way through writing: status 130 and no remains."""
    output = ball.parent / "out" / "a.npz"
    output.parent.mkdir()

    def interrupt(*_: object, **__: object) -> None:
        os.kill(os.getpid(), signal.SIGINT)

    if where == "voxelize":
        monkeypatch.setattr("clvox.ops.crossings.flip_bricks", interrupt)
    else:
        monkeypatch.setattr(np, "savez_compressed", interrupt)
    assert main(["voxelize", str(ball), "-r", "16", "-o", str(output)]) == 130
    assert capsys.readouterr().err == "clvox: interrupted\n"
    assert list(output.parent.iterdir()) == []


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such signal")
def test_ctrl_c_in_a_process_of_its_own(ball: Path, shell: Shell) -> None:
    """The interpreter, too, leaves without a word."""
    script = (
        "import os, signal, sys\nimport clvox.models.construct as construct\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "from clvox.cli import main\n"
        "construct.rank_cells = lambda *_: os.kill(os.getpid(), signal.SIGINT)\n"
        f"sys.exit(main(['voxelize', {str(ball)!r}, '-r', '64', '-o', 'a.npz']))\n"
    )
    done = shell("-c", script)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "clvox: interrupted\n")
    assert sorted(path.name for path in ball.parent.iterdir()) == ["ball.stl"]


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such pipes")
def test_reader_who_leaves_early(ball: Path, shell: Shell) -> None:
    """As in `clvox info part.stl | head -0`: no traceback."""
    script = (
        "import os, subprocess, sys\n"
        "reading, writing = os.pipe()\nos.close(reading)\n"
        f"command = [sys.executable, '-m', 'clvox', 'info', {str(ball)!r}]\n"
        "done = subprocess.run(command, stdout=writing, stderr=subprocess.PIPE, text=True)\n"
        "print(done.returncode, repr(done.stderr))\n"
    )
    assert shell("-c", script).stdout == "1 ''\n"
