/*
 * measure/count_blocks.cl: how many voxels are inside, in each block of them.
 *
 * A block is cut into parts of at most PART rows along y and along z, so that no work-item walks
 * through all of a large one.
 *
 * Host:       clvox/ops/measure.py, count_blocks()
 * Reference:  clvox/reference/measure.py, count_blocks()
 * Tests:      tests/kernels/test_count_blocks.py
 * Defines:    LEVELS, RULE = 0, BRICK_*, MIDDLE_*  (common/model.h)
 *             PART  most rows of a part along y and along z: 64
 */
#include "common/index.h"
#include "common/model.h"
#include "common/rows.h"

/* Set bits of row (y, z) of voxels from x `low` to before `high`, in a dense grid. */
#if LEVELS == 1
static inline uint count_row(MODEL_PARAMETERS, const int3 low, const int3 high)
{
    const __global uint *row = bricks + ((ulong)low.z * cells.y + low.y) * ((cells.x + 31) / 32);
    const uint first = low.x, last = high.x - 1;
    uint count = 0;
    for (uint w = first / 32; w <= last / 32; ++w) {
        uint bits = row[w];
        if (w == first / 32) bits &= 0xffffffffu << (first % 32);
        if (w == last / 32) bits &= 0xffffffffu >> (31 - last % 32);
        count += popcount(bits);
    }
    return count;
}
#endif

/* Voxels inside from `low` to before `high`: below 2^17 * PART * PART. */
static inline uint count_box(MODEL_PARAMETERS, const int3 low, const int3 high)
{
    uint count = 0;
#if LEVELS == 1
    for (int z = low.z; z < high.z; ++z)
        for (int y = low.y; y < high.y; ++y)
            count += count_row(MODEL_ARGUMENTS, (int3)(low.x, y, z), high);
#else
    for (int z = low.z / BRICK_Z; z * BRICK_Z < high.z; ++z)
        for (int y = low.y / BRICK_Y; y * BRICK_Y < high.y; ++y)
            for (int x = low.x / BRICK_X; x * BRICK_X < high.x; ++x) {
                const int x0 = max(low.x - x * BRICK_X, 0), x1 = min(high.x - x * BRICK_X, BRICK_X);
                const int y0 = max(low.y - y * BRICK_Y, 0), y1 = min(high.y - y * BRICK_Y, BRICK_Y);
                const int z0 = max(low.z - z * BRICK_Z, 0), z1 = min(high.z - z * BRICK_Z, BRICK_Z);
                const ulong number = cell_state(MODEL_ARGUMENTS, x, y, z);
                if (number >= CELL_OUTSIDE) {
                    if (number == CELL_INSIDE)
                        count += (uint)(x1 - x0) * (y1 - y0) * (z1 - z0);
                    continue;
                }
                const __global uint *brick = bricks + number * BRICK_WORDS;
                const ulong kept = (~0UL >> (64 - x1)) & (~0UL << x0);
                for (int row_z = z0; row_z < z1; ++row_z)
                    for (int row_y = y0; row_y < y1; ++row_y)
                        count += (uint)popcount(
                            brick_row(brick, BRICK_X, BRICK_Y, row_y, row_z) & kept);
            }
#endif
    return count;
}

/* One work-item counts one part of a block.
 * voxels, side: shape of the fine grid and of a block.
 * blocks: blocks (x, y, z) of this launch, the first of which along z is `first_z`.
 * parts: parts of a block along y and along z.
 * counts: (blocks.z, parts.z, blocks.y, parts.y, blocks.x) uint32. */
__kernel void count_blocks(
    const int4 voxels, const int4 side, const int4 blocks, const int first_z, const int2 parts,
    MODEL_PARAMETERS, __global uint *restrict counts)
{
    const ulong id = get_global_id(0);
    if (id >= (ulong)blocks.x * parts.x * blocks.y * parts.y * blocks.z) return;
    ulong rest = id;
    const int x = take_place(&rest, blocks.x);
    const int part_y = take_place(&rest, parts.x);
    const int y = take_place(&rest, blocks.y);
    const int part_z = take_place(&rest, parts.y);
    const int z = first_z + (int)rest;
    const int3 low = (int3)(x * side.x, y * side.y + part_y * PART, z * side.z + part_z * PART);
    const int3 high = (int3)(min((x + 1) * side.x, voxels.x),
                             min(min(low.y + PART, (y + 1) * side.y), voxels.y),
                             min(min(low.z + PART, (z + 1) * side.z), voxels.z));
    const bool some = low.y < high.y && low.z < high.z;
    counts[id] = some ? count_box(MODEL_ARGUMENTS, low, high) : 0;
}
