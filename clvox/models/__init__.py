"""Solids as frozen values, and the verbs that make them."""

from clvox.models.build import count_crossings, voxelize
from clvox.models.report import Report
from clvox.models.voxels import BOUNDARY, INSIDE, OUTSIDE, VoxelModel
from clvox.models.voxels import load_model as open  # noqa: A004 - as gzip.open, always with its module

__all__ = [
    "BOUNDARY",
    "INSIDE",
    "OUTSIDE",
    "Report",
    "VoxelModel",
    "count_crossings",
    "open",
    "voxelize",
]
