/*
 * measure/count_blocks.cl: how many voxels are inside, in each block of them.
 *
 * A block is cut into parts of at most PART rows along y and along z, so that no work-item walks
 * through all of a large one.
 *
 * Host:       clvox/ops/measure.py, count_blocks()
 * Reference:  clvox/reference/measure.py, count_blocks()
 * Tests:      tests/kernels/test_count_blocks.py
 * Defines:    LEVELS, RULE = 0, BRICK_X, BRICK_Y, BRICK_Z  (common/model.h)
 *             PART  most rows of a part along y and along z: 64
 */
#include "common/index.h"
#include "common/model.h"
#include "common/rows.h"

/* Set bits of row (y, z) of voxels from x `low` to before `high`, in a dense grid. */
#if LEVELS == 1
static inline uint count_row(MODEL_READ, const int3 low, const int3 high)
{
    const __global uint *row = bricks + ((ulong)low.z * cells.y + low.y) * ((cells.x + 31) / 32);
    uint count = 0;
    for (int w = low.x / 32; w <= (high.x - 1) / 32; ++w) {
        uint bits = row[w];
        if (w == low.x / 32) bits &= 0xffffffffu << (low.x % 32);
        if (w == (high.x - 1) / 32) bits &= 0xffffffffu >> (31 - (high.x - 1) % 32);
        count += popcount(bits);
    }
    return count;
}
#endif

/* Voxels inside from `low` to before `high`: below 2^17 * PART * PART. */
static inline uint count_box(MODEL_READ, const int3 low, const int3 high)
{
    uint count = 0;
#if LEVELS == 1
    for (int z = low.z; z < high.z; ++z)
        for (int y = low.y; y < high.y; ++y)
            count += count_row(MODEL_ARGUMENTS, (int3)(low.x, y, z), high);
#else
    const int3 sides = (int3)(BRICK_X, BRICK_Y, BRICK_Z);
    const int3 first = low / sides, last = (high - 1) / sides;
    for (int z = first.z; z <= last.z; ++z)
        for (int y = first.y; y <= last.y; ++y)
            for (int x = first.x; x <= last.x; ++x) {
                const int3 corner = (int3)(x, y, z) * sides;
                const int3 from = max(low - corner, (int3)(0));
                const int3 to = min(high - corner, sides);
                const uint number = find_brick(cells, boundary, rank, x, y, z);
                if (number == NO_BRICK) {
                    const int3 size = to - from;
                    if (inside[cell_word(cells, x, y, z)] >> (x % 32) & 1)
                        count += (uint)size.x * size.y * size.z;
                    continue;
                }
                const __global uint *brick = bricks + (ulong)number * BRICK_WORDS;
                const ulong kept = (~0UL >> (64 - to.x)) & (~0UL << from.x);
                for (int row_z = from.z; row_z < to.z; ++row_z)
                    for (int row_y = from.y; row_y < to.y; ++row_y)
                        count += (uint)popcount(brick_row(brick, row_y, row_z) & kept);
            }
#endif
    return count;
}

/* One work-item counts one part of a block.
 * voxels, side: shape of the fine grid and of a block.  blocks: blocks (x, y, z) of this launch, the
 * first of which along z is `first_z`.  parts: parts of a block along y and along z.
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
    const int3 block = (int3)(x, y, first_z + (int)rest) * side.xyz;
    const int3 low = block + (int3)(0, part_y, part_z) * PART;
    const int3 end = (int3)(block.x + side.x, min(low.yz + PART, block.yz + side.yz));
    const int3 high = min(end, voxels.xyz);
    counts[id] = all(low < high) ? count_box(MODEL_ARGUMENTS, low, high) : 0;
}
