/*
 * query/look_up.cl: the voxels that hold some points.
 *
 * Host:       clvox/ops/query.py, look_up()
 * Reference:  clvox/reference/multilevel.py, contains() and classify()
 * Tests:      tests/kernels/test_query.py
 * Defines:    LEVELS, RULE, BRICK_X, BRICK_Y, BRICK_Z  (common/model.h)
 * Source:     G. Young, "Multi-level voxel representation for GPU-accelerated solid modeling",
 *             2017: membership in 2k - 1 look-ups for k levels.
 */
#include "common/model.h"

/* One work-item answers for one point.
 * voxels: (n, 3) int32, (i, j, k); a negative i means in no voxel.  answers: (n,) uint8. */
__kernel void look_up(
    const ulong n, const __global int *restrict voxels, MODEL_PARAMETERS,
    __global uchar *restrict answers)
{
    const ulong id = get_global_id(0);
    if (id >= n) return;
    const int3 voxel = vload3(id, voxels);
    answers[id] = voxel.x < 0 ? 0 : (uchar)read_voxel(MODEL_ARGUMENTS, voxel.x, voxel.y, voxel.z);
}
