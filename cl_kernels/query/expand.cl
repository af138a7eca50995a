/*
 * query/expand.cl: a box of a model as bytes.
 *
 * Host:       clvox/ops/query.py, expand() and expand_cells()
 * Reference:  clvox/reference/multilevel.py
 * Tests:      tests/kernels/test_query.py
 * Defines:    LEVELS, RULE, BRICK_X, BRICK_Y, BRICK_Z  (common/model.h)
 *             RUN  voxels along x that one work-item expands
 */
#include "common/model.h"

/* One work-item expands RUN voxels of a row along x.
 * first: lowest voxel of the box (x, y, z); size: its sides.
 * out: (size.z, size.y, size.x) uint8. */
__kernel void expand(
    const int4 first, const int4 size, MODEL_PARAMETERS, __global uchar *restrict out)
{
    const uint runs = (size.x + RUN - 1) / RUN;
    const ulong id = get_global_id(0);
    if (id >= (ulong)runs * size.y * size.z) return;
    const int x = (int)(id % runs) * RUN;
    const int y = (int)(id / runs % size.y);
    const int z = (int)(id / runs / size.y);
    __global uchar *row = out + ((ulong)z * size.y + y) * size.x;
    for (int i = x; i < min(x + RUN, size.x); ++i)
        row[i] = (uchar)read_voxel(MODEL_ARGUMENTS, first.x + i, first.y + y, first.z + z);
}

#if LEVELS > 1

/* One work-item tells the state of one cell: 0 outside, 1 inside, 2 with a brick.
 * first: lowest cell of the box (x, y, z); size: its sides.
 * middle_level: 0 for cells of the coarse grid, 1 for those between it and the voxels.
 * out: (size.z, size.y, size.x) uint8. */
__kernel void expand_cells(
    const int4 first, const int4 size, const int middle_level, MODEL_PARAMETERS,
    __global uchar *restrict out)
{
    const ulong id = get_global_id(0);
    if (id >= (ulong)size.x * size.y * size.z) return;
    const int x = first.x + (int)(id % size.x);
    const int y = first.y + (int)(id / size.x % size.y);
    const int z = first.z + (int)(id / size.x / size.y);
    const ulong state = middle_level ? cell_state(MODEL_ARGUMENTS, x, y, z)
                                     : coarse_state(MODEL_ARGUMENTS, x, y, z);
    out[id] = state < CELL_OUTSIDE ? 2 : state == CELL_INSIDE;
}

#endif
