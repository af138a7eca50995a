"""Solids as frozen values, and the verbs that make them."""

from clvox.models.build import count_crossings, voxelize
from clvox.models.cutter import Cutter
from clvox.models.dexel_build import dexelize
from clvox.models.dexel_report import DexelReport
from clvox.models.dexels import DexelModel
from clvox.models.milling import Cut
from clvox.models.model_files import open_model as open  # noqa: A004 - as gzip.open, always with its module
from clvox.models.report import Report
from clvox.models.triple import TripleDexelModel
from clvox.models.voxels import BOUNDARY, INSIDE, OUTSIDE, VoxelModel

__all__ = [
    "BOUNDARY",
    "INSIDE",
    "OUTSIDE",
    "Cut",
    "Cutter",
    "DexelModel",
    "DexelReport",
    "Report",
    "TripleDexelModel",
    "VoxelModel",
    "count_crossings",
    "dexelize",
    "open",
    "voxelize",
]
