/*
 * raymarch/march_surface.cl: the first voxel that is inside, along each ray of a picture.
 *
 * Coarse cells first, then the voxels of their bricks.  All moments are integers, so that no voxel
 * is missed or met twice, and every device finds the same ones.
 *
 * Host:       clvox/ops/raymarch.py, march_surface()
 * Reference:  clvox/reference/raymarch.py, first_voxels()
 * Tests:      tests/kernels/test_raymarch.py
 * Defines:    LEVELS, RULE, BRICK_*, MIDDLE_*  (common/model.h)
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
 * size: rays along a row and a column; shape: voxels of the grid; columns: cells of voxels along
 * each axis, the voxels themselves in a dense grid.
 * hits: (size.y, size.x, 3) int32, the voxel (i, j, k); (-1, -1, -1) where there is none. */
__kernel void march_surface(
    const int2 size, const int4 shape, const int4 columns, RAY_PARAMETERS, MODEL_PARAMETERS,
    __global int *restrict hits)
{
    const ulong id = get_global_id(0);
    if (id >= (ulong)size.x * size.y) return;
    const int row = (int)(id / size.x), column = (int)(id - (ulong)row * size.x);
    vstore3((int3)(-1, -1, -1), id, hits);
    long3 place = place_of(fraction, start, right, down, column, row);
    /* Others pass the grid so far off that their moments might not fit into 64 bits. */
    if (!is_within(place, reach)) return;

    /* Masks as vectors choose by: -1 for true, in both widths. */
    const long3 moving = direction.xyz != 0, mirrored = direction.xyz < 0;
    const int3 moves = convert_int3(moving), turned = convert_int3(mirrored);
    const int3 padded = columns.xyz * CELL;
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
    if (!all(moves || (standing >= low && standing < high))) return;
    int axis = last_axis(enters);
    long t = part_of(enters, axis);
    const int last = first_axis(leaves);
    const long end = part_of(leaves, last);

    /* The cell in which the ray is after the moment (t, axis), and when it leaves it. */
    const int3 begin = moves ? planes_met(zero, stride, t, axis) : standing / CELL;
    Walk voxel, cell = begin_walk(
        begin, moving ? zero + convert_long3(begin + 1) * stride : (long3)LONG_MAX);
    while (is_before(t, axis, end, last)) {
        const int3 met = (int3)(cell.x, cell.y, cell.z);
        const int3 at = turned ? columns.xyz - 1 - met : met;
#if LEVELS == 1
        if (read_voxel(MODEL_ARGUMENTS, at.x, at.y, at.z)) {
            vstore3(at, id, hits);
            return;
        }
#else
        const ulong state = cell_state(MODEL_ARGUMENTS, at.x, at.y, at.z);
        const bool mixed = state < CELL_OUTSIDE;
        if (state != CELL_OUTSIDE) {
            const long3 since = zero + convert_long3(met) * stride;
            const int3 first = moves ? planes_met(since, step, t, axis)
                                     : standing - met * CELL;
            voxel = begin_walk(
                first, moving ? since + convert_long3(first + 1) * step : (long3)LONG_MAX);
            const ulong base = mixed ? state * BRICK_WORDS : 0;
            while (voxel.x < BRICK_X && voxel.y < BRICK_Y && voxel.z < BRICK_Z) {
                const int3 here = (int3)(voxel.x, voxel.y, voxel.z);
                const int3 in = turned ? CELL - 1 - here : here;
                const uint number = (in.z * BRICK_Y + in.y) * BRICK_X + in.x;
                if (!mixed || (bricks[base + number / 32] >> (number % 32) & 1)) {
                    vstore3(at * CELL + in, id, hits);
                    return;
                }
                step_along(&voxel, way_out(&voxel), step);
            }
        }
#endif
        axis = way_out(&cell);
        t = moment_out(&cell, axis);
        step_along(&cell, axis, stride);
    }
}
