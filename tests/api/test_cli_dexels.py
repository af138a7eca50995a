"""`clvox dexelize`: what it prints, and what it writes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

import clvox
from clvox.cli import main


@pytest.fixture
def torus(tmp_path: Path) -> Path:
    path = tmp_path / "torus.stl"
    trimesh.creation.torus(7.0, 3.0).export(path)
    return path


def test_one_axis(torus: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, image = tmp_path / "dexels.npz", tmp_path / "thickness.png"
    written = ["-o", str(out), "--thickness", str(image)]
    assert main(["dexelize", str(torus), "--pitch", "0.5", "--axis", "y", *written, "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    model = clvox.dexelize(clvox.load(torus), pitch=0.5, axis="y")
    assert record["volume"] == model.volume
    assert record["grid"]["shape"] == list(model.grid.shape)
    assert record["reports"]["y"]["crossings"] == len(model.depths)
    assert clvox.open(out) == model
    with Image.open(image) as picture:
        grey = np.asarray(picture)[::-1, :, 0]
    assert grey.shape == model.rays_shape
    thickness = model.thickness()
    np.testing.assert_allclose(grey, thickness / thickness.max() * 255, atol=0.5001)


def test_three_axes(torus: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "dexels.npz"
    arguments = ["-r", "24", "--axis", "xyz", "--fill", "nonzero", "-o", str(out), "--quiet"]
    assert main(["dexelize", str(torus), *arguments]) == 0
    said = capsys.readouterr().out
    for axis in "xyz":
        assert f"along {axis} " in said
    model = clvox.dexelize(clvox.load(torus), resolution=24, axis="xyz", fill="nonzero")
    assert clvox.open(out) == model


def test_memory_budget(torus: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["dexelize", str(torus), "-r", "24", "--quiet", "--memory-budget"]
    assert main([*command, "200M"]) == 0
    capsys.readouterr()
    assert main([*command, "10k"]) == 1
    assert "memory" in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["-r", "8", "--pitch", "1"],
        ["-r", "8", "--axis", "w"],
        ["-r", "8", "--fill", "surface"],
        ["-r", "8", "--axis", "xyz", "--thickness", "out.png"],
    ],
)
def test_wrong_arguments_are_status_2(torus: Path, arguments: list[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main(["dexelize", str(torus), *arguments])
    assert end.value.code == 2


def test_files_are_looked_at_first(
    torus: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for option, name in (("-o", "out.png"), ("--thickness", "out.npz"), ("-o", "no/out.npz")):
        command = ["dexelize", str(torus), "-r", "8", option, str(tmp_path / name)]
        assert main(command) == 1
        said = capsys.readouterr()
        assert said.out == ""
        assert "the suffix must be" in said.err or "no such folder" in said.err


def test_dexels_are_no_voxels(
    torus: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "dexels.npz"
    assert main(["dexelize", str(torus), "-r", "8", "-o", str(out), "--quiet"]) == 0
    assert main(["mesh", str(out), "-o", str(tmp_path / "out.ply")]) == 1
    assert "holds dexels; voxels are expected" in capsys.readouterr().err


def test_nothing_inside_makes_a_black_picture() -> None:
    from clvox.cli.dexelize import thickness_picture

    picture = thickness_picture(np.zeros((3, 5)))
    assert picture.shape == (3, 5, 4)
    assert not picture[..., :3].any()
