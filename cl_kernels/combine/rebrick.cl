/*
 * combine/rebrick.cl: the same voxels in bricks of another size, or in a dense grid.
 *
 * With PRUNE a cell of the result gets a brick only if its voxels really differ; so bricks of the
 * same size are compacted.
 *
 * Host:       clvox/ops/combine.py, rebrick()
 * Reference:  clvox/reference/multilevel.py, from_voxels()
 * Tests:      tests/kernels/test_combine.py
 * Defines:    LEVELS, RULE = 0, BRICK_*, MIDDLE_*  of the source (common/model.h)
 *             PRUNE  1: bricks whose voxels are all alike are left out; 0: kept
 *             NEW_X, NEW_Y, NEW_Z        sides of the result's cells in voxels; 0: a dense grid
 *             ABOVE_X, ABOVE_Y, ABOVE_Z  cells along the sides of the result's bricks of cells
 */
#include "common/index.h"
#include "common/model.h"


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

#define DIFFER 2

#if LEVELS == 1 || PRUNE

/* State of a box of voxels, looked at one by one: that of all of them, or DIFFER. */
static inline uint state_of_voxels(MODEL_PARAMETERS, const int3 low, const int3 high)
{
    const uint state = read_voxel(MODEL_ARGUMENTS, low.x, low.y, low.z);
    for (int z = low.z; z <= high.z; ++z)
        for (int y = low.y; y <= high.y; ++y)
            for (int x = low.x; x <= high.x; ++x)
                if (read_voxel(MODEL_ARGUMENTS, x, y, z) != state) return DIFFER;
    return state;
}

#endif

/* State of a box of voxels: that of all of them, or DIFFER.  Without PRUNE it is DIFFER too where
 * the source has a brick, since a triangle may touch voxels that are all alike. */
static inline uint state_of(MODEL_PARAMETERS, const int3 low, const int3 high)
{
#if LEVELS == 1
    return state_of_voxels(MODEL_ARGUMENTS, low, high);
#else
    const int3 brick = (int3)(BRICK_X, BRICK_Y, BRICK_Z);
    const int3 first = low / brick, last = high / brick;
    uint seen = 0;  /* bit 0: cells outside, bit 1: inside, bit 2: with a brick */
    for (int z = first.z; z <= last.z; ++z)
        for (int y = first.y; y <= last.y; ++y)
            for (int x = first.x; x <= last.x; ++x) {
                const ulong state = cell_state(MODEL_ARGUMENTS, x, y, z);
                seen |= state < CELL_OUTSIDE ? 4 : state == CELL_INSIDE ? 2 : 1;
            }
    if (seen <= 2) return seen - 1;
#if PRUNE
    if (seen >= 4) return state_of_voxels(MODEL_ARGUMENTS, low, high);
#endif
    return DIFFER;
#endif
}

/* One work-item tells apart the 32 cells of one word of the result's coarse grid.
 * voxels: shape of the fine grid; counts: cells of NEW_* voxels.
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
    const int3 sides = (int3)(NEW_X, NEW_Y, NEW_Z);
    uint differ = 0, in = 0;
    for (int lane = 0; lane < min(counts.x - first, 32); ++lane) {
        const int3 low = (int3)(first + lane, y, z) * sides;
        const uint state = state_of(MODEL_ARGUMENTS, low, min(low + sides, voxels.xyz) - 1);
        differ |= (state >> 1) << lane;
        in |= (state & 1) << lane;
    }
    mixed[id] = differ;
    solid[id] = in;
}

/* One work-item tells apart the 32 cells of NEW_* voxels of one word of the result's bricks of
 * ABOVE_* cells.
 * owners: (bricks, 3) int32, the coarse cell of each brick. */
__kernel void rebrick_middle(
    const ulong words, const int4 voxels, const __global int *restrict owners, MODEL_PARAMETERS,
    __global uint *restrict mixed, __global uint *restrict solid)
{
    const ulong id = get_global_id(0);
    if (id >= words) return;
    const int brick_words = (ABOVE_X * ABOVE_Y * ABOVE_Z + 31) / 32;
    ulong brick = id;
    const int first = 32 * take_place(&brick, brick_words);
    const int3 corner = vload3(brick, owners) * (int3)(ABOVE_X, ABOVE_Y, ABOVE_Z);
    const int3 sides = (int3)(NEW_X, NEW_Y, NEW_Z);
    uint differ = 0, in = 0;
    for (int lane = 0; lane < min(ABOVE_X * ABOVE_Y * ABOVE_Z - first, 32); ++lane) {
        ulong rest = first + lane;
        const int x = take_place(&rest, ABOVE_X);
        const int y = take_place(&rest, ABOVE_Y);
        const int3 low = (corner + (int3)(x, y, (int)rest)) * sides;
        if (any(low >= voxels.xyz)) continue;
        const uint state = state_of(MODEL_ARGUMENTS, low, min(low + sides, voxels.xyz) - 1);
        differ |= (state >> 1) << lane;
        in |= (state & 1) << lane;
    }
    mixed[id] = differ;
    solid[id] = in;
}

/* One work-item writes one word of one of the result's bricks of NEW_* voxels.
 * owners: (bricks, 3) int32, the cell of each brick.  result: undefined on entry. */
__kernel void rebrick_voxels(
    const ulong words, const int4 voxels, const __global int *restrict owners, MODEL_PARAMETERS,
    __global uint *restrict result)
{
    const ulong id = get_global_id(0);
    if (id >= words) return;
    const int size = NEW_X * NEW_Y * NEW_Z;
    const int brick_words = (size + 31) / 32;
    ulong brick = id;
    const int first = 32 * take_place(&brick, brick_words);
    const int3 low = vload3(brick, owners) * (int3)(NEW_X, NEW_Y, NEW_Z);
    uint bits = 0;
    for (int lane = 0; lane < min(size - first, 32); ++lane) {
        ulong rest = first + lane;
        const int x = low.x + take_place(&rest, NEW_X);
        const int y = low.y + take_place(&rest, NEW_Y);
        const int z = low.z + (int)rest;
        if (x < voxels.x && y < voxels.y && z < voxels.z)
            bits |= read_voxel(MODEL_ARGUMENTS, x, y, z) << lane;
    }
    result[id] = bits;
}

#endif
