"""The command `clvox dexelize`."""

from __future__ import annotations

import argparse
from dataclasses import asdict

import numpy as np
from numpy.typing import NDArray

import clvox
from clvox.cli import files
from clvox.cli.commands import (
    check_mesh,
    grid_in_words,
    grid_record,
    load_mesh,
    tell_file,
    write_picture,
)
from clvox.cli.console import Console


def dexelize(options: argparse.Namespace, console: Console) -> None:
    """Make dexels of a mesh, and write them, and a picture, if that is asked for."""
    target = options.output and files.writable(options.output, files.MODELS, options.file)
    image = options.thickness and files.writable(options.thickness, files.PICTURES, options.file)
    loaded = load_mesh(options.file, console)
    check_mesh(loaded, console)
    with console.stage("dexelize"), console.bar("dexelize") as progress:
        model = clvox.dexelize(
            loaded,
            resolution=options.resolution,
            pitch=options.pitch,
            axis=options.axis,
            fill=options.fill,
            device=options.device,
            memory_budget=options.memory_budget,
            progress=progress,
        )
    _tell(options.file, model, console)
    if target:
        with console.stage("write"):
            model.save(target)
        tell_file(target, "the dexels", console)
    if image:
        with console.stage("thickness"):
            write_picture(thickness_picture(model.thickness()), image)
        tell_file(image, "the thickness along the rays", console)


def thickness_picture(thickness: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return thicknesses as grey values, (h, w, 4) uint8; the later axis points upwards."""
    most = float(thickness.max())
    grey = np.rint(thickness[::-1] * (255 / most if most > 0 else 0)).astype(np.uint8)
    picture = np.repeat(grey[..., None], 4, axis=2)
    picture[..., 3] = 255
    return picture


def _tell(file: str, model: clvox.DexelModel | clvox.TripleDexelModel, console: Console) -> None:
    bundles = model.bundles if isinstance(model, clvox.TripleDexelModel) else (model,)
    reports = {bundle.axis: bundle.report for bundle in bundles}
    console.record |= {
        "file": file,
        "grid": grid_record(model.grid),
        "volume": model.volume,
        "nbytes": model.nbytes,
        "reports": {axis: asdict(report) for axis, report in reports.items()},
    }
    first = bundles[0].report
    console.say("file", file)
    console.say("triangles", f"{first.triangles:,}")
    console.say("device", first.device)
    console.say("grid", grid_in_words(model.grid))
    for bundle in bundles:
        report = bundle.report
        rows, along = bundle.rays_shape
        seconds = sum(report.seconds.values())
        console.say(
            f"along {bundle.axis}",
            f"{along:,} x {rows:,} rays, {report.crossings:,} crossings, at most "
            f"{report.deepest:,} on a ray; thinnest piece {report.thinnest:.6g}; {seconds:.3f} s",
        )
    console.say("volume", f"{model.volume:.8g}")
    console.say("memory", f"{files.bytes_in_words(model.nbytes)} on the device")
    console.warn(first.warnings)
