"""The public names are there, are loaded late, and mean what they say in any order of import."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import clvox
from tests.repository import ROOT


@pytest.mark.parametrize("name", clvox.__all__)
def test_every_public_name_is_there(name: str) -> None:
    """And is listed by dir(), for those who look for it with the Tab key."""
    assert getattr(clvox, name) is not None
    assert name in dir(clvox)


def test_errors_are_all_public() -> None:
    """An error that cannot be caught by its public name can hardly be caught."""
    raised = {name for name in vars(clvox.errors) if name.endswith("Error")}
    assert raised <= set(clvox.__all__)


def test_a_name_that_is_not_there_is_an_attribute_error() -> None:
    """As of any module."""
    with pytest.raises(AttributeError, match="module 'clvox' has no attribute 'voxelise'"):
        clvox.voxelise  # type: ignore[attr-defined]  # noqa: B018


@pytest.mark.parametrize(
    "statement",
    ["import clvox.render", "import clvox; clvox.render", "from clvox import render"],
)
def test_render_is_the_verb_whatever_was_imported_first(statement: str, tmp_path: Path) -> None:
    """The folder of the same name would hide it."""
    script = f"{statement}\nimport clvox, clvox.render\nprint(callable(clvox.render))"
    run = subprocess.run(
        [sys.executable, "-W", "error", "-c", script],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        check=True,
        capture_output=True,
        text=True,
    )
    assert run.stdout.strip() == "True"
