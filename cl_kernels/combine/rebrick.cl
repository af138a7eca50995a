/*
 * combine/rebrick.cl: the same voxels in bricks of another size, or in a dense grid.
 *
 * A cell of the result gets a brick only if its voxels really differ; so bricks of the same size
 * are compacted.
 *
 * Host:       clvox/ops/combine.py, rebrick()
 * Reference:  clvox/reference/multilevel.py, from_voxels()
 * Tests:      tests/kernels/test_combine.py
 * Defines:    LEVELS, RULE = 0, BRICK_X, BRICK_Y, BRICK_Z  of the source (common/model.h)
 *             NEW_X, NEW_Y, NEW_Z  sides of the result's bricks; 0 for a dense grid
 */
#include "common/index.h"
#include "common/model.h"

#define NEW_SIZE (NEW_X * NEW_Y * NEW_Z)

#if NEW_X == 0

/* One work-item writes one word of the dense grid.
 * voxels: shape.  dense: (z, y, words) bits, undefined on entry. */
__kernel void flatten(const int4 voxels, MODEL_PARAMETERS, __global uint *restrict dense)
{
    const int row_words = (voxels.x + 31) / 32;
    const ulong id = get_global_id(0);
    if (id >= (ulong)row_words * voxels.y * voxels.z) return;
    ulong rest = id;
    const int first = 32 * take_place(&rest, row_words);
    const int y = take_place(&rest, voxels.y);
    const int z = (int)rest;
    uint bits = 0;
    for (int lane = 0; lane < min(voxels.x - first, 32); ++lane)
        bits |= read_voxel(MODEL_ARGUMENTS, first + lane, y, z) << lane;
    dense[id] = bits;
}

#else

/* Do all source cells below a box of voxels agree, without a brick?  Spares looking at voxels. */
static inline bool agree(MODEL_READ, const int3 low, const int3 high)
{
#if LEVELS == 1
    return false;
#else
    const int3 brick = (int3)(BRICK_X, BRICK_Y, BRICK_Z);
    const int3 first = low / brick, last = high / brick;
    const uint state = inside[cell_word(cells, first.x, first.y, first.z)] >> (first.x % 32) & 1;
    for (int z = first.z; z <= last.z; ++z)
        for (int y = first.y; y <= last.y; ++y)
            for (int x = first.x; x <= last.x; ++x) {
                const ulong word = cell_word(cells, x, y, z);
                if (boundary[word] >> (x % 32) & 1) return false;
                if ((inside[word] >> (x % 32) & 1) != state) return false;
            }
    return true;
#endif
}

/* One work-item tells apart the 32 cells of one word of the result.
 * voxels: shape; counts: cells of the result.
 * mixed, solid: bits of the result's cells, undefined on entry. */
__kernel void rebrick_cells(
    const int4 voxels, const int4 counts, MODEL_PARAMETERS,
    __global uint *restrict mixed, __global uint *restrict solid)
{
    const int row_words = (counts.x + 31) / 32;
    const ulong id = get_global_id(0);
    if (id >= (ulong)row_words * counts.y * counts.z) return;
    ulong rest = id;
    const int first = 32 * take_place(&rest, row_words);
    const int y = take_place(&rest, counts.y);
    const int z = (int)rest;
    uint differ = 0, in = 0;
    for (int lane = 0; lane < min(counts.x - first, 32); ++lane) {
        const int3 low = (int3)(first + lane, y, z) * (int3)(NEW_X, NEW_Y, NEW_Z);
        const int3 high = min(low + (int3)(NEW_X, NEW_Y, NEW_Z), voxels.xyz) - 1;
        const uint state = read_voxel(MODEL_ARGUMENTS, low.x, low.y, low.z);
        bool same = true;
        if (!agree(MODEL_ARGUMENTS, low, high))
            for (int k = low.z; same && k <= high.z; ++k)
                for (int j = low.y; same && j <= high.y; ++j)
                    for (int i = low.x; same && i <= high.x; ++i)
                        same = read_voxel(MODEL_ARGUMENTS, i, j, k) == state;
        differ |= (uint)!same << lane;
        in |= (uint)(same && state) << lane;
    }
    mixed[id] = differ;
    solid[id] = in;
}

/* One work-item writes the bricks of the 32 cells of one word of the result.
 * mixed, ranks: of the result.  result: bricks, all words written. */
__kernel void rebrick_bricks(
    const int4 voxels, const int4 counts, MODEL_PARAMETERS,
    const __global uint *restrict mixed, const __global uint *restrict ranks,
    __global uint *restrict result)
{
    const int row_words = (counts.x + 31) / 32;
    const ulong id = get_global_id(0);
    if (id >= (ulong)row_words * counts.y * counts.z) return;
    if (!mixed[id]) return;
    ulong rest = id;
    const int first = 32 * take_place(&rest, row_words);
    const int y = take_place(&rest, counts.y);
    const int z = (int)rest;
    uint before = ranks[id / 8];
    for (ulong w = id & ~7UL; w < id; ++w) before += popcount(mixed[w]);
    __global uint *brick = result + (ulong)before * ((NEW_SIZE + 31) / 32);
    for (uint left = mixed[id]; left; left &= left - 1, brick += (NEW_SIZE + 31) / 32) {
        const int lane = popcount((left & -left) - 1);
        const int3 low = (int3)(first + lane, y, z) * (int3)(NEW_X, NEW_Y, NEW_Z);
        const int3 size = voxels.xyz - low;
        int i = 0, j = 0, k = 0;
        uint bits = 0;
        for (int voxel = 0; voxel < NEW_SIZE; ++voxel) {
            if (i < size.x && j < size.y && k < size.z)
                bits |= read_voxel(MODEL_ARGUMENTS, low.x + i, low.y + j, low.z + k)
                        << (voxel % 32);
            if (voxel % 32 == 31 || voxel == NEW_SIZE - 1) {
                brick[voxel / 32] = bits;
                bits = 0;
            }
            if (++i < NEW_X) continue;
            i = 0;
            if (++j < NEW_Y) continue;
            j = 0;
            ++k;
        }
    }
}

#endif
