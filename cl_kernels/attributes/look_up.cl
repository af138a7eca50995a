/*
 * attributes/look_up.cl: the normals and the triangles of the voxels that hold some points.
 *
 * Host:       clvox/ops/attributes.py, normals_of() and faces_of()
 * Reference:  clvox/reference/attributes.py
 * Tests:      tests/kernels/test_attributes.py
 * Defines:    LEVELS, BRICK_*, MIDDLE_*  of the model (common/bricks.h)
 */
#include "attributes/octahedral.h"
#include "attributes/touched.h"

/* One work-item answers for one point.
 * voxels: (n, 3) int32, a negative i means in no voxel.  packed: (touched voxels,) uint32.
 * found: (n,) uint32, packed normals, or NO_NORMAL. */
__kernel void find_normals(
    const ulong n, const __global int *restrict voxels, TOUCHED_PARAMETERS,
    const __global uint *restrict packed, __global uint *restrict found)
{
    const ulong id = get_global_id(0);
    if (id >= n) return;
    const Tree tree = TREE;
    const int x = voxels[3 * id], y = voxels[3 * id + 1], z = voxels[3 * id + 2];
    const uint cell = x < 0 ? UNTOUCHED : find_cell(tree, x, y, z);
    uint answer = NO_NORMAL;
    if (cell != UNTOUCHED) {
        const ulong bit = edge_bit(cell, x, y, z);
        if (LEVELS == 1 || edge[bit / 32] >> (bit % 32) & 1)
            answer = packed[touched_number(cell, edge, edge_rank, bit)];
    }
    found[id] = answer;
}

/* One work-item answers for one point.
 * offsets: (cells + 1,) uint64.  cells_of: (n,) uint32, the cell, or UNTOUCHED; counts: (n,)
 * uint32, its triangles. */
__kernel void count_faces(
    const ulong n, const __global int *restrict voxels, TOUCHED_PARAMETERS,
    const __global ulong *restrict offsets, __global uint *restrict cells_of,
    __global uint *restrict counts)
{
    const ulong id = get_global_id(0);
    if (id >= n) return;
    const Tree tree = TREE;
    const int x = voxels[3 * id], y = voxels[3 * id + 1], z = voxels[3 * id + 2];
    const uint cell = x < 0 ? UNTOUCHED : find_cell(tree, x, y, z);
    cells_of[id] = cell;
    counts[id] = cell == UNTOUCHED ? 0 : (uint)(offsets[(ulong)cell + 1] - offsets[cell]);
}

/* One work-item copies the row of one point.
 * starts: (n,) uint64, where it goes in `found`. */
__kernel void copy_faces(
    const ulong n, const __global uint *restrict cells_of, const __global uint *restrict counts,
    const __global ulong *restrict offsets, const __global int *restrict faces,
    const __global ulong *restrict starts, __global int *restrict found)
{
    const ulong id = get_global_id(0);
    if (id >= n || counts[id] == 0) return;
    const ulong from = offsets[cells_of[id]], to = starts[id];
    for (uint i = 0; i < counts[id]; ++i) found[to + i] = faces[from + i];
}
