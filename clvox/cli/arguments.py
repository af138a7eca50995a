"""What may be asked for on the command line."""

from __future__ import annotations

import argparse
import math
import re
import sys
from collections.abc import Sequence

from clvox._version import __version__

Triple = tuple[int, int, int]

DEMO_RESOLUTION = 512
INFO_RESOLUTION = 256

_SCALES = {"K": 10**3, "M": 10**6, "G": 10**9, "T": 10**12}

_MOST_PIXELS = 16384
"""Along a side of a picture, as `clvox.render` has it."""

_SIGNED = ("--cut",)
"""Options with a list of numbers, the first of which may have a minus sign."""


def parse(argv: Sequence[str] | None) -> argparse.Namespace:
    """Return the options; leave with status 2 and a word on the usage if they make no sense."""
    parser = _parser()
    options = parser.parse_args(_joined(sys.argv[1:] if argv is None else argv))
    if options.command == "dexelize" and options.thickness and options.axis == "xyz":
        parser.error("--thickness is of rays along one axis; --axis xyz has three")
    if options.command == "render" and options.colours and options.style != "surface":
        parser.error(f"--colours is for --style surface, not for {options.style}")
    if options.command in ("voxelize", "mesh", "render"):
        saved = options.file.endswith(".npz")
        asked = [options.resolution, options.pitch, options.levels]
        if saved and options.command == "voxelize":
            parser.error(f"{options.file} is a model already; voxelize takes a mesh")
        if saved and any(value is not None for value in asked):
            parser.error(f"{options.file} has its voxels: -r, --pitch and --levels are for meshes")
        if not saved and all(value is None for value in asked):
            parser.error("one of -r/--resolution, --pitch and --levels is required")
    return options


def _joined(words: Sequence[str]) -> list[str]:
    """Return *words* with ``--cut -1,0,0`` as ``--cut=-1,0,0``.

    argparse takes a word for an option if it begins with a minus sign and is not a single number.
    """
    joined: list[str] = []
    for place, word in enumerate(words):
        if word == "--":
            return joined + list(words[place:])
        if joined and joined[-1] in _SIGNED and re.match(r"-[\d.]", word):
            joined[-1] += "=" + word
        else:
            joined.append(word)
    return joined


def _plane(text: str) -> tuple[float, ...]:
    """The normal of a plane, and a point of it if there is one."""
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) not in (3, 6):
        raise argparse.ArgumentTypeError(f"{text!r} is not three or six numbers with commas")
    if not all(map(math.isfinite, numbers)) or not any(numbers[:3]):
        raise argparse.ArgumentTypeError(f"{text!r}: a normal is not 0,0,0, and numbers are finite")
    return numbers


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="clvox",
        description="Exact multi-level voxel models of closed meshes, on any OpenCL device.",
        epilog="Exit status: 0 all is well, 1 files, mesh or device stand in the way, 2 wrong "
        "arguments, 130 interrupted.",
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"clvox {__version__}")
    verbs = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    common, device, voxels = _common(), _device(), _voxels()

    verbs.add_parser("devices", parents=[common], help="list the OpenCL devices")

    verbs.add_parser(
        "doctor",
        parents=[common],
        help="look at drivers and devices, and try each device",
        epilog="Exit status: 0 all is well, 1 something failed, 3 there is no device.",
    )

    info = verbs.add_parser("info", parents=[common], help="tell what a mesh is like")
    _file(info)
    size = info.add_mutually_exclusive_group()
    _resolution(size)

    voxelize = verbs.add_parser(
        "voxelize", parents=[common, device, voxels], help="make voxels of a closed mesh"
    )
    _file(voxelize)
    _output(voxelize, ".npz", required=False)
    voxelize.add_argument(
        "--volume-bounds",
        action="store_true",
        help="also bound the volume, by the voxels wholly inside and those inside or touched",
    )

    mesh = verbs.add_parser(
        "mesh", parents=[common, device, voxels], help="make voxels, and a mesh of them"
    )
    _file(mesh, model=True)
    _output(mesh, ".ply, .stl or .obj")

    dexelize = verbs.add_parser(
        "dexelize", parents=[common, device], help="make dexels of a closed mesh"
    )
    _file(dexelize)
    size = dexelize.add_mutually_exclusive_group(required=True)
    _resolution(size)
    dexelize.add_argument(
        "--axis",
        choices=("x", "y", "z", "xyz"),
        default="z",
        help="direction of the rays; xyz makes a triple dexel; z if not given",
    )
    dexelize.add_argument(
        "--fill",
        choices=("parity", "nonzero", "positive"),
        default="parity",
        help="what is inside, where bodies overlap above all; parity if not given",
    )
    _memory_budget(dexelize, "Work that needs more is refused")
    _output(dexelize, ".npz", required=False)
    dexelize.add_argument(
        "--thickness",
        metavar="PNG",
        help="draw how much of each ray is inside: white is the most, black is nothing",
    )

    render = verbs.add_parser(
        "render", parents=[common, device, voxels], help="make voxels, and a picture of them"
    )
    _file(render, model=True)
    _output(render, ".png")
    render.add_argument(
        "--size", type=_size, default=(1920, 1080), metavar="WxH", help="pixels; 1920x1080"
    )
    render.add_argument(
        "--style",
        choices=("surface", "voxels", "volume"),
        default="surface",
        help="a lit surface; cubes, coloured by what they are; or how much a ray runs inside",
    )
    render.add_argument(
        "--cut",
        type=_plane,
        metavar="NX,NY,NZ[,X,Y,Z]",
        help="cut away what is on the side to which a plane's normal points: the plane through the "
        "point X,Y,Z, or through the middle",
    )
    render.add_argument(
        "--colours",
        choices=("bodies",),
        help="a colour for each body of the mesh; for the style surface",
    )

    demo = verbs.add_parser(
        "demo", parents=[common, device], help="make voxels, a picture and a mesh of a part"
    )
    demo.add_argument("--out", default="clvox-demo", metavar="DIR", help="clvox-demo by default")
    demo.add_argument(
        "-r",
        "--resolution",
        type=int,
        default=DEMO_RESOLUTION,
        metavar="N",
        help=f"voxels along the longest side; {DEMO_RESOLUTION} by default",
    )
    return parser


def _common() -> argparse.ArgumentParser:
    common = argparse.ArgumentParser(add_help=False)
    group = common.add_argument_group("what is printed")
    group.add_argument("--json", action="store_true", help="the result as JSON, and nothing else")
    group.add_argument("--quiet", action="store_true", help="no progress bars")
    group.add_argument("--debug", action="store_true", help="a traceback with an error")
    return common


def _device() -> argparse.ArgumentParser:
    device = argparse.ArgumentParser(add_help=False)
    device.add_argument(
        "--device",
        metavar="D",
        help="a number of `clvox devices`, gpu, cpu, or a part of a device's name; by default "
        "CLVOX_DEVICE, the first GPU, or the first device",
    )
    return device


def _voxels() -> argparse.ArgumentParser:
    voxels = argparse.ArgumentParser(add_help=False)
    group = voxels.add_argument_group("size of the voxels")
    size = group.add_mutually_exclusive_group()
    _resolution(size)
    group.add_argument(
        "--levels",
        type=_triple,
        nargs="+",
        metavar="X,Y,Z",
        help="cells of the coarse grid and voxels in each of them; a single triple, the grid's "
        "shape, asks for one level",
    )
    voxels.add_argument(
        "--fill",
        choices=("parity", "nonzero", "positive", "vote", "winding", "surface"),
        default="parity",
        help="which voxels are inside, where bodies overlap or a mesh is open; parity if not given",
    )
    _memory_budget(voxels, "With less the work is done piece by piece")
    return voxels


def _memory_budget(parser: argparse.ArgumentParser, less: str) -> None:
    parser.add_argument(
        "--memory-budget",
        type=_bytes,
        metavar="BYTES",
        help="bytes of the device that may be taken at once: 500000, 200M, 1.5G; by default most "
        f"of what it has free. {less}",
    )


def _resolution(group: argparse._ActionsContainer) -> None:
    group.add_argument(
        "-r", "--resolution", type=int, metavar="N", help="voxels along the longest side"
    )
    group.add_argument(
        "--pitch", type=float, metavar="P", help="width of a voxel, in the mesh's unit of length"
    )


def _file(parser: argparse.ArgumentParser, *, model: bool = False) -> None:
    what = "a mesh: STL, OBJ, PLY, OFF, GLB, glTF or 3MF, also compressed (.gz)"
    if model:
        what += "; or a model that `clvox voxelize` wrote (.npz)"
    parser.add_argument("file", metavar="FILE", help=what)


def _output(parser: argparse.ArgumentParser, kinds: str, *, required: bool = True) -> None:
    parser.add_argument(
        "-o", "--output", required=required, metavar="OUT", help=f"the file to write, {kinds}"
    )


def _triple(text: str) -> Triple:
    try:
        x, y, z = map(int, text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"three integers X,Y,Z are expected, got {text}") from None
    return x, y, z


def _bytes(text: str) -> int:
    scale = _SCALES.get(text[-1:].upper(), 1)
    try:
        count = float(text if scale == 1 else text[:-1]) * scale
        return int(count)
    except (ValueError, OverflowError):
        raise argparse.ArgumentTypeError(
            f"bytes such as 500000, 200M or 1.5G are expected, got {text}"
        ) from None


def _size(text: str) -> tuple[int, int]:
    try:
        width, height = map(int, text.split("x"))
    except ValueError:
        raise argparse.ArgumentTypeError(f"WIDTHxHEIGHT is expected, got {text}") from None
    if not 1 <= min(width, height) <= max(width, height) <= _MOST_PIXELS:
        raise argparse.ArgumentTypeError(f"a side has 1 to {_MOST_PIXELS} pixels, got {text}")
    return width, height
