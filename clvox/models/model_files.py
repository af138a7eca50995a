"""Models of any kind, from the files they were saved to."""

from __future__ import annotations

import os
from typing import Any

from clvox.device import DeviceLike, open_session
from clvox.models import archive, dexel_archive
from clvox.models.dexels import from_rays
from clvox.models.triple import require_agreement, restore_triple
from clvox.models.voxels import restore


def open_model(path: str | os.PathLike[str], *, device: DeviceLike = None) -> Any:
    """Return the model that its `save` wrote to *path*.

    Returns
    -------
    VoxelModel, DexelModel or TripleDexelModel
        Only the file knows which, so type checkers take it for any of them.

    Raises
    ------
    FormatError
        The file is not such a model, or is damaged; or the bundles of a triple dexel model differ
        at the centre of a voxel.
    OutOfMemoryError
        The device has no room for it; a triple dexel model needs a bit for each voxel besides.
    """
    record = archive.read(path)
    if not dexel_archive.holds_dexels(record):
        return restore(record, None, (), device)
    if "offsets" not in record:
        triple = restore_triple(record, [None] * 3, [None] * 3, device)
        require_agreement(triple)
        return triple
    session = open_session(device)
    grid, rays = dexel_archive.unpack(session, record)
    return from_rays(session, grid, rays)
