"""How Sphinx builds the documentation: see `make docs`."""

from __future__ import annotations

from clvox import __version__

project = "clvox"
copyright = "2026, the clvox developers"
author = "the clvox developers"
release = version = __version__

extensions = [
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.doctest",
    "sphinx.ext.mathjax",
]
exclude_patterns = ["_build", "examples"]
nitpicky = True
nitpick_ignore_regex = [
    # Types of others, and shapes and conditions in the prose of numpydoc.
    ("py:class", r"(numpy|np|trimesh|npt|NDArray|ArrayLike|optional|collections|pathlib)\b.*"),
]

html_theme = "furo"
html_title = f"clvox {release}"

myst_enable_extensions = ["amsmath", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3

autodoc_typehints = "none"
autodoc_member_order = "bysource"
autosummary_generate = True
numpydoc_show_class_members = False
# Docstrings are checked where they are read: first line, parameters that exist, order of sections.
numpydoc_validation_checks = {"GL06", "GL07", "GL08", "PR01", "PR02", "PR03", "SS02", "SS03"}

doctest_test_doctest_blocks = "default"
doctest_global_setup = """
import numpy as np
import trimesh

import clvox
"""
