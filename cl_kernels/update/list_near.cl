/*
 * update/list_near.cl: the triangles that may touch one of some marked cells.
 *
 * Where a triangle left a cell, another one may still touch it.  Only those near the cells that
 * were left need to be marked again, and most triangles are ruled out by their box alone.
 *
 * Host:       clvox/ops/update.py, list_near()
 * Reference:  clvox/reference/update.py, list_near()
 * Tests:      tests/kernels/test_update.py
 * Defines:    STEP_BITS               log2 of the lattice steps in one voxel
 *             CELL_X, CELL_Y, CELL_Z  sides of a cell, in voxels
 *             MOST                    cells of a box that are looked at; larger boxes are listed
 */
#include "boundary/overlap.h"

/* Whether one of two cells of a row, which may be the same, is marked. */
static inline uint row_meets(const __global uint *row, const int first, const int last)
{
    return (row[first / 32] >> (first % 32) | row[last / 32] >> (last % 32)) & 1;
}

/* One work-item looks at one triangle.
 * first, last: corners, on the lattice, of a box that holds all marked cells.
 * grid: shape of the grid of cells.
 * faces: (m, 3) int32, vertices: (3 n + 1,) int32, on the lattice.
 * marks: a bit per cell, rows padded to words.
 * listed: (1,) uint32, zero on entry: how many are on the list.
 * list: (m, 3) int32, the vertex numbers of those triangles, in no particular order. */
__kernel void list_near(
    const ulong count, const int4 first, const int4 last, const int4 grid,
    const __global int *restrict faces, const __global int *restrict vertices,
    const __global uint *restrict marks, __global uint *listed, __global int *restrict list)
{
    const ulong triangle = get_global_id(0);
    if (triangle >= count) return;
    const int3 numbers = vload3(triangle, faces);
    const int3 a = load_corner(vertices, numbers.x);
    const int3 b = load_corner(vertices, numbers.y);
    const int3 c = load_corner(vertices, numbers.z);
    const int3 low = min(min(a, b), c);
    const int3 high = max(max(a, b), c);
    if (any(low > last.xyz) || any(high < first.xyz)) return;
    const int3 from = max(first_cell_of(low), (int3)(0));
    const int3 to = min(last_cell_of(high), grid.xyz - 1);
    if (to.x < from.x || to.y < from.y || to.z < from.z) return;
    const int3 sides = to - from + 1;
    const int row_words = (grid.x + 31) / 32;
    bool near = (ulong)sides.x * sides.y * sides.z > MOST;
    if (all(sides <= 2)) {
        /* Nearly all triangles of a fine mesh: without a loop. */
        const ulong low_z = (ulong)from.z * grid.y, high_z = (ulong)to.z * grid.y;
        near = row_meets(marks + (low_z + from.y) * row_words, from.x, to.x)
            | row_meets(marks + (low_z + to.y) * row_words, from.x, to.x)
            | row_meets(marks + (high_z + from.y) * row_words, from.x, to.x)
            | row_meets(marks + (high_z + to.y) * row_words, from.x, to.x);
    } else {
        for (int z = from.z; z <= to.z && !near; ++z)
            for (int y = from.y; y <= to.y && !near; ++y)
                for (int x = from.x; x <= to.x && !near; ++x)
                    near = marks[((ulong)z * grid.y + y) * row_words + x / 32] >> (x % 32) & 1;
    }
    if (near) vstore3(numbers, (ulong)atomic_inc(listed), list);
}
