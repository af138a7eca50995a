/*
 * measure/count_voxels.cl: how many voxels there are, in parts that fit 32 bits.
 *
 * Host:       clvox/ops/measure.py
 * Reference:  numpy.count_nonzero of clvox/reference/multilevel.py, build()
 * Tests:      tests/kernels/test_measure.py
 * Defines:    RULE  CENTRE, TOUCH or WITHIN (common/model.h)
 *             RUN   words per work-item
 */
#define LEVELS 1
#include "common/model.h"

/* One work-item counts the bits of RUN words, by the rule.
 * bits, edge: (n,) uint32.  counts: (ceil(n / RUN),) uint32. */
__kernel void count_bits(
    const ulong n, const __global uint *restrict bits, const __global uint *restrict edge,
    __global uint *restrict counts)
{
    const ulong start = get_global_id(0) * RUN;
    if (start >= n) return;
    uint count = 0;
    for (ulong at = start; at < min(start + RUN, n); ++at) {
#if RULE == CENTRE
        count += popcount(bits[at]);
#else
        count += popcount(by_rule(bits[at], edge[at]));
#endif
    }
    counts[get_global_id(0)] = count;
}

/* One work-item counts the inside cells of one row along x; the last cell of the row apart, since
 * the grid may end within it.
 * shape: of the coarse grid.  inside: bits.
 * counts: (cells.z, cells.y, 2) uint32: all but the last, the last. */
__kernel void count_cells(
    const int4 shape, const __global uint *restrict inside, __global uint *restrict counts)
{
    const ulong id = get_global_id(0);
    if (id >= (ulong)shape.y * shape.z) return;
    const int words = (shape.x + 31) / 32;
    const __global uint *row = inside + id * words;
    uint count = 0;
    for (int w = 0; w < words; ++w) count += popcount(row[w]);
    const uint last = row[words - 1] >> ((shape.x - 1) % 32) & 1;
    counts[2 * id] = count - last;
    counts[2 * id + 1] = last;
}
