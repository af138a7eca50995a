/*
 * measure/count_voxels.cl: how many voxels there are, in parts that fit 32 bits.
 *
 * Host:       clvox/ops/measure.py
 * Reference:  numpy.count_nonzero of clvox/reference/multilevel.py, build()
 * Tests:      tests/kernels/test_measure.py
 * Defines:    RULE  CENTRE, TOUCH or WITHIN (common/model.h)
 *             RUN   words per work-item
 *             ABOVE_X, ABOVE_Y, ABOVE_Z, CELL_X, CELL_Y, CELL_Z  cells along the sides of a brick
 *                   of cells, and voxels along the sides of such a cell, for count_middle
 */
#define LEVELS 1
#include "common/index.h"
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

#ifdef CELL_X

/* One work-item counts the voxels of the inside cells of one word of the bricks of cells, as far
 * as the grid reaches: below 2^31, since a cell has at most 64^3.
 * voxels: shape of the fine grid.  owners: (bricks, 3) int32, the coarse cell of each brick.
 * inside: bits of the cells.  counts: (words,) uint32. */
__kernel void count_middle(
    const ulong words, const int4 voxels, const __global int *restrict owners,
    const __global uint *restrict inside, __global uint *restrict counts)
{
    const ulong id = get_global_id(0);
    if (id >= words) return;
    const int brick_words = (ABOVE_X * ABOVE_Y * ABOVE_Z + 31) / 32;
    const int3 above = (int3)(ABOVE_X, ABOVE_Y, ABOVE_Z);
    const int3 sides = (int3)(CELL_X, CELL_Y, CELL_Z);
    ulong brick = id;
    const int first = take_place(&brick, brick_words) * 32;
    const int3 corner = vload3(brick, owners) * above;
    if (all((corner + above) * sides <= voxels.xyz)) {
        counts[id] = popcount(inside[id]) * (CELL_X * CELL_Y * CELL_Z);
        return;
    }
    uint count = 0;
    for (uint left = inside[id]; left; left &= left - 1) {
        ulong at = first + popcount((left & -left) - 1);
        const int i = take_place(&at, ABOVE_X), j = take_place(&at, ABOVE_Y);
        const int3 cell = corner + (int3)(i, j, (int)at);
        const int3 size = min(voxels.xyz - cell * sides, sides);
        count += size.x * size.y * size.z;
    }
    counts[id] = count;
}

#endif
