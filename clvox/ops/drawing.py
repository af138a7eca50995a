"""Pictures of a model, and what is kept of them for the next one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pyopencl.array as cla

from clvox.device import Session
from clvox.ops.beams import Beams, find_beams
from clvox.ops.distances import Distances, measure_distances
from clvox.ops.layout import VoxelArrays
from clvox.ops.raymarch import Pixels, Scene, march, measure_lengths
from clvox.ops.shading import Coat, Fog, Paint, choose_pixels, shade, shade_volume
from clvox.ops.sky import Part, Sky, measure_sky
from clvox.picture_rays import View

RAYS_AT_ONCE = 1 << 18
"""What is known of so many rays is on the device at once, and in a processor's cache."""

DIFFERENCE = 12
"""So much a byte of a pixel differs from its neighbours' before it is worth more rays."""


@dataclass(frozen=True)
class Drawing:
    """What pictures of a model need besides it; made for the first, and kept for the next.

    edge: which voxels are touched, if the model keeps that: rays of some pictures meet them.
    """

    session: Session
    arrays: VoxelArrays
    spacing: tuple[float, float, float]
    edge: cla.Array | None = None

    @cached_property
    def distances(self) -> Distances:
        """Lets rays skip what is empty, or all inside."""
        return measure_distances(self.session, self.arrays, self.edge)

    @cached_property
    def sky(self) -> Sky:
        """Tells what hides the sky in hollows."""
        return measure_sky(self.session, self.arrays, self.spacing)

    def sky_of(self, view: View) -> Sky:
        """The same where a view cuts something away."""
        if view.low == (0, 0, 0) and view.high == self.arrays.shape and view.cut is None:
            return self.sky
        part = Part(view.low, view.high)
        if view.cut is not None:
            part = replace(part, plane=view.cut.beyond)
        return measure_sky(self.session, self.arrays, self.spacing, part)

    @property
    def nbytes(self) -> int:
        """Bytes on the device of what has been made."""
        made = (self.__dict__.get(name) for name in ("distances", "sky"))
        return sum(part.nbytes for part in made if part is not None)


@dataclass(frozen=True)
class Picture:
    """What is drawn, and by which rays.

    view: of `samples` x `samples` rays for each pixel; size: columns and rows of pixels.
    coat: colours of triangles, if they have some.
    """

    drawing: Drawing
    scene: Scene
    view: View
    size: tuple[int, int]
    samples: int
    coat: Coat | None = None


def draw(picture: Picture, look: Paint | Fog, *, occlusion: bool, adaptive: bool) -> cla.Array:
    """Return a picture, (rows, columns, 4) uint8, on the device.

    occlusion: whether hollows are darker.  adaptive: whether pixels that hardly differ from those
    around them make do with the ray in the middle of theirs.
    """
    drawing, view, samples = picture.drawing, picture.view, picture.samples
    session, size = drawing.session, picture.size
    beams = find_beams(session, drawing.distances, drawing.arrays, view.rays, size, samples)
    sky = drawing.sky_of(view) if occlusion and isinstance(look, Paint) else None
    canvas = session.empty((size[1], size[0], 4), np.uint8)
    brush = _Brush(session, picture.scene, look, beams, sky, picture.coat, canvas)
    if samples == 1 or not adaptive:
        brush.draw(view, Pixels.whole(size, samples))
        return canvas
    brush.draw(view.middle(samples), Pixels.whole(size))
    count, numbers = choose_pixels(session, canvas, DIFFERENCE)
    brush.draw(view, Pixels(size, samples, 0, count, numbers))
    return canvas


@dataclass(frozen=True)
class _Brush:
    """Draws pixels on a canvas."""

    session: Session
    scene: Scene
    look: Paint | Fog
    beams: Beams | None
    sky: Sky | None
    coat: Coat | None
    canvas: cla.Array

    def draw(self, view: View, pixels: Pixels) -> None:
        """Draw pixels, some after the other; the view has as many rays for each as they have."""
        for part in pixels.parts(RAYS_AT_ONCE):
            if isinstance(self.look, Fog):
                lengths = measure_lengths(self.session, self.scene, view, part, self.beams)
                shade_volume(self.session, lengths, part, self.look, self.canvas)
                continue
            hits = march(self.session, self.scene, view, part, self.beams)
            known = part, hits, self.look, self.sky, self.canvas, self.coat
            shade(self.session, self.scene, view, *known)
