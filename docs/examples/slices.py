"""The layers of a part, one picture each, as resin printers take them."""

from __future__ import annotations

from pathlib import Path

from PIL import Image

import clvox

folder = Path("slices")
folder.mkdir()
model = clvox.voxelize("part.stl", pitch=(4.0, 4.0, 10.0))
nx, ny, nz = model.grid.shape
for k in range(nz):
    # One layer at a time: the whole array never exists.
    (layer,) = model.to_array(bounds=((0, 0, k), (nx, ny, k + 1)))
    # Rows of a picture run downwards, y upwards.
    Image.fromarray(layer[::-1]).save(folder / f"{k:04}.png")
print(len(list(folder.iterdir())), "pictures of", nx, "x", ny)
