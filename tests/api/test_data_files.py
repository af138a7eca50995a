"""Every mesh file of the test data becomes a solid, or an error, as its manifest says."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

import clvox
from clvox.errors import ClvoxError

RESOLUTION = 256

OVERLAPPING = {
    "featuretype_plus_scaled_copy_overlap": "parity takes out what two of its bodies share",
}
"""Solids that hold less than the sum of their bodies."""

SOUND = {
    "featuretype_jittered_self_intersecting": "the manifest allows a solid: it is closed",
}
"""Files from which the manifest expects a warning, or something else."""


def entries(expected: str) -> list[Any]:
    """The mesh files of which the manifest says this, as parameters of a test."""
    folder = os.environ.get("CLVOX_DATA")
    if not folder:
        return [pytest.param(None, marks=pytest.mark.skip(reason="CLVOX_DATA is not set"))]
    return [
        pytest.param(entry, id=entry["path"])
        for entry in json.loads(Path(folder, "manifest.json").read_text())["entries"]
        if entry["path"].removesuffix(".gz").endswith((".stl", ".obj", ".ply"))
        and entry["expected"].startswith(expected)
    ]


@pytest.mark.parametrize("entry", entries("solid"))
def test_solids_have_their_volume(entry: Any, data_file: Callable[[str], Path]) -> None:
    """No ray is odd, and the manifest's volume is between the bounds."""
    model = clvox.voxelize(data_file(entry["path"]), resolution=RESOLUTION)
    assert model.report.odd_rays == 0
    assert max(model.grid.shape) == RESOLUTION
    stated = ("exact_solid_volume", "volume", "signed_volume_if_oriented_closed")
    volume = next(entry[name] for name in stated if entry.get(name) is not None)
    low, high = model.volume_bounds
    assert low <= model.volume <= high
    if entry["name"] in OVERLAPPING:
        assert high < volume
    else:
        assert low <= volume <= high


@pytest.mark.parametrize("entry", entries("warns"))
def test_doubtful_meshes_are_told_of(entry: Any, data_file: Callable[[str], Path]) -> None:
    """A result with a warning, or an error that says what is wrong."""
    model = None
    with suppress(ClvoxError):
        model = clvox.voxelize(data_file(entry["path"]), resolution=RESOLUTION)
    if model is None:
        assert not entry.get("watertight")
        return
    assert model.report.odd_rays == 0
    assert model.report.warnings or entry["name"] in SOUND
    volume = entry.get("signed_volume_if_oriented_closed")
    low, high = model.volume_bounds
    if volume is not None and entry["name"] not in OVERLAPPING:
        assert low <= abs(volume) <= high


@pytest.mark.parametrize("entry", entries("refused"))
def test_broken_files_are_refused(entry: Any, data_file: Callable[[str], Path]) -> None:
    with pytest.raises(ClvoxError) as caught:
        clvox.voxelize(data_file(entry["path"]), resolution=RESOLUTION)
    assert str(caught.value)
