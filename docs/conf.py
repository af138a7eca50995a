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
    "sphinx.ext.doctest",
    "sphinx.ext.mathjax",
]
exclude_patterns = ["_build", "examples"]
# `Grid` in a docstring is a link where it can be one, and code elsewhere.
default_role = "py:obj"

html_theme = "furo"
html_title = f"clvox {release}"

myst_enable_extensions = ["amsmath", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3

autodoc_typehints = "none"
autodoc_member_order = "bysource"
numpydoc_show_class_members = False
# Public names have docstrings: sections in the usual order, no parameter that does not exist.
numpydoc_validation_checks = {"GL07", "GL08", "PR02", "PR03"}

doctest_test_doctest_blocks = "default"
doctest_global_setup = """
import numpy as np
import trimesh

import clvox
"""
