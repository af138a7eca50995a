"""Colours of triangles, as they are given or body by body."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clvox.errors import GridError, MeshError
from clvox.models import VoxelModel
from clvox.ops.facets import upload_facets
from clvox.ops.shading import Coat
from clvox.render.style import Colour, linear

BODY_COLOURS: tuple[Colour, ...] = (
    (139, 174, 205),
    (228, 160, 92),
    (134, 188, 134),
    (206, 128, 128),
    (168, 148, 204),
    (222, 200, 108),
    (110, 180, 180),
    (214, 150, 190),
    (160, 160, 160),
    (176, 142, 112),
)
"""What bodies look like, one after the other, and again from the first on."""


def coat_of(model: VoxelModel, colours: ArrayLike | str) -> Coat:
    """Return the colours of the triangles of a model's mesh, as kernels take them.

    Raises
    ------
    MeshError
        The model has no links to triangles.
    GridError
        There is not one colour for each triangle.
    """
    # What a model holds is for the modules below; a picture reads it as the model itself does.
    kept, surfaces, session = model._attributes, model._surfaces, model._session  # noqa: SLF001
    if kept is None or kept.offsets is None or kept.faces is None or not surfaces:
        raise MeshError(
            "colours need links to triangles, which this model does not have. Ask for them when it "
            'is made: voxelize(..., attributes=("normals", "links")).'
        )
    ((surface, lattice),) = surfaces
    if isinstance(colours, str):
        if colours != "bodies":
            raise GridError(
                f"colours must be 'bodies' or a colour for each triangle, got {colours!r}"
            )
        bodies = bodies_of(surface.faces, len(surface.vertices))
        shares = np.array([linear("", colour) for colour in BODY_COLOURS], np.float32)
        own = shares[bodies % len(BODY_COLOURS)]
    else:
        given = surface.repeated + surface.duplicates + surface.cancelled + len(surface.faces)
        all_of_them = _linear_of(colours, given)
        numbers = surface.face_numbers
        own = all_of_them if numbers is None else all_of_them[numbers]
    facets = upload_facets(session, lattice.snap(surface.vertices), surface.faces)
    return Coat(kept.offsets, kept.faces, facets, lattice.bits, session.upload(own))


def bodies_of(faces: NDArray[np.int32], vertices: int) -> NDArray[np.int64]:
    """Return the number of the body that each triangle belongs to, (m,).

    Triangles with a common vertex are of one body; bodies are numbered by their lowest vertices.
    """
    root = np.arange(vertices)
    while True:
        lowest = root[faces].min(axis=1)
        joined = root.copy()
        for corner in range(3):
            np.minimum.at(joined, root[faces[:, corner]], lowest)
        while not np.array_equal(joined, joined[joined]):
            joined = joined[joined]
        if np.array_equal(joined, root):
            break
        root = joined
    bodies: NDArray[np.int64] = np.unique(root[faces[:, 0]], return_inverse=True)[1]
    return bodies.reshape(-1)


def _linear_of(colours: ArrayLike, count: int) -> NDArray[np.float32]:
    try:
        numbers = np.asarray(colours)
    except ValueError as error:
        raise GridError(
            f"colours must be 'bodies' or integers of shape ({count}, 3), a colour for each "
            "triangle of the mesh, got rows of different lengths"
        ) from error
    if numbers.shape != (count, 3) or numbers.dtype.kind not in "iu":
        raise GridError(
            f"colours must be 'bodies' or integers of shape ({count}, 3), a colour for each "
            f"triangle of the mesh, got an array of {numbers.dtype} of shape {numbers.shape}"
        )
    if numbers.size and (numbers.min() < 0 or numbers.max() > 255):
        raise GridError("colours must be from 0 to 255")
    light = np.array([linear("", (value, value, value))[0] for value in range(256)], np.float32)
    shares: NDArray[np.float32] = light[numbers]
    return shares
