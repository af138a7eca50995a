"""The commands, but for the demo."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

import clvox
from clvox._files import whole
from clvox.cli import files
from clvox.cli.arguments import INFO_RESOLUTION
from clvox.cli.console import Console

if TYPE_CHECKING:
    import trimesh

    from clvox.mesh import Surface
    from clvox.models.attributes import Attribute

Command: TypeAlias = Callable[[argparse.Namespace, Console], None]


def devices(_: argparse.Namespace, console: Console) -> None:
    """List the devices, in the order of their numbers."""
    found = clvox.devices()
    for number, device in enumerate(found):
        memory = files.bytes_in_words(device.memory)
        details = f"{device.kind}, {device.units} units, {memory}, {device.version}"
        console.say(f"{number}", f"{device}  ({details})")
    names = "name", "platform", "version", "kind", "memory", "largest_allocation", "units"
    console.record["devices"] = [
        {"number": number} | {name: getattr(device, name) for name in names}
        for number, device in enumerate(found)
    ]


def doctor(_: argparse.Namespace, console: Console) -> None:
    """Tell what is wrong with drivers and devices, each thing as it is found."""
    # Not at the top: `info` needs no device, and does not wait for pyopencl.
    from clvox.doctor import examining, exit_status

    findings = []
    for finding in examining():
        findings.append(finding)
        mark = "FAILED: " if finding.failed else ""
        console.say(finding.topic, f"{finding.subject}: {mark}{finding.text}")
    console.record["findings"] = [asdict(finding) for finding in findings]
    console.status = exit_status(findings)


def info(options: argparse.Namespace, console: Console) -> None:
    """Tell what a mesh is like; an open one is no error here."""
    mesh = load_mesh(options.file, console)
    surface = check_mesh(mesh, console)
    resolution = options.resolution
    if options.pitch is None and resolution is None:
        resolution = INFO_RESOLUTION
    grid = clvox.Grid.fit(surface, resolution=resolution, pitch=options.pitch)
    low, high = surface.bounds.tolist()
    extent = (surface.bounds[1] - surface.bounds[0]).tolist()
    volume = volume_of(surface) if surface.oriented else None
    console.record |= {
        "file": options.file,
        "triangles": len(surface.faces),
        "vertices": len(surface.vertices),
        "bodies": bodies_of(mesh),
        "units": mesh.units,
        "bounds": [low, high],
        "extent": extent,
        "closed": surface.closed,
        "oriented": surface.oriented,
        "volume": volume,
        "odd_edges": len(surface.odd_edges),
        "uneven_edges": len(surface.uneven_edges),
        "repeated": surface.repeated,
        "duplicates": surface.duplicates,
        "cancelled": surface.cancelled,
        "welded_by": surface.welded_by,
        "grid": grid_record(grid),
    }
    console.say("file", options.file)
    console.say("triangles", f"{len(surface.faces):,}")
    console.say("vertices", f"{len(surface.vertices):,}")
    if "body" in mesh.face_attributes:
        console.say("bodies", f"{bodies_of(mesh):,}")
    if mesh.units is not None:
        console.say("unit", mesh.units)
    console.say("bounds", f"{_point(low)} to {_point(high)}")
    console.say("extent", _point(extent))
    odd, uneven = len(surface.odd_edges), len(surface.uneven_edges)
    console.say(
        "closed",
        "yes" if surface.closed else f"open: {odd:,} edges with an odd number of triangles",
    )
    console.say(
        "oriented",
        "yes" if surface.oriented else f"no: {uneven:,} edges used more often one way",
    )
    console.say("volume", "unknown" if volume is None else f"{volume:.8g}")
    dropped = surface.repeated + surface.duplicates + surface.cancelled
    if dropped:
        console.say(
            "dropped",
            f"{dropped:,} triangles: {surface.repeated:,} with a repeated vertex, "
            f"{surface.duplicates:,} copies, {surface.cancelled:,} back to back",
        )
    if surface.welded_by:
        console.say("welded by", f"{surface.welded_by:.3g}")
    given = f"--pitch {options.pitch:g}" if resolution is None else f"-r {resolution}"
    console.say("grid", f"{grid_in_words(grid)} with {given}")
    console.warn(surface.warnings)


def voxelize(options: argparse.Namespace, console: Console) -> None:
    """Make voxels of a mesh, and write them if that is asked for."""
    target = options.output and files.writable(options.output, files.MODELS, options.file)
    model = model_of(options.file, options, console)
    if options.volume_bounds:
        with console.stage("volume bounds"):
            low, high = model.volume_bounds
        console.record["volume_bounds"] = [low, high]
        console.say("bounds", f"{low:.8g} to {high:.8g}")
    if target:
        with console.stage("write"):
            model.save(target)
        tell_file(target, "the voxels", console)


def mesh(options: argparse.Namespace, console: Console) -> None:
    """Make a mesh of voxels."""
    target = files.writable(options.output, files.MESHES, options.file)
    model = model_of(options.file, options, console)
    made = mesh_of(model, console)
    with console.stage("write"):
        write_mesh(made, target)
    tell_file(target, "the mesh", console)


def render(options: argparse.Namespace, console: Console) -> None:
    """Make a picture of voxels."""
    target = files.writable(options.output, files.PICTURES, options.file)
    wanted: list[Attribute] = ["normals"] if options.colours is None else ["normals", "links"]
    model = model_of(options.file, options, console, attributes=wanted)
    with console.stage("render"):
        columns, rows = options.size
        camera = clvox.Camera.around(model, aspect=columns / rows)
        if options.cut is not None:
            point = options.cut[3:] or tuple(model.bounds.mean(axis=0).tolist())
            camera = replace(camera, cut=(point, options.cut[:3]))
        image = clvox.render(
            model, camera=camera, size=options.size, style=options.style, colours=options.colours
        )
    with console.stage("write"):
        write_picture(image, target)
    tell_file(target, "the picture", console)


COMMANDS: Mapping[str, Command] = {
    "devices": devices,
    "doctor": doctor,
    "info": info,
    "voxelize": voxelize,
    "mesh": mesh,
    "render": render,
}


# What commands and the demo share


def model_of(
    file: str,
    options: argparse.Namespace,
    console: Console,
    *,
    attributes: Sequence[Attribute] = (),
) -> clvox.VoxelModel:
    """Return the model of a mesh, or that in a `.npz` file, and tell about it."""
    if file.endswith(".npz"):
        with console.stage("open"):
            model = clvox.open(file, device=options.device)
        if not isinstance(model, clvox.VoxelModel):
            raise clvox.FormatError(f"{file} holds dexels; voxels are expected here")
    else:
        loaded = load_mesh(file, console)
        check_mesh(loaded, console)
        with console.stage("voxelize"), console.bar("voxelize") as progress:
            model = clvox.voxelize(
                loaded,
                resolution=options.resolution,
                pitch=getattr(options, "pitch", None),
                levels=getattr(options, "levels", None),
                fill=getattr(options, "fill", "parity"),
                attributes=attributes,
                device=options.device,
                memory_budget=getattr(options, "memory_budget", None),
                progress=progress,
            )
    grid, report = model.grid, model.report
    console.record |= {
        "file": file,
        "grid": grid_record(grid),
        "levels": [list(level) for level in model.levels],
        "count": model.count,
        "volume": model.volume,
        "nbytes": model.nbytes,
        "report": asdict(report),
    }
    console.say("file", file)
    if report.triangles:
        console.say("triangles", f"{report.triangles:,}")
    console.say("device", report.device)
    console.say("grid", grid_in_words(grid))
    console.say("levels", " cells of ".join(_shape(level) for level in model.levels) + " voxels")
    console.say("inside", f"{model.count:,} voxels")
    console.say("volume", f"{model.volume:.8g}")
    console.say("memory", f"{files.bytes_in_words(model.nbytes)} on the device")
    if report.seconds:
        stages = ", ".join(f"{name} {spent:.3f}" for name, spent in report.seconds.items())
        console.say("on device", f"seconds: {stages}")
    console.warn(report.warnings)
    return model


def bodies_of(mesh: trimesh.Trimesh) -> int | None:
    """Return how many bodies the file says there are; None if its format has none."""
    bodies = mesh.face_attributes.get("body")
    return None if bodies is None else len(np.unique(np.asarray(bodies)))


def mesh_of(model: clvox.VoxelModel, console: Console) -> trimesh.Trimesh:
    """Return the mesh of a model, and tell about it."""
    with console.stage("mesh"), console.bar("mesh") as progress:
        made = model.to_mesh(progress=progress)
    if len(made.faces) == 0:
        raise clvox.MeshError("no voxel is inside, so there is no surface; use finer voxels")
    volume = volume_of(made)
    console.record["mesh"] = {
        "triangles": len(made.faces),
        "vertices": len(made.vertices),
        "volume": volume,
    }
    console.say(
        "mesh",
        f"{len(made.faces):,} triangles, {len(made.vertices):,} vertices, volume {volume:.8g}",
    )
    return made


def write_mesh(made: trimesh.Trimesh, target: Path) -> None:
    """Write a mesh in the format that the suffix names."""
    with whole(target) as partial, partial.open("wb") as file:
        made.export(file, file_type=target.suffix[1:].lower())


def write_picture(image: np.ndarray[Any, np.dtype[np.uint8]], target: Path) -> None:
    """Write a picture, (h, w, 4), as PNG."""
    from PIL import Image

    with whole(target) as partial, partial.open("wb") as file:
        Image.fromarray(image).save(file, format="png")


def tell_file(path: Path, what: str, console: Console) -> None:
    """Name a file that was made."""
    console.record.setdefault("files", []).append(
        {"path": str(path), "nbytes": path.stat().st_size}
    )
    console.say("made", f"{path}  ({what}, {files.size_of(path)})")


def volume_of(surface: Surface | trimesh.Trimesh) -> float:
    """Return the signed volume of a closed and oriented surface."""
    # About the middle: far from the origin the volume would drown in rounding.
    corners = surface.vertices - surface.bounds.mean(axis=0)
    a, b, c = (corners[surface.faces[:, corner]] for corner in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def grid_record(grid: clvox.Grid) -> dict[str, Any]:
    """Return a grid as JSON knows it."""
    return {name: list(getattr(grid, name)) for name in ("origin", "spacing", "shape")}


def grid_in_words(grid: clvox.Grid) -> str:
    """Return a grid, for a person."""
    spacing = grid.spacing
    width = f"{spacing[0]:.6g}" if len(set(spacing)) == 1 else _point(spacing)
    return f"{_shape(grid.shape)} voxels of {width}"


def load_mesh(file: str, console: Console) -> trimesh.Trimesh:
    """Return the mesh of a file."""
    # Before the clock starts: what takes long in a small file is loading trimesh.
    from clvox.mesh import load

    with console.stage("load"):
        return load(file)


def check_mesh(mesh: trimesh.Trimesh, console: Console) -> Surface:
    """Return the mesh checked."""
    from clvox.mesh import check

    with console.stage("check"):
        return check(mesh)


def _point(values: list[float] | tuple[float, ...]) -> str:
    return f"({', '.join(f'{value:.6g}' for value in values)})"


def _shape(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, shape))
