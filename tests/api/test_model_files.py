"""Models that leave the process and come back: pickles and files, sound and damaged."""

from __future__ import annotations

import io
import pickle
import zipfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

import clvox
from clvox import VoxelModel
from clvox.errors import DeviceError, FormatError
from clvox.grid import Grid
from clvox.models import archive

Record = dict[str, NDArray[Any]]

LEVELS = [[(26, 25, 11)], [(4, 4, 2), (8, 8, 8)], [(6, 5, 4), (5, 6, 3)]]


@pytest.fixture(scope="module", params=LEVELS, ids=["dense", "8 x 8 x 8", "5 x 6 x 3"])
def model(request: pytest.FixtureRequest) -> VoxelModel:
    mesh = trimesh.creation.torus(7.0, 3.0)
    grid = Grid((-10.1, -10.2, -3.3), (0.8, 0.82, 0.6), (26, 25, 11))
    return clvox.voxelize(mesh, grid=grid, levels=request.param)


def same(one: VoxelModel, other: VoxelModel) -> bool:
    """Equal to the last bit, levels and all."""
    mine, others = one.to_record(), other.to_record()
    return list(mine) == list(others) and all(
        mine[name].tobytes() == others[name].tobytes() and mine[name].dtype == others[name].dtype
        for name in mine
    )


def clone(model: VoxelModel, protocol: int) -> VoxelModel:
    """A model, to a pickle and back."""
    found: VoxelModel = pickle.loads(pickle.dumps(model, protocol))  # noqa: S301 - our own pickle
    return found


def test_a_file_gives_the_model_back(model: VoxelModel, tmp_path: Path) -> None:
    """By a path as text or not; with the same grid, levels and voxels, and no other file."""
    for path in (tmp_path / "model.npz", str(tmp_path / "again.npz")):
        model.save(path)
        found = clvox.open(path)
        assert found == model
        assert same(found, model)
        assert found.grid == model.grid
        assert found.levels == model.levels
        assert found.report.device == found.device
    assert sorted(path.name for path in tmp_path.iterdir()) == ["again.npz", "model.npz"]


def test_a_file_replaces_an_older_one(model: VoxelModel, tmp_path: Path) -> None:
    path = tmp_path / "model.npz"
    path.write_text("something older")
    model.save(path)
    assert clvox.open(path) == model


def test_a_file_is_plain_numpy(model: VoxelModel, tmp_path: Path) -> None:
    """Anybody can read it, without pickles; and it is much smaller than the voxels as bytes."""
    model.save(tmp_path / "model.npz")
    with np.load(tmp_path / "model.npz", allow_pickle=False) as file:
        assert file["version"] == archive.VERSION
        assert file["shape"].tolist() == [26, 25, 11]
        assert set(file) == set(model.to_record())
    assert (tmp_path / "model.npz").stat().st_size < model.grid.size


@pytest.mark.parametrize("protocol", range(2, pickle.HIGHEST_PROTOCOL + 1))
def test_a_pickle_gives_the_model_back(model: VoxelModel, protocol: int) -> None:
    """With its report, and with the mesh, which answers what is touched."""
    found = clone(model, protocol)
    assert same(found, model)
    assert found.report == model.report
    assert found.volume_bounds == model.volume_bounds
    drawn = VoxelModel.from_array(model.to_array(), model.grid, levels=model.levels)
    assert clone(drawn, protocol) == drawn == model


def test_a_file_does_not_know_the_mesh(model: VoxelModel, tmp_path: Path) -> None:
    model.save(tmp_path / "model.npz")
    with pytest.raises(clvox.MeshError, match="known to be touched"):
        clvox.open(tmp_path / "model.npz").classify([[0, 0, 0]])


def test_a_file_is_opened_on_a_device(model: VoxelModel, tmp_path: Path) -> None:
    model.save(tmp_path / "model.npz")
    assert clvox.open(tmp_path / "model.npz", device=model.device) == model
    with pytest.raises(DeviceError, match="no OpenCL device matches 'abacus'"):
        clvox.open(tmp_path / "model.npz", device="abacus")


# --- what cannot be written ---------------------------------------------------------------------


@pytest.mark.parametrize("name", ["model", "model.npy", "model.npz.gz", "model.vdb"])
def test_other_names_are_refused(model: VoxelModel, tmp_path: Path, name: str) -> None:
    with pytest.raises(FormatError, match=r"a model is saved as \.npz, got .*model"):
        model.save(tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_nothing_is_left_half_written(
    model: VoxelModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """If the disk is full, say; what was there before is still there, and whole."""
    path = tmp_path / "model.npz"
    model.save(path)
    before = path.read_bytes()

    def fill(file: io.BufferedWriter, **_: object) -> None:
        file.write(b"half a model")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez_compressed", fill)
    with pytest.raises(OSError, match="No space left"):
        model.save(path)
    assert [file.name for file in tmp_path.iterdir()] == ["model.npz"]
    assert path.read_bytes() == before
    with pytest.raises(FileNotFoundError):
        model.save(tmp_path / "nowhere" / "model.npz")


# --- what cannot be read ------------------------------------------------------------------------


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        clvox.open(tmp_path / "model.npz")


@pytest.mark.parametrize(
    "content",
    [b"", b"PK\x03\x04", b"not a zip", b"\x93NUMPY\x01\x00", bytes(range(256)) * 40],
    ids=["empty", "begins like one", "text", "begins like an array", "bytes"],
)
def test_files_of_something_else(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "model.npz"
    path.write_bytes(content)
    with pytest.raises(FormatError, match=r"model\.npz"):
        clvox.open(path)


def test_an_array_is_not_a_model(tmp_path: Path) -> None:
    with open(tmp_path / "model.npz", "wb") as file:  # noqa: PTH123 - np.save adds a suffix to paths
        np.save(file, np.zeros(3))
    with pytest.raises(FormatError, match=r"model\.npz is one array"):
        clvox.open(tmp_path / "model.npz")


def test_a_zip_of_other_things(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "model.npz", "w") as file:
        file.writestr("readme.txt", "hello")
    with pytest.raises(FormatError):
        clvox.open(tmp_path / "model.npz")


def test_a_file_cut_short(model: VoxelModel, tmp_path: Path) -> None:
    """Wherever it is cut."""
    model.save(tmp_path / "whole.npz")
    whole = (tmp_path / "whole.npz").read_bytes()
    path = tmp_path / "model.npz"
    for length in np.linspace(0, len(whole) - 1, 40, dtype=int):
        path.write_bytes(whole[:length])
        with pytest.raises(FormatError, match=r"model\.npz"):
            clvox.open(path)


def test_a_file_with_a_wrong_byte(model: VoxelModel, tmp_path: Path) -> None:
    """Wherever it is: an error, or a byte that says nothing; never another model."""
    model.save(tmp_path / "whole.npz")
    whole = (tmp_path / "whole.npz").read_bytes()
    path = tmp_path / "model.npz"
    refused = 0
    for at in np.linspace(0, len(whole) - 1, 200, dtype=int):
        damaged = bytearray(whole)
        damaged[at] ^= 0x55
        path.write_bytes(damaged)
        refused += not opens_as(model, path)
    assert refused > 100


def opens_as(model: VoxelModel, path: Path) -> bool:
    """Whether a file is opened; what it gives must be *model*, and the error a FormatError."""
    with suppress(FormatError):
        assert same(clvox.open(path), model)
        return True
    return False


def remove(name: str) -> Callable[[Record], object]:
    return lambda record: record.pop(name)


def put(name: str, value: Any) -> Callable[[Record], object]:
    return lambda record: record.update({name: np.array(value)})


def alter(name: str, change: Callable[[NDArray[Any]], NDArray[Any]]) -> Callable[[Record], object]:
    return lambda record: record.update({name: change(record[name])})


COMMON = [
    remove("version"),
    remove("origin"),
    remove("levels"),
    put("extra", 1),
    put("version", 2),
    put("version", [1]),
    put("version", "one"),
    put("version", np.nan),
    put("origin", [0, 0]),
    put("origin", [0, 0, np.nan]),
    put("origin", "here"),
    put("spacing", [1, 0, 1]),
    put("spacing", [1, -1, 1]),
    put("shape", [26, 25, 0]),
    put("shape", [58, 25, 11]),
    put("shape", [2**40, 25, 11]),
    put("shape", [26, 25, 10.5]),
]
DENSE = [
    put("shape", [26, 25, 12]),
    put("levels", [[26, 25, 12]]),
    put("levels", [[4, 4, 2], [8, 8, 8]]),
    put("levels", "all"),
    alter("voxels", lambda a: a[:-1]),
    alter("voxels", lambda a: a.astype(np.int32)),
    alter("voxels", lambda a: a.astype(np.float64)),
    alter("voxels", lambda a: a.ravel()),
    alter("voxels", lambda a: a | np.uint32(1 << 31)),
]
TWO = [
    put("levels", [[4, 4, 2]]),
    put("levels", [[4, 4, 2], [8, 8, 9]]),
    put("levels", [[4, 4, 3], [8, 8, 8]]),
    put("levels", [[4, 4, 2], [8, 8, 0]]),
    put("levels", [[4, 4, 2], [-8, 8, 8]]),
    put("levels", [[4, 4, 2], [8.0, 8, 8]]),
    put("levels", [[1, 1, 1], [2**31, 2**31, 2**31]]),
    put("levels", [[1, 1, 1], [65, 25, 12]]),
    alter("levels", lambda a: a[:, :2]),
    alter("boundary", lambda a: a[:-1]),
    alter("boundary", lambda a: a.astype(np.uint64)),
    alter("boundary", lambda a: a ^ np.uint32(1)),
    alter("boundary", np.zeros_like),
    alter("boundary", lambda a: a | np.uint32(1 << 31)),
    alter("inside", lambda a: a[:, :-1]),
    alter("inside", lambda a: a.astype(np.int64)),
    alter("inside", lambda a: a | np.uint32(1 << 31)),
    alter("inside", lambda a: a | np.uint32(0xF)),
    alter("rank", lambda a: a + np.uint32(1)),
    alter("rank", lambda a: a[:0]),
    alter("rank", lambda a: np.concatenate([a, a])),
    put("shape", [26, 25, 9]),
    put("shape", [26, 20, 11]),
    put("shape", [25, 25, 11]),
    alter("bricks", lambda a: a[:-1]),
    alter("bricks", lambda a: a | np.uint32(1 << 31)),
    alter("bricks", lambda a: np.concatenate([a, a])),
    alter("bricks", lambda a: a[:, :-1]),
    alter("bricks", lambda a: a.astype(np.uint8)),
]


@pytest.mark.parametrize(
    ("levels", "damage"),
    [(LEVELS[0], damage) for damage in COMMON + DENSE]
    + [(LEVELS[1], damage) for damage in COMMON + TWO],
)
def test_records_that_make_no_sense(
    tmp_path: Path, levels: Any, damage: Callable[[Record], object]
) -> None:
    """Sound files, wrong contents: nothing reaches the device that could read out of bounds."""
    grid = Grid((-10.1, -10.2, -3.3), (0.8, 0.82, 0.6), (26, 25, 11))
    ball = trimesh.creation.torus(9.5, 3.0)
    record = clvox.voxelize(ball, grid=grid, levels=levels).to_record()
    damage(record)
    archive.write(tmp_path / "model.npz", record)
    with pytest.raises(FormatError):
        clvox.open(tmp_path / "model.npz")


def test_objects_are_not_unpickled(model: VoxelModel, tmp_path: Path) -> None:
    """A file from a stranger runs no code."""
    record = model.to_record() | {"origin": np.array([print, 0, 0], dtype=object)}
    np.savez(tmp_path / "model.npz", **record)  # type: ignore[arg-type]
    with pytest.raises(FormatError, match="allow_pickle"):
        clvox.open(tmp_path / "model.npz")
