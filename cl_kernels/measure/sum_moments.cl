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
 * Defines:    LEVELS, RULE = 0, BRICK_X, BRICK_Y, BRICK_Z  (common/model.h)
 *             SUMS  sums of a row: 10
 */
#include "common/index.h"
#include "common/model.h"
#include "common/rows.h"

/* Adds the voxels of x * y * z: their number; x, y, z; xx, yy, zz; xy, yz, xz.
 *
 * An index is below 2^17, and a row of cells holds at most 2^17 * 64 * 64 = 2^29 voxels: a sum
 * stays below 2^63. */
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

#if LEVELS == 2

#define BRICK_PLACES (BRICK_X > 32 ? 6 : BRICK_X > 16 ? 5 : BRICK_X > 8 ? 4 : BRICK_X > 4 ? 3 : 2)

/* Adds the cells of row (y, z) that are wholly inside.  Cells beside each other count as if they
 * were one voxel each; then each becomes BRICK_X of them.  The grid may end within the last. */
static inline void add_cells(
    ulong *sums, const __global uint *row, const int4 cells, const int4 voxels,
    const Line y, const Line z)
{
    const int words = (int)words_in_row(cells.x);
    const int end = cells.x - 1;
    Line found = {0, 0, 0};
    for (int w = 0; w < words; ++w) {
        uint bits = row[w];
        if (w == end / 32) bits &= ~(1u << (end % 32));
        if (!bits) continue;
        const Line some = shifted(sum_bits(bits, 5), 32 * w);
        found.count += some.count;
        found.first += some.first;
        found.second += some.second;
    }
    const Line side = sum_range(0, BRICK_X);
    const Line line = {
        found.count * BRICK_X,
        found.first * BRICK_X * BRICK_X + found.count * side.first,
        found.second * BRICK_X * BRICK_X * BRICK_X + 2 * found.first * BRICK_X * side.first
            + found.count * side.second,
    };
    add(sums, line, y, z);
    if (row[end / 32] >> (end % 32) & 1)
        add(sums, sum_range(end * BRICK_X, voxels.x - end * BRICK_X), y, z);
}

/* Adds the bricks of row (y, z) of cells, the first of which is `brick`. */
static inline void add_bricks(
    ulong *sums, const __global uint *row_of_cells, const __global uint *brick, const int words,
    const int y, const int z)
{
    for (int w = 0; w < words; ++w)
        for (uint left = row_of_cells[w]; left; left &= left - 1, brick += BRICK_WORDS) {
            const int x = 32 * w + popcount((left & -left) - 1);
            for (int row_z = 0; row_z < BRICK_Z; ++row_z)
                for (int row_y = 0; row_y < BRICK_Y; ++row_y) {
                    const ulong bits = brick_row(brick, row_y, row_z);
                    if (bits)
                        add(sums, shifted(sum_bits(bits, BRICK_PLACES), x * BRICK_X),
                            sum_range(y * BRICK_Y + row_y, 1), sum_range(z * BRICK_Z + row_z, 1));
                }
        }
}

#endif

/* One work-item sums up one row of cells along x; of voxels, if LEVELS is 1.
 * voxels: shape of the fine grid.  first, rows: rows, numbered z * cells.y + y, of this launch.
 * sums: (rows, SUMS) ulong, all written. */
__kernel void sum_moments(
    const int4 voxels, const ulong first, const ulong rows, MODEL_PARAMETERS,
    __global ulong *restrict sums)
{
    const ulong id = get_global_id(0);
    if (id >= rows) return;
    ulong rest = first + id;
    const int y = take_place(&rest, cells.y);
    const int z = (int)rest;
    ulong found[SUMS];
    for (int s = 0; s < SUMS; ++s) found[s] = 0;
#if LEVELS == 1
    const int words = (cells.x + 31) / 32;
    const __global uint *row = bricks + (first + id) * words;
    for (int w = 0; w < words; ++w)
        if (row[w])
            add(found, shifted(sum_bits(row[w], 5), 32 * w), sum_range(y, 1), sum_range(z, 1));
#else
    const ulong at = cell_word(cells, 0, y, z);
    add_cells(found, inside + at, cells, voxels,
              sum_range(y * BRICK_Y, min(BRICK_Y, voxels.y - y * BRICK_Y)),
              sum_range(z * BRICK_Z, min(BRICK_Z, voxels.z - z * BRICK_Z)));
    add_bricks(found, boundary + at, bricks + (ulong)rank_of(boundary, rank, at, 0) * BRICK_WORDS,
               (int)words_in_row(cells.x), y, z);
#endif
    for (int s = 0; s < SUMS; ++s) sums[SUMS * id + s] = found[s];
}
