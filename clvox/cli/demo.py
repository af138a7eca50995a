"""The demo: a part comes with clvox, and becomes voxels, a picture, and a mesh again."""

from __future__ import annotations

import argparse
from importlib.resources import as_file, files
from pathlib import Path

import clvox
from clvox.cli import commands
from clvox.cli.console import Console
from clvox.cli.files import MESHES, MODELS, PICTURES, writable

PART = "nist_bracket_plate_pmi1_5k.stl"
NAME = "bracket"
SIZE = 1600, 1000
PAPER = 255, 255, 255


def demo(options: argparse.Namespace, console: Console) -> None:
    """Make voxels, a picture and a mesh of the part, and compare their volumes."""
    folder = Path(options.out)
    folder.mkdir(parents=True, exist_ok=True)
    picture = writable(folder / f"{NAME}.png", PICTURES)
    voxels = writable(folder / f"{NAME}.npz", MODELS)
    surface = writable(folder / f"{NAME}.ply", MESHES)

    with as_file(files("clvox") / "demo" / PART) as path:
        given = commands.volume_of(clvox.load(path))
        model = commands.model_of(str(path), options, console, attributes=("normals",))
    console.record["file"] = PART
    with console.stage("render"):
        image = clvox.render(model, size=SIZE, background=PAPER)
    made = commands.mesh_of(model, console)
    with console.stage("write"):
        commands.write_picture(image, picture)
        model.save(voxels)
        commands.write_mesh(made, surface)

    again = commands.volume_of(made)
    console.record["input_volume"] = given
    console.say(
        "volumes",
        f"{given:.8g} the part, {model.volume:.8g} the voxels ({_off(model.volume, given)}), "
        f"{again:.8g} the mesh ({_off(again, given)})",
    )
    commands.tell_file(picture, "the picture", console)
    commands.tell_file(voxels, "the voxels", console)
    commands.tell_file(surface, "the mesh", console)


def _off(volume: float, given: float) -> str:
    return f"{100 * (volume / given - 1):+.3f} %"
