"""The jobs that are timed.

Each case says what is inside of the timed part.  Verbs are timed whole, with the upload; kernels
(the scan, the streaming passes) on arrays that are on the device.  Programs are built in the
warm-up, outside.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from importlib.resources import files
from itertools import product
from pathlib import Path
from statistics import median
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from skimage.measure import marching_cubes

import clvox
from benchmarks import frames as pictures
from benchmarks import peers
from benchmarks.dexels import dexels
from benchmarks.milling import dexel_boolean, milling
from clvox.bench import Contestant, Result, compare, meshes
from clvox.bench.streaming import compare_with_copy
from clvox.device import Session
from clvox.mesh import Surface, check
from clvox.ops.scan import prefix_sum

PART = "parts/nist_machined_part_pmi4_119k.stl.gz"
DEMO_PART = "demo/nist_bracket_plate_pmi1_5k.stl"

DENSE = 1024
"""Most voxels along the longest side of which a peer is given each as a byte."""

AGREEMENT = 256
"""Voxels along the longest side up to which the peers' voxels are held against ours."""


@dataclass(frozen=True)
class Plan:
    """How much is done: everything, or each case once at its smallest size."""

    session: Session
    repeats: int = 5
    quick: bool = False

    def pick(self, full: Any, quick: Any) -> Any:
        """Return the first, or for a quick run the second."""
        return quick if self.quick else full

    @cached_property
    def part(self) -> Path | None:
        """A machined part: from CLVOX_DATA, or else the one that comes with clvox."""
        folder = os.environ.get("CLVOX_DATA")
        if folder and not self.quick and (path := Path(folder) / PART).exists():
            return path
        shipped = files("clvox").joinpath(DEMO_PART)
        return Path(str(shipped)) if shipped.is_file() else None

    @cached_property
    def ball(self) -> Surface:
        """The large mesh: 1,310,720 triangles, about as wide as the voxels at 1024."""
        return check(meshes.bumpy_sphere(self.pick(8, 3)))

    @cached_property
    def solids(self) -> dict[str, Surface]:
        """The part, if there is one, a knot and the sphere, by their names and sizes."""
        found = {} if self.part is None else {self.part.name.split(".")[0]: check(self.part)}
        found["trefoil"] = check(self.pick(meshes.trefoil(), meshes.trefoil(24, 5)))
        found["bumpy_sphere"] = self.ball
        return {f"{name}, {len(mesh.faces):,} triangles": mesh for name, mesh in found.items()}


Case: TypeAlias = Callable[[Plan], Iterator[Result]]


def solid(plan: Plan) -> Iterator[Result]:
    """Solid voxels: load, prepare and voxelize, apart.

    clvox's voxels stay on the device as bits, the peers' are an array of bytes; "to an array" is
    clvox with the same end.  Peers decide in float32 (Open3D) or float64 (VTK), clvox exactly.
    """
    others = peers.voxelizers()
    if plan.part is not None:
        load = Contestant("clvox", partial(clvox.load, plan.part))
        yield from _compare(plan, f"load {plan.part.name}", [load])
    for label, surface in plan.solids.items():
        arrays = np.array(surface.vertices), np.array(surface.faces)
        grid = clvox.Grid.fit(surface, resolution=plan.pick(1024, 32))
        ways = [Contestant("clvox check", partial(check, arrays))]
        ways += [Contestant(peer.about, partial(peer.prepare, surface, grid)) for peer in others]
        yield from _compare(plan, f"prepare {label}", ways)
        for resolution in plan.pick((256, 1024), (32,)):
            yield from _solid(plan, label, surface, resolution, others)


def _solid(
    plan: Plan, label: str, surface: Surface, resolution: int, others: list[peers.Voxelizer]
) -> list[Result]:
    grid = clvox.Grid.fit(surface, resolution=resolution)
    ours = partial(_voxelize, plan, surface, grid)
    ways = [
        Contestant("clvox, two levels", ours, _stages),
        Contestant("clvox, dense", partial(ours, [grid.shape]), _stages),
        Contestant("clvox, to an array", lambda: ours([grid.shape]).to_array()),
    ]
    theirs = {
        peer.name: partial(peer.voxelize, peer.prepare(surface, grid), grid) for peer in others
    }
    ways += [Contestant(name, run) for name, run in theirs.items()]
    results = _compare(plan, f"solid {resolution}, {label}", ways)
    if resolution > AGREEMENT:
        return results
    voxels = ours().to_array()
    return [
        replace(
            result, notes={"voxels that differ": _differing(theirs[result.contestant](), voxels)}
        )
        if result.contestant in theirs
        else result
        for result in results
    ]


def levels(plan: Plan) -> Iterator[Result]:
    """Effective 2048 and 4096, upload included: seconds, and the device's memory at its peak."""
    for resolution in plan.pick((2048, 4096), (64, 128)):
        grid = clvox.Grid.fit(plan.ball, resolution=resolution)
        ways = [Contestant("clvox, two levels", partial(_voxelize, plan, plan.ball, grid), _stages)]
        label = f"effective {resolution}, bumpy_sphere, {len(plan.ball.faces):,} triangles"
        yield from _compare(plan, label, ways)


def update(plan: Plan) -> Iterator[Result]:
    """A mesh edited in 1 % of its triangles, in one place or all over, from host to device.

    The edited mesh is checked already, for the update and for the model made anew alike; the
    processor's seconds say more than the clock where others use the machine.
    """
    resolution = plan.pick(1024, 32)
    grid = clvox.Grid.fit(plan.ball, resolution=resolution)
    model = _voxelize(plan, plan.ball, grid)
    for where, edited, changed in _edits(plan.ball):
        anew = partial(
            clvox.voxelize,
            edited,
            grid=grid,
            lattice_bits=model.report.lattice_bits,
            device=plan.session.device,
        )
        updated = partial(model.updated, edited, changed=changed)
        if updated() != anew():
            raise RuntimeError("an update is not the edited mesh voxelized anew")
        share = len(changed) / len(edited.faces)
        label = f"update {resolution}, {share:.1%} of {len(edited.faces):,} triangles {where}"
        ways = [Contestant("voxelize", anew, _stages), Contestant("updated", updated, _stages)]
        yield from _compare(plan, label, ways)


def balance(plan: Plan) -> Iterator[Result]:
    """What a crossing costs, by kind of mesh: all rays along y counted, upload included.

    A cube whose triangles cover all rays, slivers that lie along the axes and turned ones, many
    small triangles, and all of them side by side.
    """
    resolution = plan.pick(4096, 32)
    for label, shape in meshes.kinds(plan.pick(9, 3)).items():
        surface = check(shape)
        grid = clvox.Grid.fit(surface, resolution=resolution)
        count = partial(clvox.count_crossings, surface, grid=grid, device=plan.session.device)
        total = float(count().sum(dtype=np.uint64))
        case = f"balance {resolution}, {label}, {len(surface.faces):,} triangles"
        for result in _compare(plan, case, [Contestant("clvox", count)]):
            cost = median(result.cpu_seconds) / total * 1e9
            yield replace(result, notes={"crossings": total, "CPU ns per crossing": cost})


def boolean(plan: Plan) -> Iterator[Result]:
    """The union of a mesh with a turned and shifted copy, each side's construction included.

    As voxels by clvox, with both voxelized; as a mesh by manifold3d.
    """
    one, other = plan.ball, check(meshes.turned(plan.ball.vertices, plan.ball.faces))
    bounds = np.array([one.bounds, other.bounds])
    pitch = (bounds[:, 1].max(axis=0) - bounds[:, 0].min(axis=0)).max() / plan.pick(1024, 32)
    extent = bounds[:, 1].max(axis=0) - bounds[:, 0].min(axis=0)
    grid = clvox.Grid(bounds[:, 0].min(axis=0), pitch, np.ceil(extent / pitch).astype(int))

    def ours() -> clvox.VoxelModel:
        return _voxelize(plan, one, grid) | _voxelize(plan, other, grid)

    ways = [Contestant("clvox", ours)]
    union = peers.union()
    if union is not None:
        ways.append(Contestant("manifold3d", partial(union, one, other)))
    label = f"union of two of {len(one.faces):,} triangles, {max(grid.shape)} voxels wide"
    yield from _compare(plan, label, ways)


def mesh(plan: Plan) -> Iterator[Result]:
    """Voxels to a mesh: from the model, and by scikit-image from its dense array.

    Ours ends in a trimesh.Trimesh; theirs in vertices and faces, the array being made before.
    """
    for resolution, (label, surface) in product(plan.pick((512, 1024), (24,)), plan.solids.items()):
        model = _voxelize(plan, surface, clvox.Grid.fit(surface, resolution=resolution))
        # Padded, as ours caps what the grid cuts.
        theirs = partial(marching_cubes, np.pad(model.to_array(), 1), 0.5)
        ways = [Contestant("clvox", model.to_mesh), Contestant("scikit-image, dense", theirs)]
        yield from _compare(plan, f"mesh {resolution}, {label}", ways)


def scan(plan: Plan) -> Iterator[Result]:
    """Exclusive prefix sums of uint32 on the device; ours also returns the total."""
    session = plan.session
    for count in plan.pick((10**5, 10**6, 10**7, 10**8 // 4), (10**3,)):
        counts = session.upload(np.arange(count, dtype=np.uint32) % np.uint32(7))
        target = session.empty(count, np.uint32)
        ways = [Contestant("clvox", partial(prefix_sum, session, counts))]
        theirs = peers.prefix_sum(session, counts, target)
        if theirs is not None:
            theirs()
            if not np.array_equal(target.get(), prefix_sum(session, counts)[0].get()):
                raise RuntimeError(f"two prefix sums of {count} numbers differ")
            ways.append(Contestant("pyopencl.scan", theirs))
        yield from _compare(plan, f"scan {count:,}", ways)


def contains(plan: Plan) -> Iterator[Result]:
    """A million points, inside or not: from host to host, the construction apart."""
    count, resolution = plan.pick((10**6, 1024), (10**3, 32))
    caster = peers.ray_caster()
    low, high = plan.ball.bounds
    points = np.random.default_rng(2017).uniform(low, high, (count, 3))
    model = _voxelize(plan, plan.ball, clvox.Grid.fit(plan.ball, resolution=resolution))
    ways = [Contestant("clvox", partial(model.contains, points))]
    if caster is not None:
        scene = caster.scene(plan.ball.vertices, plan.ball.faces)
        query = caster.tensor(points.astype(np.float32))
        ways.append(Contestant("Open3D occupancy", partial(scene.compute_occupancy, query)))
    label = f"contains {count:,} points, bumpy_sphere at {resolution}"
    yield from _compare(plan, label, ways)


def streaming(plan: Plan) -> Iterator[Result]:
    """Passes over memory beside a plain copy of the same size, all on the device."""
    yield from compare_with_copy(
        plan.session,
        plan.ball,
        words=plan.pick(1 << 25, 1 << 10),
        resolution=plan.pick(4096, 64),
        repeats=plan.repeats,
    )


def frames(plan: Plan) -> Iterator[Result]:
    """A picture of 1920 x 1080 pixels, to the host; one ray a pixel but "as by default"."""
    size = plan.pick(pictures.SIZE, (32, 18))
    for resolution in plan.pick((1024, 4096), (32,)):
        model = clvox.voxelize(
            plan.ball,
            resolution=resolution,
            attributes=("normals",),
            device=plan.session.device,
        )
        label = f"frame {size[0]} x {size[1]}, bumpy_sphere at {resolution}"
        dense = resolution <= DENSE and not plan.quick
        ways = pictures.contestants(model, plan.ball, size, dense=dense)
        yield from _compare(plan, label, ways)


CASES: dict[str, Case] = {
    case.__name__: case
    for case in (
        *(solid, levels, balance, update, boolean, mesh, dexels, dexel_boolean, milling, scan),
        *(contains, streaming, frames),
    )
}
"""All cases, by name."""


def _compare(plan: Plan, case: str, contestants: list[Contestant]) -> list[Result]:
    """Compare as the plan says, with no device memory kept from earlier cases."""
    plan.session.free()
    return compare(case, contestants, repeats=plan.repeats)


def _voxelize(
    plan: Plan, surface: Surface, grid: clvox.Grid, levels: Any = None
) -> clvox.VoxelModel:
    """Voxelize what is checked already: `voxelize` checks nothing twice."""
    return clvox.voxelize(surface, grid=grid, levels=levels, device=plan.session.device)


def _edits(surface: Surface) -> Iterator[tuple[str, Surface, NDArray[np.intp]]]:
    """The mesh with a dent of about 1 % of its triangles, and with dents in as many, spread."""
    positions = np.array(surface.vertices)
    # About six triangles have a vertex in common, so of single vertices a sixth is enough.
    spread = np.zeros(len(positions), bool)
    spread[::300] = True
    heights = positions[:, 2]
    for where, moved in (
        ("in one place", heights > np.quantile(heights, 0.99)),
        ("all over", spread),
    ):
        dented = np.where(moved[:, None], 0.98 * positions, positions)
        changed = np.flatnonzero(moved[surface.faces].any(axis=1))
        yield where, check((dented, np.array(surface.faces))), changed


def _stages(model: clvox.VoxelModel) -> Mapping[str, float]:
    """What a model's report says, in numbers."""
    return {**model.report.seconds, "device MB": model.report.peak_nbytes / 1e6}


def _differing(theirs: NDArray[Any], ours: NDArray[np.bool_]) -> int:
    return int(np.count_nonzero(theirs.view(np.bool_) != ours))
