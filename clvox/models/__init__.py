"""Solids as frozen values, and the verbs that make them."""

from clvox.models.build import count_crossings, voxelize
from clvox.models.voxels import BOUNDARY, INSIDE, OUTSIDE, Report, VoxelModel, load_model

__all__ = [
    "BOUNDARY",
    "INSIDE",
    "OUTSIDE",
    "Report",
    "VoxelModel",
    "count_crossings",
    "load_model",
    "voxelize",
]
