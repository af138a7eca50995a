"""Pictures of models."""

from clvox.render.image import render
from clvox.render.style import Material
from clvox.render.turning import turntable

__all__ = ["Material", "render", "turntable"]
