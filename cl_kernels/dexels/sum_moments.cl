/*
 * dexels/sum_moments.cl: integrals over the pieces of rays, exactly.
 *
 * A piece from e to w on ray (i, j) has the length L = w - e, in units of the depth.  Summed are L
 * times 1, i, j, i i, j j and i j; w^2 - e^2 times 1, i and j; and w^3 - e^3.  Depths count from
 * the face of the box and lie below 2^31, i and j below 2^17: each term is a product of two
 * 64-bit numbers, and a sum of 2^30 of them stays below 2^128.
 *
 * Host:       clvox/ops/dexel_measure.py, sum_moments()
 * Reference:  clvox/reference/dexels.py, moments()
 * Tests:      tests/kernels/test_dexel_measure.py
 * Defines:    RUN  rays that one work-item sums over
 */
#include "common/index.h"

#define SUMS 10

typedef struct {
    ulong low, high;
} Wide;

static inline void add_product(Wide *sum, const ulong a, const ulong b)
{
    const ulong low = a * b;
    sum->low += low;
    sum->high += mul_hi(a, b) + (sum->low < low ? 1 : 0);
}

/* One work-item sums over the pieces of RUN rays in a row.
 * along: rays along i, the faster of the two.  box_low: depth of the face of the box.
 * offsets: (rays + 1,) uint64; depths: ends, resolved.
 * sums: (runs, SUMS, 2) uint64, the lower half of each sum first. */
__kernel void sum_moments(
    const ulong rays, const int along, const int box_low, const __global ulong *restrict offsets,
    const __global int *restrict depths, __global ulong *restrict sums)
{
    const ulong run = get_global_id(0);
    const ulong start = run * RUN;
    if (start >= rays) return;
    Wide total[SUMS];
    for (int n = 0; n < SUMS; ++n) {
        total[n].low = 0;
        total[n].high = 0;
    }
    for (ulong ray = start; ray < min(start + RUN, rays); ++ray) {
        ulong number = ray;
        const ulong i = take_place(&number, along);
        const ulong j = number;
        const ulong stop = offsets[ray + 1];
        ulong first = 0;
        ulong second = 0;
        for (ulong at = offsets[ray]; at < stop; at += 2) {
            const ulong e = (uint)depths[at] - (uint)box_low;
            const ulong w = (uint)depths[at + 1] - (uint)box_low;
            first += w - e;
            second += (w - e) * (w + e);
            add_product(total + 9, w - e, w * w + w * e + e * e);
        }
        if (first == 0) continue;
        add_product(total, first, 1);
        add_product(total + 1, first, i);
        add_product(total + 2, first, j);
        add_product(total + 3, first * i, i);
        add_product(total + 4, first * j, j);
        add_product(total + 5, first * i, j);
        add_product(total + 6, second, 1);
        add_product(total + 7, second, i);
        add_product(total + 8, second, j);
    }
    for (int n = 0; n < SUMS; ++n) {
        sums[(run * SUMS + n) * 2] = total[n].low;
        sums[(run * SUMS + n) * 2 + 1] = total[n].high;
    }
}
