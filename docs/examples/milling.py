"""Mill a part's outline out of its blank: moves, what they take, and pictures.

    python milling.py [part.stl] [--moves 100] [--resolution 80] [--out milling.png]

Without a part it is one of NIST's: from the folder CLVOX_DATA, or the one that comes with clvox.
The blank is the box around the part.  A ball end mill goes over it in lines, level by level, and
never below the part: the tip follows the highest place of the part below the cutter.  Then what is
left is turned ten times by a tenth of a turn, by way of its mesh, and compared with where it began.
"""

from __future__ import annotations

import argparse
import os
import time
from importlib.resources import files
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

import clvox


def default_part() -> Path:
    """A part of NIST's: a larger one, if there is one."""
    larger = Path(os.environ.get("CLVOX_DATA", ""), "parts", "nist_machined_part_pmi2_28k.stl.gz")
    shipped = Path(str(files("clvox") / "demo" / "nist_bracket_plate_pmi1_5k.stl"))
    return larger if larger.is_file() else shipped


def path_over(part: clvox.DexelModel, cutter: clvox.Cutter, moves: int) -> np.ndarray:
    """Lines along x, up and down; the tip stays above all that the cutter could touch."""
    grid = part.grid
    offsets, _, leave = part.intervals()
    low, high = grid.bounds
    counts = np.diff(offsets.astype(np.int64))
    heights = np.full(len(counts), low[2])
    heights[counts > 0] = leave[offsets[1:][counts > 0].astype(np.int64) - 1]
    heights = heights.reshape(part.rays_shape)
    lines = max(2, round(np.sqrt(moves / 4)))
    stops = max(2, moves // lines)
    spacing = (high[1] - low[1]) / (lines - 1)
    points = []
    for number, y in enumerate(np.linspace(low[1], high[1], lines)):
        xs = np.linspace(low[0], high[0], stops)[:: -1 if number % 2 else 1]
        for x in xs:
            ahead = (high[0] - low[0]) / (stops - 1) + cutter.radius
            # At the end of a line the next move goes to the next line.
            beside = cutter.radius + (spacing if x in (xs[0], xs[-1]) else 0.0)
            i, j = np.array([x - ahead, x + ahead]), np.array([y - beside, y + beside])
            i = np.clip((i - low[0]) / grid.spacing[0], 0, grid.shape[0]).astype(int)
            j = np.clip((j - low[1]) / grid.spacing[1], 0, grid.shape[1]).astype(int)
            below = heights[j[0] : j[1] + 1, i[0] : i[1] + 1]
            points.append((x, y, below.max(initial=low[2])))
    return np.array(points)[: moves + 1]


def picture(model: clvox.DexelModel) -> Image.Image:
    """How much of each ray is left, as grey values."""
    thickness = model.thickness()[::-1]
    return Image.fromarray(np.rint(thickness / thickness.max() * 255).astype(np.uint8))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("mesh", nargs="?", default=default_part())
    parser.add_argument("--moves", type=int, default=100)
    parser.add_argument("--resolution", type=int, default=80)
    parser.add_argument("--out", default="milling.png")
    options = parser.parse_args()
    mesh = clvox.load(options.mesh)
    grid = clvox.Grid.fit(mesh, resolution=options.resolution)
    part = clvox.dexelize(mesh, grid=grid, lattice_bits=12)
    blank = clvox.dexelize(trimesh.creation.box(bounds=mesh.bounds), grid=grid, lattice_bits=12)
    cutter = clvox.Cutter.ball(float(mesh.extents[:2].max()) / 30)
    path = path_over(part, cutter, options.moves)

    start = time.perf_counter()
    cut = blank.cut(cutter, path)
    seconds = time.perf_counter() - start
    print(f"{len(path) - 1} moves, {(len(path) - 1) / seconds:.0f} a second")
    print(f"volume {blank.volume:.6g} -> {cut.model.volume:.6g}, of the part {part.volume:.6g}")
    deepest = int(cut.engagement.argmax())
    print(f"deepest engagement {cut.engagement[deepest]:.4g}, of move {deepest}")
    assert np.isclose(cut.removed.sum(), blank.volume - cut.model.volume)
    assert (part - cut.model).volume == 0, "the cutter went into the part"
    picture(cut.model).save(options.out)
    print(f"drawn: {options.out}")

    # Clamped anew, ten times: about the axis of the longest side, within a grid that holds it all.
    left = cut.model.to_mesh()
    middle, size = left.bounds.mean(axis=0), float(np.linalg.norm(left.extents))
    count = options.resolution // 2
    room = clvox.Grid(middle - size / 2, size / count, (count, count, count))
    first = model = clvox.dexelize(left, grid=room, axis="xyz")
    turn = trimesh.transformations.rotation_matrix(np.pi / 5, (1, 0, 0), middle)
    for _ in range(10):
        model = model.moved(turn)
    lost = (model.z ^ first.z).volume / first.volume
    gained = model.volume / first.volume - 1
    print(f"ten turns: {lost:.2%} of the volume differs, {gained:+.3%} in all")


if __name__ == "__main__":
    main()
