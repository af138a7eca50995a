/*
 * raymarch/march_surface.cl: the first voxel that is inside, along each ray of a picture.
 *
 * Coarse cells first, then the voxels of their bricks.  All moments are integers, so that no voxel
 * is missed or met twice, and every device finds the same ones.
 *
 * Host:       clvox/ops/raymarch.py, march_surface()
 * Reference:  clvox/reference/raymarch.py, first_voxels()
 * Tests:      tests/kernels/test_raymarch.py
 * Defines:    LEVELS, RULE, BRICK_X, BRICK_Y, BRICK_Z  (common/model.h)
 * Source:     after Amanatides and Woo, "A fast voxel traversal algorithm for ray tracing",
 *             Eurographics 1987.
 */
#include "common/model.h"
#include "raymarch/rays.h"

#if LEVELS == 1
#define CELL ((int3)(1, 1, 1))
#else
#define CELL ((int3)(BRICK_X, BRICK_Y, BRICK_Z))
#endif

/* One work-item follows one ray.
 * size: rays along a row and a column; shape: voxels of the grid.
 * hits: (size.y, size.x, 3) int32, the voxel (i, j, k); (-1, -1, -1) where there is none. */
__kernel void march_surface(
    const int2 size, const int4 shape, RAY_PARAMETERS, MODEL_PARAMETERS,
    __global int *restrict hits)
{
    const ulong id = get_global_id(0);
    if (id >= (ulong)size.x * size.y) return;
    int3 hit = (int3)(-1, -1, -1);
    const int row = (int)(id / size.x), column = (int)(id - (ulong)row * size.x);
    long3 place = place_of(fraction, start, right, down, column, row);
    /* Others pass the grid so far off that their moments might not fit into 64 bits. */
    bool live = all(place < reach) && all(place > -reach);
    if (!live) place = 0;

    /* Masks as vectors choose by: -1 for true, in both widths. */
    const long3 moving = direction.xyz != 0, mirrored = direction.xyz < 0;
    const int3 moves = convert_int3(moving), turned = convert_int3(mirrored);
    const int3 padded = cells.xyz * CELL;
    const long one = 1L << bits;
    place = mirrored ? convert_long3(padded) * one - place : place;
    /* Where the grid lies in the padded one, after mirroring. */
    const int3 low = turned & (padded - shape.xyz);
    const int3 high = low + shape.xyz;
    const long3 pace = paces(direction);
    const long3 step = pace * one, stride = step * convert_long3(CELL);
    const long3 zero = -place * pace;

    const long3 enters = moving ? zero + convert_long3(low) * step : (long3)LONG_MIN;
    const long3 leaves = moving ? zero + convert_long3(high) * step : (long3)LONG_MAX;
    const int3 standing = convert_int3(place >> (long)bits);
    live = live && all(moves || (standing >= low && standing < high));
    int axis = last_axis(enters);
    long t = part_of(enters, axis);
    const int last = first_axis(leaves);
    const long end = part_of(leaves, last);
    live = live && is_before(t, axis, end, last);

    /* The cell in which the ray is after the moment (t, axis), and when it leaves it. */
    int3 cell = moves ? planes_met(zero, stride, t, axis) : standing / CELL;
    long3 next = moving ? zero + convert_long3(cell + 1) * stride : (long3)LONG_MAX;
    while (live) {
        const int3 at = turned ? cells.xyz - 1 - cell : cell;
#if LEVELS == 1
        if (read_voxel(MODEL_ARGUMENTS, at.x, at.y, at.z)) {
            hit = at;
            break;
        }
#else
        const ulong word = cell_word(cells, at.x, at.y, at.z);
        const uint bit = at.x % 32;
        const bool mixed = boundary[word] >> bit & 1;
        if (mixed || (inside[word] >> bit & 1)) {
            const long3 since = zero + convert_long3(cell) * stride;
            int3 voxel = moves ? planes_met(since, step, t, axis) : standing % CELL;
            long3 then = moving ? since + convert_long3(voxel + 1) * step : (long3)LONG_MAX;
            const ulong base = mixed ? (ulong)rank_of(boundary, rank, word, bit) * BRICK_WORDS : 0;
            while (all(voxel < CELL)) {
                const int3 in = turned ? CELL - 1 - voxel : voxel;
                const uint number = (in.z * BRICK_Y + in.y) * BRICK_X + in.x;
                if (!mixed || (bricks[base + number / 32] >> (number % 32) & 1)) {
                    hit = at * CELL + in;
                    break;
                }
                const int3 forward = along(first_axis(then));
                voxel -= forward;
                then += step & convert_long3(forward);
            }
            if (hit.x >= 0) break;
        }
#endif
        axis = first_axis(next);
        t = part_of(next, axis);
        live = is_before(t, axis, end, last);
        const int3 forward = along(axis);
        cell -= forward;
        next += stride & convert_long3(forward);
    }
    vstore3(hit, id, hits);
}
