"""The same bits on every device and in every version: digests of the meshes that ship with clvox.

Run as a script, this writes the table anew.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import pytest

import clvox

ROOT = Path(__file__).resolve().parents[2]
TABLE = Path(__file__).with_name("digests.json")
RESOLUTION = 64
BRICKS = (8, 8, 8), (5, 6, 7)
ARRAYS = "boundary", "inside", "rank", "bricks"


def digests(file: str) -> dict[str, Any]:
    """What the table says of a mesh: voxels inside, and a digest for each size of bricks."""
    mesh = clvox.load(ROOT / file)
    grid = clvox.Grid.fit(mesh, resolution=RESOLUTION)
    found: dict[str, Any] = {"shape": list(grid.shape)}
    for brick in BRICKS:
        cells = [-(-n // side) for n, side in zip(grid.shape, brick, strict=True)]
        model = clvox.voxelize(mesh, grid=grid, levels=[cells, brick])
        record = model.to_record()
        content = b"".join(record[name].astype("<u4").tobytes() for name in ARRAYS)
        found["count"] = model.count
        found["x".join(map(str, brick))] = hashlib.sha256(content).hexdigest()
    return found


@pytest.mark.parametrize("file", json.loads(TABLE.read_text()))
def test_the_bits_are_those_of_the_table(file: str) -> None:
    """Counts first: where they differ, more is wrong than the place of a bit."""
    expected = json.loads(TABLE.read_text())[file]
    found = digests(file)
    assert found["count"] == expected["count"]
    assert found == expected


if __name__ == "__main__":
    table = {file: digests(file) for file in json.loads(TABLE.read_text())}
    TABLE.write_text(json.dumps(table, indent=2) + "\n")
