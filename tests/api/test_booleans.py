"""Combinations of models: what must hold whatever their bricks, and what is refused."""

from __future__ import annotations

import operator
import pickle
from collections.abc import Callable
from typing import Any, cast

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from clvox import Grid, GridError, MeshError, VoxelModel, voxelize
from clvox.device import Session
from clvox.models.levels import Levels

GRID = Grid((-1.0, 2.0, 0.5), (0.5, 0.25, 1.0), (37, 26, 19))

LEVELS: list[Levels] = [
    [GRID.shape],
    [(5, 4, 3), (8, 8, 8)],
    [(37, 13, 7), (1, 2, 3)],
    [(1, 6, 10), (40, 5, 2)],
    [(3, 4, 2), (4, 2, 3), (4, 4, 4)],
]
"""Dense, in bricks, and in bricks of bricks that do not divide the grid."""

OPERATORS: list[Callable[[Any, Any], Any]] = [
    operator.or_,
    operator.and_,
    operator.xor,
    lambda a, b: a & ~b,
]


def voxels(seed: int) -> NDArray[np.bool_]:
    """A few boxes, with noise in one of them; [z, y, x]."""
    rng = np.random.default_rng(seed)
    found = np.zeros(GRID.array_shape, np.bool_)
    for _ in range(4):
        low, high = np.sort(rng.integers(0, np.array(GRID.array_shape) + 1, (2, 3)), axis=0)
        box = tuple(slice(a, b) for a, b in zip(low, high, strict=True))
        found[box] ^= True
    found[box] ^= rng.random(found[box].shape) < 0.5
    return found


def model(seed: int, levels: int = 1) -> VoxelModel:
    return VoxelModel.from_array(voxels(seed), GRID, levels=LEVELS[levels])


def cube(low: float, high: float) -> trimesh.Trimesh:
    mesh: trimesh.Trimesh = trimesh.creation.box(bounds=[[low] * 3, [high] * 3])
    return mesh


@pytest.mark.parametrize("first", range(len(LEVELS)))
@pytest.mark.parametrize("second", range(len(LEVELS)))
def test_laws(first: int, second: int) -> None:
    """De Morgan, absorption and the rest of the algebra, exactly, across sizes of bricks."""
    a, b = model(1, first), model(2, second)
    nothing, everything = a - a, a | ~a
    assert nothing.count == 0
    assert everything.count == GRID.size
    assert ~(a | b) == ~a & ~b
    assert ~(a & b) == ~a | ~b
    assert a | (a & b) == a
    assert a & (a | b) == a
    assert a - b == a & ~b
    assert a ^ b == (a | b) - (a & b)
    assert ~~a == a
    assert (a ^ b) ^ b == a
    assert (a | b).count + (a & b).count == a.count + b.count
    assert (a != b) == bool((voxels(1) != voxels(2)).any())


@pytest.mark.parametrize("seed", range(6))
def test_trees_of_operations(seed: int) -> None:
    """Random expressions equal the same expressions of arrays."""
    rng = np.random.default_rng(seed)
    known = [(model(s, s % len(LEVELS)), voxels(s)) for s in range(10 * seed, 10 * seed + 4)]
    for _ in range(12):
        (a, x), (b, y) = (known[int(rng.integers(len(known)))] for _ in range(2))
        chosen = int(rng.integers(6))
        if chosen == 4:
            found, expected = ~a, ~x
        elif chosen == 5:
            found, expected = a.compact(), x
        else:
            # OPERATORS[3] is the difference, which booleans of NumPy do not have.
            found = a - b if chosen == 3 else OPERATORS[chosen](a, b)
            expected = OPERATORS[chosen](x, y)
        known.append((found, expected))
    for found, expected in known[4:]:
        assert found.count == expected.sum()
        assert (found.to_array() == expected).all()


def test_results_answer_like_any_model() -> None:
    """Questions, measures, meshes and pickles, of a model that two meshes became."""
    grid = Grid((0.0, 0.0, 0.0), 0.5, (21, 20, 19))
    one, other = cube(1.3, 6.2), cube(3.4, 8.1)
    a = voxelize(one, grid=grid, lattice_bits=12)
    b = voxelize(other, grid=grid, lattice_bits=12, levels=[(5, 4, 4), (5, 5, 5)])
    found = a - b
    low, high = found.volume_bounds
    assert low < 4.9**3 - 2.8**3 < high
    points = np.array([[2.0, 2.0, 2.0], [5.0, 5.0, 5.0], [7.0, 7.0, 7.0], [-1.0, 2.0, 2.0]])
    assert found.contains(points).tolist() == [True, False, False, False]
    assert found.classify([[3.45, 5.0, 5.0], [2.0, 2.0, 2.0]]).tolist() == [2, 1]
    mesh = found.to_mesh()
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(found.volume, rel=0.05)
    again = pickle.loads(pickle.dumps(found))  # noqa: S301
    assert again == found
    assert again.volume_bounds == (low, high)
    assert found.to_array(rule="within").sum() < found.count < found.to_array(rule="touch").sum()


def test_touched_voxels_are_unknown_if_one_operand_has_no_mesh() -> None:
    """Half of the answer would be wrong."""
    a = voxelize(cube(0.0, 5.0), grid=GRID)
    assert (a | a).volume_bounds[1] > 0
    with pytest.raises(MeshError, match="known to be touched"):
        _ = (a | model(3)).volume_bounds


def test_union_of_disjoint_boxes_is_the_model_of_both() -> None:
    """Meshes put together, and models put together."""
    grid = Grid((0.0, 0.0, 0.0), 0.5, (24, 24, 24))
    parts = [cube(0.6, 4.1), cube(4.9, 7.0), cube(8.0, 11.9)]
    joined = trimesh.util.concatenate(parts)
    whole = voxelize(cast("trimesh.Trimesh", joined), grid=grid, lattice_bits=12)
    one, two, three = (voxelize(part, grid=grid, lattice_bits=12) for part in parts)
    assert one | two | three == whole
    assert (one ^ two ^ three).volume_bounds == pytest.approx(whole.volume_bounds)
    assert (whole - two).compact() == one | three


def test_a_thousand_operations_keep_memory_bounded(session: Session) -> None:
    """What is no longer needed is used again, and bricks do not pile up."""
    rng = np.random.default_rng(5)
    models = [model(s) for s in range(5)]
    arrays = [voxels(s) for s in range(5)]
    held, blocks, found = [], [], models[0]
    expected = arrays[0]
    for step in range(1000):
        at, chosen = int(rng.integers(5)), int(rng.integers(4))
        found = found - models[at] if chosen == 3 else OPERATORS[chosen](found, models[at])
        expected = OPERATORS[chosen](expected, arrays[at])
        if step % 50 == 49:
            session.finish()
            held.append(session.nbytes)
            blocks.append(session.blocks)
    assert (found.to_array() == expected).all()
    # A result has at most a brick for each of the 60 cells, 64 bytes each, beside its cells.
    most = 60 * 64 + 4096
    assert max(held) <= held[0] + most
    # Blocks are kept by size, and sizes still turn up; each operation needs several blocks.
    assert blocks[-1] < blocks[0] + 100


def test_other_grid_is_refused() -> None:
    """The message names both."""
    a = model(1)
    moved = Grid((-1.5, 2.0, 0.5), GRID.spacing, GRID.shape)
    b = VoxelModel.from_array(voxels(1), moved)
    for combined in (operator.or_, operator.and_, operator.sub, operator.xor):
        with pytest.raises(GridError) as failure:
            combined(a, b)
        assert str(a.grid) in str(failure.value)
        assert str(b.grid) in str(failure.value)
    assert a != b


def test_other_lattice_is_refused() -> None:
    """The message names the grid and both lattices."""
    a, b = (voxelize(cube(0.0, 5.0), grid=GRID, lattice_bits=bits) for bits in (8, 11))
    with pytest.raises(GridError, match="8 and 11") as failure:
        _ = a | b
    assert str(GRID) in str(failure.value)


def test_only_models_are_combined() -> None:
    """Anything else is a mistake that Python reports."""
    with pytest.raises(TypeError, match="unsupported operand"):
        _ = model(1) | voxels(1).tolist()
    assert model(1) != 1
