"""Turntables: animations of a model that turns."""

from __future__ import annotations

import errno
import os
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clvox._files import whole
from clvox.camera import Camera
from clvox.errors import FormatError, GridError
from clvox.models import VoxelModel
from clvox.render.image import check_kinds, pixels_of, render

PAPER = 255, 255, 255

MOST_SECONDS = 655
"""A GIF file shows a frame for less than so long; and frames that are equal are made one."""


def turntable(
    model: VoxelModel,
    path: str | os.PathLike[str],
    *,
    camera: Camera | None = None,
    frames: int = 36,
    seconds: float = 3.0,
    size: tuple[int, int] = (480, 360),
    **options: Any,
) -> None:
    """Write a GIF file in which a model turns once about its vertical axis.

    Parameters
    ----------
    model : VoxelModel
    path : path
        Of the GIF file; its name ends in .gif.  It is written whole or not at all.
    camera : Camera, optional
        Where the first picture is taken from; the others about its target and *up*.  By default
        such that all of the model is seen while it turns about the z axis.
    frames : int
        Pictures, at least 2.
    seconds : float
        How long one turn takes: less than 655.
    size : (int, int)
        Columns and rows of pixels.
    **options
        As for `render`; the background is white by default, since GIF files know no half-tones.

    Raises
    ------
    GridError
        As `render`, or there are too few frames, or *seconds* are none or too many.
    FormatError
        The file's name does not end in .gif.
    OSError
        There is no such folder, or the file cannot be written.
    """
    from PIL import Image

    target = Path(path)
    if target.suffix.lower() != ".gif":
        raise FormatError(f"{target}: the suffix must be .gif, got {target.suffix or 'none'}")
    if not target.parent.is_dir():
        raise FileNotFoundError(errno.ENOENT, "there is no such folder", str(target.parent))
    if isinstance(frames, bool) or not isinstance(frames, int | np.integer) or frames < 2:
        raise GridError(f"frames must be at least 2, an integer, got {frames!r}")
    if not isinstance(seconds, int | float | np.number) or not 0 < seconds < MOST_SECONDS:
        raise GridError(
            f"seconds must be a number above 0 and below {MOST_SECONDS}, got {seconds!r}"
        )
    check_kinds(model, camera, options.get("material"))
    columns, rows = pixels_of(size)
    if options.get("background") is None:
        options["background"] = PAPER
    first = camera or Camera.around(_drum(model), aspect=columns / rows)
    pictures = [
        Image.fromarray(
            render(model, camera=first.turned(360 * number / frames), size=size, **options)
        ).convert("RGB")
        for number in range(frames)
    ]
    # One palette for all frames, so that colours do not flicker.
    palette = pictures[0].quantize(255)
    frames_of = [picture.quantize(palette=palette) for picture in pictures]
    file = BytesIO()
    frames_of[0].save(
        file,
        "GIF",
        save_all=True,
        append_images=frames_of[1:],
        duration=int(1000 * seconds / frames),
        loop=0,
    )
    with whole(target) as partial:
        partial.write_bytes(file.getvalue())


@dataclass(frozen=True)
class _Drum:
    """Points on the rims of the drum that a turning model stays within."""

    bounds: NDArray[np.float64]
    outline: NDArray[np.float64]


def _drum(model: VoxelModel) -> _Drum:
    low, high = model.bounds
    middle = (low + high) / 2
    radius = float(np.linalg.norm((model.outline - middle)[:, :2], axis=1).max())
    angles = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    ring = middle[:2] + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    rims = [np.column_stack([ring, np.full(len(ring), z)]) for z in (low[2], high[2])]
    outline = np.concatenate(rims)
    return _Drum(np.stack([outline.min(axis=0), outline.max(axis=0)]), outline)
