/*
 * query/expand.cl: a box of a model as bytes.
 *
 * Host:       clvox/ops/query.py, expand() and expand_cells()
 * Reference:  clvox/reference/multilevel.py
 * Tests:      tests/kernels/test_query.py
 * Defines:    LEVELS, RULE, BRICK_X, BRICK_Y, BRICK_Z  (common/model.h)
 *             RUN  voxels along x that one work-item expands
 */
#include "common/index.h"
#include "common/model.h"

/* `count` bytes, one for each of the lowest bits of `solid`, by the rule. */
static inline void spread(
    const uint solid, const uint touched, const int count, __global uchar *out)
{
    if (count == 8) {
        const uchar8 bit = (uchar8)(1, 2, 4, 8, 16, 32, 64, 128);
        const uchar8 in = ((uchar8)(uchar)solid & bit) != (uchar8)0 ? (uchar8)1 : (uchar8)0;
#if RULE == CENTRE
        vstore8(in, 0, out);
#else
        const uchar8 edge = ((uchar8)(uchar)touched & bit) != (uchar8)0 ? (uchar8)1 : (uchar8)0;
#if RULE == TOUCH
        vstore8(in | edge, 0, out);
#elif RULE == WITHIN
        vstore8(in & ~edge, 0, out);
#else
        vstore8(edge != (uchar8)0 ? (uchar8)2 : in, 0, out);
#endif
#endif
        return;
    }
    for (int i = 0; i < count; ++i)
        out[i] = (uchar)by_rule(solid >> i & 1, touched >> i & 1);
}

/* Up to 32 bits of a run of words. */
static inline uint bits_at(const __global uint *words, const ulong at, const int count)
{
    const ulong word = at / 32;
    const uint shift = at % 32;
    ulong pair = words[word];
    if (shift + count > 32) pair |= (ulong)words[word + 1] << 32;
    return (uint)(pair >> shift);
}

#if RULE == CENTRE
#define EDGE_BITS_AT(at, count) 0
#else
#define EDGE_BITS_AT(at, count) bits_at(edge, at, count)
#endif

/* Voxels from x on, at most `most`, that lie side by side in the model: their bits as bytes.
 * Returns how many. */
static inline int spread_some(
    MODEL_PARAMETERS, const int x, const int y, const int z, const int most, __global uchar *out)
{
#if LEVELS == 1
    const int count = min(most, 8 - x % 8);
    const ulong at = (((ulong)z * cells.y + y) * ((cells.x + 31) / 32)) * 32 + x;
    spread(bits_at(bricks, at, count), EDGE_BITS_AT(at, count), count, out);
#else
    const int within = place_in(x, BRICK_X);
    const ulong state = cell_state(MODEL_ARGUMENTS, x / BRICK_X, y / BRICK_Y, z / BRICK_Z);
    const int left = min(most, BRICK_X - within);
    const int count = BRICK_X == 8 ? left : min(left, 8);
    if (state >= CELL_OUTSIDE) {
        spread(state == CELL_INSIDE ? 0xff : 0, 0, count, out);
    } else {
        const int row
            = (place_in(z, BRICK_Z) * BRICK_Y + place_in(y, BRICK_Y)) * BRICK_X + within;
        const ulong at = state * (32 * BRICK_WORDS) + row;
        spread(bits_at(bricks, at, count), EDGE_BITS_AT(at, count), count, out);
    }
#endif
    return count;
}

/* One work-item expands RUN voxels of a row along x.
 * first: lowest voxel of the box (x, y, z); size: its sides.
 * out: (size.z, size.y, size.x) uint8. */
__kernel void expand(
    const int4 first, const int4 size, MODEL_PARAMETERS, __global uchar *restrict out)
{
    const uint runs = (size.x + RUN - 1) / RUN;
    const ulong id = get_global_id(0);
    if (id >= (ulong)runs * size.y * size.z) return;
    ulong number = id;
    const int run = take_place(&number, runs);
    const int y = take_place(&number, size.y);
    const int z = (int)number;
    __global uchar *row = out + ((ulong)z * size.y + y) * size.x;
    const int stop = min((run + 1) * RUN, size.x);
    for (int x = run * RUN; x < stop;)
        x += spread_some(
            MODEL_ARGUMENTS, first.x + x, first.y + y, first.z + z, stop - x, row + x);
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
    ulong number = id;
    const int x = first.x + take_place(&number, size.x);
    const int y = first.y + take_place(&number, size.y);
    const int z = first.z + (int)number;
    const ulong state = middle_level ? cell_state(MODEL_ARGUMENTS, x, y, z)
                                     : coarse_state(MODEL_ARGUMENTS, x, y, z);
    out[id] = state < CELL_OUTSIDE ? 2 : state == CELL_INSIDE;
}

#endif
