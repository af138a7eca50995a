"""The volume of a voxel model against its number of voxels, after Young (2017), figure 6.2.

    python volume_against_voxels.py [MESH] [--finest 192] [--out volume_against_voxels.png]

Voxels inside or touched always hold more than the solid, voxels wholly inside always less, and both
close in on it.  Without MESH it is part.stl, or the stand-in for Young's engine in the folder that
CLVOX_DATA names.  The picture is drawn with Pillow, which comes with clvox.
"""

from __future__ import annotations

import argparse
import math
import os
from pathlib import Path

import trimesh
from PIL import Image, ImageDraw, ImageFont

import clvox

ENGINE = "parts/nist_machined_part_pmi2_28k.stl.gz"
SERIES = {
    "inside or touched": (200, 60, 40),
    "sample inside": (40, 40, 40),
    "wholly inside": (40, 90, 190),
}

Row = tuple[int, float, float, float]


def measure(mesh: trimesh.Trimesh, finest: int) -> list[Row]:
    """Voxels of the grid; volumes touched, by sample and within, over the mesh's."""
    rows = []
    resolution = 8.0
    while resolution <= finest * 1.001:
        model = clvox.voxelize(mesh, resolution=round(resolution))
        low, high = model.volume_bounds
        volumes = [volume / mesh.volume for volume in (high, model.volume, low)]
        rows.append((model.grid.size, *volumes))
        print(f"{model.grid.size:>14,} voxels: {volumes[2]:.4f} < 1 < {volumes[0]:.4f}")
        assert volumes[2] < 1 < volumes[0]
        resolution *= math.sqrt(2)
    return rows


def draw(rows: list[Row], title: str) -> Image.Image:
    """Volumes over the true one, against voxels on a logarithmic scale."""
    scale = 2
    width, height, left, right, top, bottom = (scale * v for v in (760, 460, 70, 20, 50, 60))
    image = Image.new("RGB", (width, height), "white")
    pen = ImageDraw.Draw(image)
    font = ImageFont.load_default(size=13 * scale)
    first, last = math.floor(math.log10(rows[0][0])), math.ceil(math.log10(rows[-1][0]))
    ceiling = math.ceil(max(row[1] for row in rows) * 4) / 4

    def place(voxels: float, ratio: float) -> tuple[float, float]:
        x = left + (width - left - right) * (math.log10(voxels) - first) / (last - first)
        return x, height - bottom - (height - top - bottom) * ratio / ceiling

    # The strip of 10 %, and the scales.
    pen.rectangle([*place(10**first, 1.1), *place(10**last, 1.0)], fill=(252, 236, 225))
    for power in range(first, last + 1):
        x, y = place(10**power, 0)
        pen.line([x, y, x, top], fill=(225, 225, 225), width=scale)
        pen.text((x, y + 8 * scale), f"1e{power}", fill="black", font=font, anchor="mt")
    for step in range(int(ceiling * 4) + 1):
        x, y = place(10**first, step / 4)
        pen.line([x, y, width - right, y], fill=(225, 225, 225), width=scale)
        pen.text((x - 8 * scale, y), f"{step / 4:.2f}", fill="black", font=font, anchor="rm")
    pen.line([*place(10**first, 1), *place(10**last, 1)], fill="black", width=scale)
    for number, (name, colour) in enumerate(SERIES.items()):
        points = [place(row[0], row[1 + number]) for row in rows]
        pen.line(points, fill=colour, width=2 * scale, joint="curve")
        for x, y in points:
            radius = 3 * scale
            pen.ellipse([x - radius, y - radius, x + radius, y + radius], fill=colour)
        corner = width - right - 190 * scale, height - bottom - (70 - 20 * number) * scale
        pen.line([*corner, corner[0] + 25 * scale, corner[1]], fill=colour, width=2 * scale)
        end = corner[0] + 33 * scale, corner[1]
        pen.text(end, name, fill="black", font=font, anchor="lm")
    pen.text((left, top / 2), title, fill="black", font=font, anchor="lm")
    axis = (left + width - right) / 2, height - 10 * scale
    pen.text(axis, "voxels of the grid", fill="black", font=font, anchor="mb")
    return image.resize((width // scale, height // scale), Image.Resampling.LANCZOS)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("mesh", nargs="?", help="a closed and oriented mesh")
    parser.add_argument(
        "--finest", type=int, default=192, help="most voxels along the longest side"
    )
    parser.add_argument("--out", default="volume_against_voxels.png")
    options = parser.parse_args()
    folder = os.environ.get("CLVOX_DATA")
    path = Path(options.mesh or (Path(folder) / ENGINE if folder else "part.stl"))
    rows = measure(clvox.load(path), options.finest)
    title = f"Volume of the voxels / volume of the mesh: {path.name}"
    draw(rows, title).save(options.out)
    print(f"drawn: {options.out}")


if __name__ == "__main__":
    main()
