"""The triple dexel model: three bundles of rays through the same voxel centres."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from clvox.device import open_session
from clvox.errors import FormatError, GridError
from clvox.grid import Grid
from clvox.models import archive, dexel_archive
from clvox.models.booleans import Combinable
from clvox.models.dexel_report import DexelReport
from clvox.models.dexel_sources import Sources
from clvox.models.dexel_surface import move_vertices
from clvox.models.dexels import AXES, DexelModel, from_rays
from clvox.models.levels import Levels
from clvox.models.voxels import VoxelModel
from clvox.ops import dexel_voxels
from clvox.ops.combine import Operation


@dataclass(frozen=True, eq=False, repr=False)
class TripleDexelModel(Combinable):
    """A solid as pieces of rays along x, along y and along z.

    The three run through the same voxel centres and agree at each of them.  Made by
    ``dexelize(axis="xyz")`` and `open`; never changed afterwards.

    Attributes
    ----------
    x, y, z : DexelModel
        The bundles.

    Raises
    ------
    GridError
        They are not along x, y and z in this order, or not on one grid and lattice.
    """

    x: DexelModel
    y: DexelModel
    z: DexelModel

    def __post_init__(self) -> None:
        for model in self.bundles:
            if not isinstance(model, DexelModel):
                raise GridError(f"the bundles must be three DexelModels, got {model!r}")
        axes = tuple(model.axis for model in self.bundles)
        if axes != AXES:
            raise GridError(
                f"the bundles must be along x, y and z, in this order, got {', '.join(axes)}"
            )
        if len({model.grid for model in self.bundles}) > 1:
            raise GridError(
                "the bundles must be on one grid, got "
                f"{', '.join(str(model.grid) for model in self.bundles)}. Dexelize all on one "
                "(grid=)."
            )
        bits = [model.lattice_bits for model in self.bundles]
        if len(set(bits)) > 1:
            raise GridError(
                f"the bundles must be on one lattice, got lattice_bits of {bits}. Dexelize all "
                "with the smallest."
            )

    @property
    def bundles(self) -> tuple[DexelModel, DexelModel, DexelModel]:
        """The models along x, y and z."""
        return self.x, self.y, self.z

    @property
    def grid(self) -> Grid:
        """The grid whose voxel centres the rays run through."""
        return self.x.grid

    @property
    def nbytes(self) -> int:
        """Bytes of device memory that the three hold."""
        return sum(model.nbytes for model in self.bundles)

    @property
    def device(self) -> str:
        """The device that holds the model."""
        return self.x.device

    def __repr__(self) -> str:
        nx, ny, nz = self.grid.shape
        size = f"{self.nbytes / 1e6:.1f} MB" if self.nbytes >= 1e5 else f"{self.nbytes} bytes"
        crossings = sum(model._crossings.count for model in self.bundles)
        return (
            f"TripleDexelModel({nx} x {ny} x {nz} voxels' centres, "
            f"{crossings:,} crossings, {size} on {self.device})"
        )

    def __eq__(self, other: object) -> bool:
        """Whether all three bundles have the same pieces."""
        if not isinstance(other, TripleDexelModel):
            return NotImplemented
        return self.bundles == other.bundles

    def __hash__(self) -> int:
        return hash(self.grid)

    def __reduce__(self) -> tuple[Any, ...]:
        reports = [model._built for model in self.bundles]
        sources = [model._sources for model in self.bundles]
        return _restore, (self.to_record(), reports, sources)

    # Combinations

    def __invert__(self) -> TripleDexelModel:
        """The grid's box without the model."""
        return TripleDexelModel(~self.x, ~self.y, ~self.z)

    def moved(self, transform: ArrayLike, *, grid: Grid | None = None) -> TripleDexelModel:
        """Return the model moved, by way of its mesh: see `DexelModel.moved`."""
        from clvox.models.dexel_build import remade

        return remade(self.to_mesh(), transform, grid or self.grid, self)

    def cut(self, *_: object, **__: object) -> NoReturn:
        """Refuse: a cutter's axis is z, and only rays along it are cut.

        Raises
        ------
        GridError
            Always; it says what to do instead.
        """
        raise GridError(
            "rays along x and y cannot be cut, as a cutter's axis is z. Cut the bundle along z "
            "(model.z.cut); a mesh of what is left, dexelized with axis='xyz', is a triple again."
        )

    # Measures, of which the rays along each axis give one

    @property
    def volume(self) -> float:
        """Mean of the volumes that the three bundles measure."""
        return float(np.mean([model.volume for model in self.bundles]))

    @property
    def center_mass(self) -> NDArray[np.float64]:
        """Mean of the three centres of mass, (x, y, z) float64; NaN if there is nothing."""
        center: NDArray[np.float64] = np.mean([m.center_mass for m in self.bundles], axis=0)
        return center

    @property
    def moment_inertia(self) -> NDArray[np.float64]:
        """Mean of the three moments of inertia, (3, 3) float64."""
        inertia: NDArray[np.float64] = np.mean([m.moment_inertia for m in self.bundles], axis=0)
        return inertia

    def contains(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Return whether each point is inside by two of the three bundles at least; (n,) bool."""
        votes = sum(model.contains(points).astype(np.uint8) for model in self.bundles)
        inside: NDArray[np.bool_] = np.asarray(votes) >= 2
        return inside

    # Ways out

    def to_voxels(self, *, levels: Levels | None = None) -> VoxelModel:
        """Return the voxels whose samples are inside, see `DexelModel.to_voxels`.

        All three bundles have the same ones.
        """
        return self.y.to_voxels(levels=levels)

    def to_mesh(self) -> trimesh.Trimesh:
        """Return the surface, by marching cubes: closed and oriented.

        Each vertex lies where the ray along its edge crosses the surface.  The vertex normals are
        those of the triangles crossed there, unless the model was read from a file, which has no
        meshes.

        Returns
        -------
        trimesh.Trimesh
            Without triangles if no sample is inside.

        Raises
        ------
        GridError
            The bundles are not of one solid.
        """
        return move_vertices(self.to_voxels().to_mesh(), self.bundles)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the model to *path*, a ``.npz`` file, see `DexelModel.save`."""
        archive.write(path, self.to_record())

    def to_record(self) -> dict[str, NDArray[Any]]:
        """Return the grid and the arrays of the model, as docs/layouts describes them."""
        bundles = [
            dexel_archive.Rays(
                AXES.index(model.axis),
                model.lattice_bits,
                model.fill,
                model._crossings,
                [mesh.triangles for mesh in model._sources.meshes],
            )
            for model in self.bundles
        ]
        return dexel_archive.pack(self.grid, *bundles)

    # Inside

    def _combined(self, other: TripleDexelModel, operation: Operation) -> TripleDexelModel:
        pairs = zip(self.bundles, other.bundles, strict=True)
        x, y, z = (mine._combined(theirs, operation) for mine, theirs in pairs)
        return TripleDexelModel(x, y, z)


def restore_triple(
    record: dict[str, NDArray[Any]],
    reports: list[DexelReport | None],
    sources: list[Sources | None],
    device: Any = None,
) -> TripleDexelModel:
    """Return the model of arrays that were read."""
    session = open_session(device)
    grid, bundles = dexel_archive.unpack_triple(session, record)
    x, y, z = (
        from_rays(session, grid, rays, report, meshes)
        for rays, report, meshes in zip(bundles, reports, sources, strict=True)
    )
    return TripleDexelModel(x, y, z)


def require_agreement(model: TripleDexelModel) -> None:
    """Refuse a model that was read whose bundles differ at the centre of a voxel.

    Raises
    ------
    FormatError
        They do.
    OutOfMemoryError
        There is no room for a bit for each voxel of the grid.
    """
    # On the host, so that the device holds the samples of one bundle at a time.
    x, y, z = (
        dexel_voxels.to_dense(bundle._session, bundle._frame, bundle._pieces).get()
        for bundle in model.bundles
    )
    if not (np.array_equal(x, y) and np.array_equal(x, z)):
        raise FormatError("the model's bundles disagree on which voxel centres are inside")


def _restore(
    record: dict[str, NDArray[Any]], reports: list[DexelReport], sources: list[Sources]
) -> TripleDexelModel:
    return restore_triple(record, list(reports), list(sources))
