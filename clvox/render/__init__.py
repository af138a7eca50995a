"""Pictures of models."""

from clvox.render.image import render

__all__ = ["render"]
