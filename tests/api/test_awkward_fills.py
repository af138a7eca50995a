"""Every fill on every awkward file of the test data: a model, or an error that says why not."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

import clvox
from clvox.mesh import Surface, check
from clvox.models.build import Fill

RESOLUTION = 48


def files() -> list[Any]:
    """The awkward files of the manifest, as parameters of a test."""
    folder = os.environ.get("CLVOX_DATA")
    if not folder:
        return [pytest.param("", marks=pytest.mark.skip(reason="CLVOX_DATA is not set"))]
    entries = json.loads(Path(folder, "manifest.json").read_text())["entries"]
    return [entry["path"] for entry in entries if entry["category"] == "awkward"]


def refusal(surface: Surface, fill: Fill) -> type[clvox.MeshError] | None:
    """Why a surface cannot be filled so, by what the check says of its edges."""
    if fill in ("parity", "nonzero", "positive") and not surface.closed:
        return clvox.NotClosedError
    if fill in ("nonzero", "positive") and not surface.oriented:
        return clvox.NotOrientedError
    if fill == "winding" and len(surface.uneven_edges) > len(surface.odd_edges):
        return clvox.NotOrientedError
    return None


@pytest.mark.parametrize("name", files())
def test_fills_agree_with_one_another(name: str, data_file: Callable[[str], Path]) -> None:
    try:
        surface = check(data_file(name))
    except clvox.MeshError:
        assert "single_sheet" in name
        return
    grid = clvox.Grid.fit(surface, resolution=RESOLUTION)
    fills: tuple[Fill, ...] = ("parity", "nonzero", "positive", "vote", "winding", "surface")
    found = {}
    for fill in fills:
        error = refusal(surface, fill)
        if error is not None:
            with pytest.raises(error):
                clvox.voxelize(surface, grid=grid, fill=fill)
            continue
        found[fill] = clvox.voxelize(surface, grid=grid, fill=fill)
    assert found["surface"].count
    if "parity" in found:
        assert found["vote"] == found["parity"]
    if "nonzero" in found:
        # An odd winding number is not 0; one above a half is at least 1.
        assert not (found["parity"] - found["nonzero"]).count
        assert not (found["positive"] - found["nonzero"]).count
        assert found["winding"] == found["positive"]


def test_a_mesh_inside_out_is_told_apart_by_its_sign(data_file: Callable[[str], Path]) -> None:
    mesh = clvox.load(data_file("awkward/featuretype_all_flipped.stl"))
    turned = mesh.copy()
    turned.invert()
    grid = clvox.Grid.fit(mesh, resolution=RESOLUTION)
    solid = clvox.voxelize(turned, grid=grid)
    assert solid.count
    signless: tuple[Fill, ...] = ("parity", "nonzero", "vote")
    for fill in signless:
        assert clvox.voxelize(mesh, grid=grid, fill=fill) == solid
    signed: tuple[Fill, ...] = ("positive", "winding")
    for fill in signed:
        assert clvox.voxelize(mesh, grid=grid, fill=fill).count == 0
        assert clvox.voxelize(turned, grid=grid, fill=fill) == solid


def test_holes_in_a_part_are_guessed(data_file: Callable[[str], Path]) -> None:
    """The part with holes is the part without, but for a few voxels at the holes."""
    whole = clvox.load(data_file("awkward/featuretype_all_flipped.stl"))
    holes = clvox.load(data_file("awkward/featuretype_with_holes.stl"))
    grid = clvox.Grid.fit(whole, resolution=RESOLUTION)
    solid = clvox.voxelize(whole, grid=grid, lattice_bits=9)
    guesses: tuple[Fill, ...] = ("vote", "winding")
    for fill in guesses:
        guess = clvox.voxelize(holes, grid=grid, fill=fill, lattice_bits=9)
        assert (guess ^ solid).count < 0.01 * solid.count


@pytest.mark.parametrize(
    "name", ["overlapping_boxes_45_bodies.obj", "featuretype_plus_scaled_copy_overlap.stl"]
)
def test_nonzero_is_a_union_by_manifold3d(name: str, data_file: Callable[[str], Path]) -> None:
    """Away from the surface of either, where manifold3d rounds the vertices that it makes."""
    manifold3d = pytest.importorskip("manifold3d")
    mesh = clvox.load(data_file(f"awkward/{name}"))
    mesh.merge_vertices()
    grid = clvox.Grid.fit(mesh, resolution=96)
    bodies = [
        manifold3d.Manifold(
            manifold3d.Mesh64(np.array(body.vertices), np.array(body.faces, np.uint64))
        )
        for body in mesh.split(only_watertight=False)
    ]
    assert len(bodies) > 1
    union = manifold3d.Manifold.batch_boolean(bodies, manifold3d.OpType.Add).to_mesh64()
    united = trimesh.Trimesh(union.vert_properties[:, :3], union.tri_verts, process=False)
    expected = clvox.voxelize(united, grid=grid, lattice_bits=9, fill="parity")
    found = clvox.voxelize(mesh, grid=grid, lattice_bits=9, fill="nonzero")
    apart = (found ^ expected).coordinates()
    assert len(apart) < 0.001 * found.count
    touched = expected.classify(grid.centers(apart)) == 2
    assert touched.all()
    low, high = found.volume_bounds
    assert low <= united.volume <= high
