/*
 * measure/sum_moments.cl: sums of the indices of the voxels inside, and of their products.
 *
 * From these integers follow volume, centre of mass and moments of inertia, the same on every
 * device.  A set of voxels that is a product of positions along x, y and z has sums that are
 * products of sums along the axes: whole cells, rows of a brick and words of a dense grid are such.
 *
 * Host:       clvox/ops/measure.py, sum_moments()
 * Reference:  clvox/reference/measure.py, sum_moments()
 * Tests:      tests/kernels/test_sum_moments.py
 * Defines:    LEVELS, RULE = 0, BRICK_*, MIDDLE_*  (common/model.h)
 *             SUMS  sums of a row: 10
 */
#include "common/index.h"
#include "common/model.h"
#include "common/rows.h"

/* Adds the voxels of x * y * z: their number; x, y, z; xx, yy, zz; xy, yz, xz.
 *
 * An index is below 2^17, and a row of cells of voxels holds at most 2^17 * 64 * 64 = 2^29 voxels:
 * a sum stays below 2^63. */
static inline void add(ulong *sums, const Line x, const Line y, const Line z)
{
    sums[0] += x.count * y.count * z.count;
    sums[1] += x.first * y.count * z.count;
    sums[2] += x.count * y.first * z.count;
    sums[3] += x.count * y.count * z.first;
    sums[4] += x.second * y.count * z.count;
    sums[5] += x.count * y.second * z.count;
    sums[6] += x.count * y.count * z.second;
    sums[7] += x.first * y.first * z.count;
    sums[8] += x.count * y.first * z.first;
    sums[9] += x.first * y.count * z.first;
}

#if LEVELS != 1

/* Adds one brick of voxels, whose cell is (x, y, z). */
static inline void add_brick(
    ulong *sums, const __global uint *brick, const int x, const int y, const int z)
{
    for (int row_z = 0; row_z < BRICK_Z; ++row_z)
        for (int row_y = 0; row_y < BRICK_Y; ++row_y) {
            const ulong bits = brick_row(brick, BRICK_X, BRICK_Y, row_y, row_z);
            if (bits)
                add(sums, shifted(sum_bits(bits, places_of(BRICK_X)), x * BRICK_X),
                    sum_range(y * BRICK_Y + row_y, 1), sum_range(z * BRICK_Z + row_z, 1));
        }
}

/* Adds neighbouring cells that are wholly inside: of those from number `first` on along x, each
 * `side` voxels wide, the ones whose bits are set.  The grid, of `voxels` along x, may end within
 * the last. */
static inline void add_cells(
    ulong *sums, const ulong bits, const int first, const int side, const int voxels,
    const Line y, const Line z)
{
    if (!bits) return;
    const int last = (voxels - 1) / side;
    const bool cut = last >= first && last < first + 64 && bits >> (last - first) & 1;
    const ulong whole = cut ? bits & ~(1UL << (last - first)) : bits;
    if (whole) add(sums, widened(shifted(sum_bits(whole, 6), first), side), y, z);
    if (cut) add(sums, sum_range(last * side, voxels - last * side), y, z);
}

#endif

/* One work-item sums up one row along x of cells of voxels; of voxels, if LEVELS is 1.
 * voxels: shape of the fine grid; columns: of those cells.
 * first, rows: rows, numbered z * columns.y + y, of this launch.
 * sums: (rows, SUMS) ulong, all written. */
__kernel void sum_moments(
    const int4 voxels, const int4 columns, const ulong first, const ulong rows, MODEL_PARAMETERS,
    __global ulong *restrict sums)
{
    const ulong id = get_global_id(0);
    if (id >= rows) return;
    ulong rest = first + id;
    const int y = take_place(&rest, columns.y);
    const int z = (int)rest;
    const int words = (cells.x + 31) / 32;
    ulong found[SUMS];
    for (int s = 0; s < SUMS; ++s) found[s] = 0;
#if LEVELS == 1
    const __global uint *row = bricks + (first + id) * words;
    for (int w = 0; w < words; ++w)
        if (row[w])
            add(found, shifted(sum_bits(row[w], 5), 32 * w), sum_range(y, 1), sum_range(z, 1));
#else
    const Line along_y = sum_range(y * BRICK_Y, min(BRICK_Y, voxels.y - y * BRICK_Y));
    const Line along_z = sum_range(z * BRICK_Z, min(BRICK_Z, voxels.z - z * BRICK_Z));
#if LEVELS == 2
    const int side = BRICK_X;
    const ulong at = cell_word(cells, 0, y, z);
#else
    const int side = BRICK_X * MIDDLE_X;
    const ulong at = cell_word(cells, 0, y / MIDDLE_Y, z / MIDDLE_Z);
    const int in_y = place_in(y, MIDDLE_Y), in_z = place_in(z, MIDDLE_Z);
#endif
    ulong number = rank_of(boundary, rank, at, 0);
    for (int w = 0; w < words; ++w) {
        add_cells(found, inside[at + w], 32 * w, side, voxels.x, along_y, along_z);
        for (uint left = boundary[at + w]; left; left &= left - 1, ++number) {
            const int x = 32 * w + popcount((left & -left) - 1);
#if LEVELS == 2
            add_brick(found, bricks + number * BRICK_WORDS, x, y, z);
#else
            const ulong start = number * MIDDLE_WORDS;
            add_cells(found, brick_row(middle_inside + start, MIDDLE_X, MIDDLE_Y, in_y, in_z),
                      x * MIDDLE_X, BRICK_X, voxels.x, along_y, along_z);
            ulong row = brick_row(middle + start, MIDDLE_X, MIDDLE_Y, in_y, in_z);
            for (; row; row &= row - 1) {
                const int cell = x * MIDDLE_X + (int)popcount((row & -row) - 1);
                const ulong bit = middle_bit((uint)number, cell, y, z);
                const ulong brick = rank_of(middle, middle_rank, bit / 32, bit % 32);
                add_brick(found, bricks + brick * BRICK_WORDS, cell, y, z);
            }
#endif
        }
    }
#endif
    for (int s = 0; s < SUMS; ++s) sums[SUMS * id + s] = found[s];
}
