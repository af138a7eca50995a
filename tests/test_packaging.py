"""What is in the tree is in the wheel, and importing clvox loads nothing heavy."""

from __future__ import annotations

import email
import email.policy
import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path, PurePosixPath

import pytest

import clvox
from tests.repository import ROOT, tracked_files

HEAVY = ("pyopencl", "trimesh", "skimage", "scipy", "PIL", "tqdm")


def shipped_as(path: Path) -> PurePosixPath | None:
    """Where in the wheel a file of the tree belongs; None for a file that stays at home."""
    if path.parts[0] == "cl_kernels":
        return PurePosixPath("clvox", path)
    return PurePosixPath(path) if path.parts[0] == "clvox" else None


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel, built from the source distribution, which is built from a clean copy."""
    folder = tmp_path_factory.mktemp("packaging")
    for path in tracked_files():
        # What an earlier build left in the tree must not end up in this one.
        (folder / "copy" / path).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / path, folder / "copy" / path)
    subprocess.run(
        [sys.executable, "-m", "build", "--outdir", folder / "dist", folder / "copy"],
        check=True,
        stdin=subprocess.DEVNULL,
    )
    (built,) = (folder / "dist").glob("*.whl")
    return built


def test_wheel_holds_all_of_the_package_and_nothing_else(wheel: Path) -> None:
    """A sub-package or a kernel that setup.cfg forgets is missed only by users otherwise."""
    expected = {str(name) for path in tracked_files() if (name := shipped_as(path))}
    with zipfile.ZipFile(wheel) as archive:
        shipped = {name for name in archive.namelist() if ".dist-info/" not in name}
    assert shipped == expected


def test_wheel_says_what_it_is(wheel: Path) -> None:
    """Version, licence and description come from where they are said."""
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (n for n in archive.namelist() if n.endswith(".dist-info/METADATA"))
        metadata = email.message_from_bytes(archive.read(name), policy=email.policy.default)
        licences = [n for n in archive.namelist() if n.endswith("LICENSE")]
    assert metadata["Version"] == clvox.__version__
    assert metadata["License"] == "MIT" or metadata["License-Expression"] == "MIT"
    assert len(licences) == 1
    assert metadata.get_content() == (ROOT / "README.md").read_text()


def test_wheel_works_where_the_tree_is_not(wheel: Path, tmp_path: Path) -> None:
    """Even unopened, as a zip file: no path of a kernel is ever given to a compiler."""
    script = (
        "import importlib.resources, clvox, clvox.cl_kernels\n"
        "folder = importlib.resources.files('clvox.cl_kernels')\n"
        "print(clvox.__file__, clvox.cl_kernels.__file__, sep='\\n')\n"
        "print(*sorted(entry.name for entry in folder.iterdir() if entry.is_dir()))\n"
    )
    run = subprocess.run(
        [sys.executable, "-c", script],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(wheel)},
        check=True,
        capture_output=True,
        text=True,
    )
    package, kernels, folders = run.stdout.split("\n")[:3]
    assert package.startswith(str(wheel))
    assert kernels.startswith(str(wheel))
    in_tree = {path.parts[1] for path in tracked_files() if path.match("cl_kernels/*/*")}
    assert folders.split() == sorted(in_tree)


def test_changelog_begins_with_this_version() -> None:
    """The first heading below the title."""
    headings = re.findall(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert headings[0] == clvox.__version__


def test_importing_clvox_loads_nothing_heavy(tmp_path: Path) -> None:
    """Nor does looking at the names that it offers."""
    script = f"import sys, clvox; dir(clvox); print([m for m in {HEAVY} if m in sys.modules])"
    run = subprocess.run(
        [sys.executable, "-c", script],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        check=True,
        capture_output=True,
        text=True,
    )
    assert run.stdout.strip() == "[]"


def test_nothing_in_the_tree_names_one_machine() -> None:
    """No path of somebody's home, no host of a package registry."""
    homes = r"(?<![\w.~*)}\]-])/(work|home|root|tmp|Users)/|[A-Z]:\\Users"
    hosts = r"(pypi|pythonhosted|anaconda)\.org"
    unwanted = re.compile(f"{homes}|{hosts}")
    found = []
    for path in tracked_files():
        text = (ROOT / path).read_bytes()
        if b"\0" not in text:
            lines = enumerate(text.decode(errors="replace").splitlines(), 1)
            found += [f"{path}:{n}: {line[:200]}" for n, line in lines if unwanted.search(line)]
    assert found == []
