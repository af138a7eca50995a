"""How far the surface of a triple dexel model lies from the surface it was made of.

    python triple_dexel_accuracy.py [--finest 32] [--fineness 5] [--out triple_dexel_accuracy.png]

A sphere, a torus and a part; voxels along the longest side from 16 on, doubling.  Distances are
taken both ways, in the longest side: the largest (Hausdorff) and the root of the mean square.
On smooth surfaces both fall with the square of the width of a voxel, on a part, whose edges
marching cubes cuts off, the largest falls with the width.
"""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image, ImageDraw, ImageFont
from scipy.spatial import cKDTree

import clvox

PART = "parts/nist_machined_part_pmi2_28k.stl.gz"
COLOURS = [(200, 60, 40), (40, 90, 190), (60, 140, 60)]
SAMPLES = 5_000

Distance = Callable[[np.ndarray], np.ndarray]
Row = tuple[int, float, float]


def distance_to(mesh: trimesh.Trimesh) -> Distance:
    """Distance of points to a mesh: to all of its triangles, cut small, that may be nearest."""
    vertices, faces = trimesh.remesh.subdivide_to_size(
        mesh.vertices, mesh.faces, float(mesh.extents.max()) / 64, max_iter=20
    )
    triangles = vertices[faces]
    centers = triangles.mean(axis=1)
    tree = cKDTree(centers)
    radius = float(np.linalg.norm(triangles - centers[:, None], axis=2).max())

    def measure(points: np.ndarray) -> np.ndarray:
        found = []
        for some in np.array_split(points, max(1, len(points) // 1000)):
            # The centre of the nearest triangle is no farther than that of any, plus its radius.
            near = tree.query_ball_point(some, tree.query(some)[0] + radius)
            counts = np.array([len(numbers) for numbers in near])
            candidates, owners = np.concatenate(near).astype(int), np.repeat(some, counts, axis=0)
            # In units of the triangles: trimesh takes small lengths for zero.
            corners, owners = triangles[candidates] / radius, owners / radius
            closest = trimesh.triangles.closest_point(corners, owners)
            away = np.linalg.norm(closest - owners, axis=1) * radius
            found.append(np.minimum.reduceat(away, np.cumsum(counts) - counts))
        return np.concatenate(found)

    return measure


def sphere(fineness: int) -> tuple[trimesh.Trimesh, Distance]:
    mesh = trimesh.creation.icosphere(subdivisions=fineness)
    return mesh, lambda points: np.abs(np.linalg.norm(points, axis=1) - 1)


def torus(fineness: int) -> tuple[trimesh.Trimesh, Distance]:
    sections = {"major_sections": 5 << fineness, "minor_sections": 2 << fineness}
    mesh = trimesh.creation.torus(1.0, 0.4, **sections)

    def measure(points: np.ndarray) -> np.ndarray:
        across = np.hypot(points[:, 0], points[:, 1]) - 1.0
        return np.abs(np.hypot(across, points[:, 2]) - 0.4)

    return mesh, measure


def measure(mesh: trimesh.Trimesh, to_input: Distance, finest: int) -> list[Row]:
    """Voxels along the longest side, largest distance, root of the mean square."""
    rows = []
    there, _ = trimesh.sample.sample_surface(mesh, SAMPLES, seed=2)
    side = float(mesh.extents.max())
    resolution = 16
    while resolution <= finest:
        made = clvox.dexelize(mesh, resolution=resolution, axis="xyz").to_mesh()
        assert made.is_watertight
        here, _ = trimesh.sample.sample_surface(made, SAMPLES, seed=3)
        both = [to_input(here), distance_to(made)(there)]
        largest = max(float(distance.max()) for distance in both) / side
        rms = math.sqrt(sum(float((distance**2).mean()) for distance in both) / 2) / side
        rows.append((resolution, largest, rms))
        print(f"{resolution:>6}: Hausdorff {largest:.3g}, rms {rms:.3g}", flush=True)
        resolution *= 2
    return rows


def draw(series: dict[str, list[Row]]) -> Image.Image:
    """Distances against voxels, both on logarithmic scales, with a line of slope 2."""
    scale = 2
    width, height, left, right, top, bottom = (scale * v for v in (760, 480, 80, 20, 30, 60))
    image = Image.new("RGB", (width, height), "white")
    pen = ImageDraw.Draw(image)
    font = ImageFont.load_default(size=13 * scale)
    rows = [row for found in series.values() for row in found]
    first, last = math.log2(min(row[0] for row in rows)), math.log2(max(row[0] for row in rows))
    low = math.floor(math.log10(min(row[2] for row in rows)))
    high = math.ceil(math.log10(max(row[1] for row in rows)))

    def place(count: float, distance: float) -> tuple[float, float]:
        x = left + (width - left - right) * (math.log2(count) - first) / max(last - first, 1)
        y = (math.log10(distance) - low) / (high - low)
        return x, height - bottom - (height - top - bottom) * y

    for power in range(low, high + 1):
        x, y = place(2**first, 10.0**power)
        pen.line([x, y, width - right, y], fill=(225, 225, 225), width=scale)
        pen.text((x - 8 * scale, y), f"1e{power}", fill="black", font=font, anchor="rm")
    for power in range(round(first), round(last) + 1):
        x, y = place(2**power, 10.0**low)
        pen.line([x, y, x, top], fill=(225, 225, 225), width=scale)
        pen.text((x, y + 8 * scale), str(2**power), fill="black", font=font, anchor="mt")
    largest = min(found[0][2] for found in series.values()) / 2
    ends = [(2**count, largest * 4.0 ** (first - count)) for count in (first, last)]
    if ends[1][1] > 10.0**low:
        pen.line([place(*ends[0]), place(*ends[1])], fill=(150, 150, 150), width=scale)
        pen.text(place(*ends[1]), "slope 2 ", fill=(120, 120, 120), font=font, anchor="rb")
    for number, (name, found) in enumerate(series.items()):
        for kind, column in (("Hausdorff", 1), ("rms", 2)):
            points = [place(row[0], row[column]) for row in found]
            pen.line(points, fill=COLOURS[number], width=scale * (2 if column == 1 else 1))
            radius = scale * (4 if column == 1 else 2)
            for x, y in points:
                box = [x - radius, y - radius, x + radius, y + radius]
                pen.ellipse(box, fill=COLOURS[number])
            corner = width - right - 10 * scale, top + (5 + 18 * (2 * number + column)) * scale
            pen.text(corner, f"{name}, {kind}", fill=COLOURS[number], font=font, anchor="rm")
    axis = (left + width - right) / 2, height - 10 * scale
    pen.text(axis, "voxels along the longest side", fill="black", font=font, anchor="mb")
    corner = left, top / 2
    pen.text(corner, "distance / longest side", fill="black", font=font, anchor="lm")
    return image.resize((width // scale, height // scale), Image.Resampling.LANCZOS)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--finest", type=int, default=32, help="most voxels along a side")
    parser.add_argument("--fineness", type=int, default=5, help="of the sphere and the torus")
    parser.add_argument("--out", default="triple_dexel_accuracy.png")
    options = parser.parse_args()
    folder = os.environ.get("CLVOX_DATA")
    part = clvox.load(Path(folder) / PART if folder else "part.stl")
    inputs = {
        "sphere": sphere(options.fineness),
        "torus": torus(options.fineness),
        "part": (part, distance_to(part)),
    }
    series = {}
    for name, (mesh, to_input) in inputs.items():
        print(f"{name}, {len(mesh.faces):,} triangles")
        series[name] = measure(mesh, to_input, options.finest)
        if name != "part":
            (_, _, coarse), (_, _, fine) = series[name][0], series[name][-1]
            doublings = len(series[name]) - 1
            assert math.log2(coarse / fine) > 1.6 * doublings, "not of second order"
    draw(series).save(options.out)
    print(f"drawn: {options.out}")


if __name__ == "__main__":
    main()
