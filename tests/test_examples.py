"""Every example runs: the scripts of docs/examples, and the Python code of every page.

The code blocks of a page are run one after another, as one script, in an empty folder that holds
``part.stl``, the part that comes with clvox.
"""

from __future__ import annotations

import importlib.resources
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.repository import ROOT, tracked_files

FENCE = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)


def code_of(path: Path) -> str:
    """The Python code of a script or a page."""
    text = (ROOT / path).read_text()
    return text if path.suffix == ".py" else "\n".join(FENCE.findall(text))


PAGES = [
    path
    for path in tracked_files()
    if (path.match("docs/examples/*.py") or path.suffix == ".md") and code_of(path)
]


@pytest.mark.parametrize("path", PAGES, ids=str)
def test_example_runs(path: Path, tmp_path: Path) -> None:
    """From beginning to end."""
    (part,) = (
        entry
        for entry in importlib.resources.files("clvox").joinpath("demo").iterdir()
        if entry.name.endswith(".stl")
    )
    (tmp_path / "part.stl").write_bytes(part.read_bytes())
    (tmp_path / "example.py").write_text(code_of(path))
    run = subprocess.run(
        [sys.executable, "example.py"],
        cwd=tmp_path,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr
