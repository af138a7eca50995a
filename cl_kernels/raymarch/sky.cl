/*
 * raymarch/sky.cl: how full the space around each place is, for the shade in hollows.
 *
 * The share of each block of voxels that is inside, and blurred: what stands at a place above a
 * surface beyond the half that any plane hides is what hides the sky there.  Integers all the way.
 *
 * Host:       clvox/ops/sky.py
 * Reference:  clvox/reference/raymarch.py, block_shares() and blurred()
 * Tests:      tests/kernels/test_sky.py
 * Defines:    LEVELS, RULE, BRICK_*, MIDDLE_*  (common/model.h)
 *             MARGIN  empty blocks around the grid
 */
#include "raymarch/around.h"
#if LEVELS == 1
#include "common/index.h"
#endif

#pragma OPENCL FP_CONTRACT OFF

/* Voxels inside of the box from low to before high, which lies within the grid. */
static inline ulong count_in_box(MODEL_PARAMETERS, const int4 low, const int4 high)
{
    ulong sum = 0;
#if LEVELS == 1
    for (int z = low.z; z < high.z; ++z)
        for (int y = low.y; y < high.y; ++y)
            for (int x = low.x; x < high.x; x += 32)
                sum += popcount(row_bits(MODEL_ARGUMENTS, x, y, z, min(32, high.x - x)));
#else
    for (int k = low.z / BRICK_Z; k * BRICK_Z < high.z; ++k)
        for (int j = low.y / BRICK_Y; j * BRICK_Y < high.y; ++j)
            for (int i = low.x / BRICK_X; i * BRICK_X < high.x; ++i) {
                const ulong state = cell_state(MODEL_ARGUMENTS, i, j, k);
                if (state == CELL_OUTSIDE) continue;
                const int from_x = max(low.x - i * BRICK_X, 0);
                const int to_x = min(high.x - i * BRICK_X, BRICK_X);
                const int from_y = max(low.y - j * BRICK_Y, 0);
                const int to_y = min(high.y - j * BRICK_Y, BRICK_Y);
                const int from_z = max(low.z - k * BRICK_Z, 0);
                const int to_z = min(high.z - k * BRICK_Z, BRICK_Z);
                if (state == CELL_INSIDE) {
                    sum += (ulong)(to_x - from_x) * (to_y - from_y) * (to_z - from_z);
                    continue;
                }
                for (int z = from_z; z < to_z; ++z)
                    for (int y = from_y; y < to_y; ++y)
                        for (int x = from_x; x < to_x; x += 32)
                            sum += popcount(
                                cell_bits(bricks, state, x, y, z, min(32, to_x - x)));
            }
#endif
    return sum;
}

/* One work-item looks at one block.
 * blocks: shape of the grid of blocks, the margin included; side: voxels along a block's sides;
 * low, high: the voxels that count.
 * plane: what lies beyond it does not: blocks whose middle, in voxels, times the plane's first
 * three parts is farther than the fourth.
 * shares: (blocks,) uint8, 255 for a block all of which is inside. */
__kernel void share_out(
    const int4 blocks, const int4 side, const int4 low, const int4 high, const float4 plane,
    MODEL_PARAMETERS, __global uchar *restrict shares)
{
    const ulong id = get_global_id(0);
    ulong number = id;
    const int x = take_place(&number, blocks.x), y = take_place(&number, blocks.y);
    const int z = (int)number;
    if (z >= blocks.z) return;
    const int4 first = ((int4)(x, y, z, 0) - (int4)(MARGIN, MARGIN, MARGIN, 0)) * side;
    const int4 from = max(first, low), to = min(first + side, high);
    /* A block may have more than 2**32 voxels: 63 bits hold them, and 51 those of the grid. */
    ulong sum = 0;
    if (from.x < to.x && from.y < to.y && from.z < to.z)
        sum = count_in_box(MODEL_ARGUMENTS, from, to);
    const float height = plane.x * (first.x + 0.5f * side.x) + plane.y * (first.y + 0.5f * side.y)
                       + plane.z * (first.z + 0.5f * side.z);
    if (height > plane.w) sum = 0;
    const ulong all = (ulong)side.x * side.y * side.z;
    shares[id] = (uchar)((sum * 255 + all / 2) / all);
}

/* One work-item blurs one block along one axis, along which `count` blocks lie `apart`.
 * weights: (reach + 1,) int32, of a block and of those that far away; all of them, both sides
 * counted, are 65536. */
__kernel void blur(
    const int4 blocks, const int axis, const int reach, const __global int *restrict weights,
    const __global uchar *restrict given, __global uchar *restrict blurred)
{
    const ulong id = get_global_id(0);
    ulong number = id;
    const int x = take_place(&number, blocks.x), y = take_place(&number, blocks.y);
    const int z = (int)number;
    if (z >= blocks.z) return;
    const int at = axis == 0 ? x : (axis == 1 ? y : z);
    const int count = axis == 0 ? blocks.x : (axis == 1 ? blocks.y : blocks.z);
    const long apart = axis == 0 ? 1 : (axis == 1 ? (long)blocks.x : (long)blocks.x * blocks.y);
    int sum = 32768;
    for (int other = max(at - reach, 0); other <= min(at + reach, count - 1); ++other)
        sum += weights[abs(other - at)] * given[(long)id + (other - at) * apart];
    blurred[id] = (uchar)(sum >> 16);
}
