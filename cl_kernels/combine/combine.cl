/*
 * combine/combine.cl: union, intersection, difference and symmetric difference of two models.
 *
 * Both have one grid and one size of brick.  Cells are decided by words of 32: a cell of the result
 * has a brick only if it may be mixed; its boundary may exceed the true one, and never misses.
 *
 * Host:       clvox/ops/combine.py
 * Reference:  numpy.logical_or, logical_and, logical_xor of the voxels
 * Tests:      tests/kernels/test_combine.py
 * Defines:    OP  0: union, 1: intersection, 2: difference, 3: symmetric difference
 *             BRICK_X, BRICK_Y, BRICK_Z  voxels along the sides of a brick; 1 for dense grids
 */
#include "common/bricks.h"
#include "common/index.h"

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

/* One work-item decides the 32 cells of one word.
 * mixed_a, inside_a, mixed_b, inside_b: bits of the operands' cells, with a brick and wholly in.
 * mixed, inside: bits of the result's cells, undefined on entry. */
__kernel void combine_cells(
    const ulong words,
    const __global uint *restrict mixed_a, const __global uint *restrict inside_a,
    const __global uint *restrict mixed_b, const __global uint *restrict inside_b,
    __global uint *restrict mixed, __global uint *restrict inside)
{
    const ulong id = get_global_id(0);
    if (id >= words) return;
    const uint ma = mixed_a[id], ia = inside_a[id];
    const uint mb = mixed_b[id], ib = inside_b[id];
#if OP == XOR
    mixed[id] = ma | mb;
    inside[id] = (ia ^ ib) & ~(ma | mb);
#elif OP == UNION
    mixed[id] = (ma | mb) & ~(ia | ib);
    inside[id] = ia | ib;
#else
#if OP == DIFFERENCE
    /* Intersection with the complement of b; padding is outside of a, so it stays out. */
    const uint kept = ~ib & ~mb;
#else
    const uint kept = ib;
#endif
    mixed[id] = (ma | mb) & (ma | ia) & (mb | kept);
    inside[id] = ia & kept;
#endif
}

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

/* Word `w` of a cell: of its brick, or all alike.  `real`: bits of that word that are voxels of the
 * grid. */
static inline uint word_of(
    const uint mixed, const uint inside, const int lane, const uint real,
    const __global uint *brick, const int w)
{
    return mixed >> lane & 1 ? brick[w] : inside >> lane & 1 ? real : 0;
}

/* Bits of word `w` of a brick that lie within `kept` voxels (x, y, z). */
static inline uint real_bits(const int w, const int3 kept)
{
    if (all(kept == (int3)(BRICK_X, BRICK_Y, BRICK_Z))) {
        const int bits = BRICK_X * BRICK_Y * BRICK_Z - 32 * w;
        return bits >= 32 ? 0xffffffffu : (1u << bits) - 1u;
    }
    uint bits = 0;
    for (int bit = 0; bit < 32; ++bit) {
        ulong rest = 32 * w + bit;
        const int x = take_place(&rest, BRICK_X);
        const int y = take_place(&rest, BRICK_Y);
        if (x < kept.x && y < kept.y && (int)rest < kept.z) bits |= 1u << bit;
    }
    return bits;
}

/* One work-item writes the result's bricks of the 32 cells of one word.
 * cells, voxels: shapes of the coarse and the fine grid.
 * bricks_a, bricks_b: of the operands; bricks: of the result, all words written. */
__kernel void combine_bricks(
    const ulong words, const int4 cells, const int4 voxels,
    const __global uint *restrict mixed_a, const __global uint *restrict inside_a,
    const __global uint *restrict rank_a, const __global uint *restrict bricks_a,
    const __global uint *restrict mixed_b, const __global uint *restrict inside_b,
    const __global uint *restrict rank_b, const __global uint *restrict bricks_b,
    const __global uint *restrict mixed, const __global uint *restrict rank,
    __global uint *restrict bricks)
{
    const ulong id = get_global_id(0);
    if (id >= words) return;
    if (!mixed[id]) return;
    ulong rest = id;
    const int first_x = 32 * take_place(&rest, (int)words_in_row(cells.x));
    const int y = take_place(&rest, cells.y);
    const int z = (int)rest;
    const ulong first_a = rank_of(mixed_a, rank_a, id, 0);
    const ulong first_b = rank_of(mixed_b, rank_b, id, 0);
    __global uint *brick = bricks + (ulong)rank_of(mixed, rank, id, 0) * BRICK_WORDS;
    for (uint left = mixed[id]; left; left &= left - 1, brick += BRICK_WORDS) {
        const uint lower = (left & -left) - 1;
        const int lane = popcount(lower);
        const __global uint *a = bricks_a + (first_a + popcount(mixed_a[id] & lower)) * BRICK_WORDS;
        const __global uint *b = bricks_b + (first_b + popcount(mixed_b[id] & lower)) * BRICK_WORDS;
        const int3 sides = (int3)(BRICK_X, BRICK_Y, BRICK_Z);
        const int3 kept = min(voxels.xyz - (int3)(first_x + lane, y, z) * sides, sides);
        for (int w = 0; w < BRICK_WORDS; ++w) {
            const uint real = real_bits(w, kept);
            brick[w] = combine_bits(word_of(mixed_a[id], inside_a[id], lane, real, a, w),
                                    word_of(mixed_b[id], inside_b[id], lane, real, b, w));
        }
    }
}
