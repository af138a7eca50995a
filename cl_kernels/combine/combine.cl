/*
 * combine/combine.cl: union, intersection, difference and symmetric difference of two models.
 *
 * Both have one grid and the same levels.  Cells are decided by words of 32: a cell of the result
 * has a brick only if it may be mixed; its boundary may exceed the true one, and never misses.
 *
 * Host:       clvox/ops/combine.py
 * Reference:  numpy.logical_or, logical_and, logical_xor of the voxels
 * Tests:      tests/kernels/test_combine.py
 * Defines:    OP  0: union, 1: intersection, 2: difference, 3: symmetric difference
 *             LEVELS, RULE = 0, BRICK_*, MIDDLE_*  of the models (common/model.h)
 */
#include "common/index.h"
#include "common/model.h"

#define UNION 0
#define INTERSECTION 1
#define DIFFERENCE 2
#define XOR 3

static inline uint combine_bits(const uint a, const uint b)
{
#if OP == UNION
    return a | b;
#elif OP == INTERSECTION
    return a & b;
#elif OP == DIFFERENCE
    return a & ~b;
#else
    return a ^ b;
#endif
}

#if LEVELS == 1

/* One work-item combines one word of two dense grids.
 * a, b: bits; result: undefined on entry. */
__kernel void combine_words(
    const ulong words, const __global uint *restrict a, const __global uint *restrict b,
    __global uint *restrict result)
{
    const ulong id = get_global_id(0);
    if (id >= words) return;
    result[id] = combine_bits(a[id], b[id]);
}

#else

/* Cells with a brick (x) and cells inside (y) of the result, from those of the operands. */
static inline uint2 combine_states(const uint2 a, const uint2 b)
{
#if OP == XOR
    return (uint2)(a.x | b.x, (a.y ^ b.y) & ~(a.x | b.x));
#elif OP == UNION
    return (uint2)((a.x | b.x) & ~(a.y | b.y), a.y | b.y);
#else
#if OP == DIFFERENCE
    /* Intersection with the complement of b; padding is outside of a, so it stays out. */
    const uint kept = ~b.y & ~b.x;
#else
    const uint kept = b.y;
#endif
    return (uint2)((a.x | b.x) & (a.x | a.y) & (b.x | kept), a.y & kept);
#endif
}

/* One work-item decides the 32 cells of one word of the coarse grid.
 * mixed_a, inside_a, mixed_b, inside_b: bits of the operands' cells, with a brick and wholly in.
 * mixed, solid: bits of the result's cells, undefined on entry. */
__kernel void combine_cells(
    const ulong words,
    const __global uint *restrict mixed_a, const __global uint *restrict inside_a,
    const __global uint *restrict mixed_b, const __global uint *restrict inside_b,
    __global uint *restrict mixed, __global uint *restrict solid)
{
    const ulong id = get_global_id(0);
    if (id >= words) return;
    const uint2 state = combine_states((uint2)(mixed_a[id], inside_a[id]),
                                       (uint2)(mixed_b[id], inside_b[id]));
    mixed[id] = state.x;
    solid[id] = state.y;
}

/* Bits of word `w` of a brick with sides `sides` that lie within `kept` of them. */
static inline uint real_bits(const int w, const int3 sides, const int3 kept)
{
    if (all(kept == sides)) {
        const int bits = sides.x * sides.y * sides.z - 32 * w;
        return bits >= 32 ? 0xffffffffu : (1u << bits) - 1u;
    }
    uint bits = 0;
    for (int bit = 0; bit < 32; ++bit) {
        ulong rest = 32 * w + bit;
        const int x = take_place(&rest, sides.x);
        const int y = take_place(&rest, sides.y);
        if (x < kept.x && y < kept.y && (int)rest < kept.z) bits |= 1u << bit;
    }
    return bits;
}

/* Word of a cell: of its brick, or all alike. */
static inline uint word_of(
    const ulong state, const __global uint *bricks, const int brick_words, const int w,
    const uint real)
{
    if (state < CELL_OUTSIDE) return bricks[state * brick_words + w];
    return state == CELL_INSIDE ? real : 0;
}

#if LEVELS == 2
#define PARAMETERS_OF(M) \
    const __global uint *restrict boundary_##M, const __global uint *restrict rank_##M, \
    const __global uint *restrict inside_##M, const __global uint *restrict bricks_##M
#define STATE_OF(M, x, y, z) \
    cell_state(cells, boundary_##M, rank_##M, inside_##M, bricks_##M, bricks_##M, x, y, z)
#else
#define PARAMETERS_OF(M) \
    const __global uint *restrict boundary_##M, const __global uint *restrict rank_##M, \
    const __global uint *restrict middle_##M, const __global uint *restrict middle_rank_##M, \
    const __global uint *restrict inside_##M, const __global uint *restrict middle_inside_##M, \
    const __global uint *restrict bricks_##M
#define ARGUMENTS_OF(M) \
    cells, boundary_##M, rank_##M, middle_##M, middle_rank_##M, inside_##M, middle_inside_##M, \
    bricks_##M, bricks_##M
#define STATE_OF(M, x, y, z) cell_state(ARGUMENTS_OF(M), x, y, z)

/* One work-item decides the 32 cells of one word of the result's bricks of cells.
 * shape: of the grid of those cells.  owners: (bricks, 3) int32, the coarse cell of each brick.
 * mixed, solid: bits of those cells, undefined on entry. */
__kernel void combine_middle(
    const ulong words, const int4 shape, const int4 cells, const __global int *restrict owners,
    PARAMETERS_OF(a), PARAMETERS_OF(b),
    __global uint *restrict mixed, __global uint *restrict solid)
{
    const ulong id = get_global_id(0);
    if (id >= words) return;
    ulong brick = id;
    const int w = take_place(&brick, MIDDLE_WORDS);
    const int3 at = vload3(brick, owners);
    const int3 sides = (int3)(MIDDLE_X, MIDDLE_Y, MIDDLE_Z);
    const uint real = real_bits(w, sides, min(shape.xyz - at * sides, sides));
    const ulong a = coarse_state(ARGUMENTS_OF(a), at.x, at.y, at.z);
    const ulong b = coarse_state(ARGUMENTS_OF(b), at.x, at.y, at.z);
    const uint2 state = combine_states(
        (uint2)(a < CELL_OUTSIDE ? middle_a[a * MIDDLE_WORDS + w] : 0,
                word_of(a, middle_inside_a, MIDDLE_WORDS, w, real)),
        (uint2)(b < CELL_OUTSIDE ? middle_b[b * MIDDLE_WORDS + w] : 0,
                word_of(b, middle_inside_b, MIDDLE_WORDS, w, real)));
    mixed[id] = state.x & real;
    solid[id] = state.y & real;
}

#endif

/* One work-item writes one word of one of the result's bricks of voxels.
 * voxels: shape of the fine grid.  owners: (bricks, 3) int32, the cell of each brick.
 * result: (bricks, words) uint32, undefined on entry. */
__kernel void combine_bricks(
    const ulong words, const int4 voxels, const int4 cells, const __global int *restrict owners,
    PARAMETERS_OF(a), PARAMETERS_OF(b), __global uint *restrict result)
{
    const ulong id = get_global_id(0);
    if (id >= words) return;
    ulong brick = id;
    const int w = take_place(&brick, BRICK_WORDS);
    const int3 at = vload3(brick, owners);
    const int3 sides = (int3)(BRICK_X, BRICK_Y, BRICK_Z);
    const uint real = real_bits(w, sides, min(voxels.xyz - at * sides, sides));
    result[id] = combine_bits(
        word_of(STATE_OF(a, at.x, at.y, at.z), bricks_a, BRICK_WORDS, w, real),
        word_of(STATE_OF(b, at.x, at.y, at.z), bricks_b, BRICK_WORDS, w, real));
}

#endif
