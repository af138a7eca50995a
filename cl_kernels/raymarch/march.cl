/*
 * raymarch/march.cl: what each ray of a picture meets first, or how far it runs inside.
 *
 * Coarse cells first, then the voxels of their bricks.  All moments are integers, so that no voxel
 * is missed or met twice, and every device finds the same ones.
 *
 * Host:       clvox/ops/raymarch.py, march() and measure_lengths()
 * Reference:  clvox/reference/raymarch.py
 * Tests:      tests/kernels/test_raymarch.py
 * Defines:    LEVELS, RULE, BRICK_*, MIDDLE_*  (common/model.h)
 *             LENGTHS  0: the first voxel that the rule takes; 1: the length within such voxels
 *             TILE     rays along the side of a tile that `starts` knows of; 0 without
 * Source:     after Amanatides and Woo, "A fast voxel traversal algorithm for ray tracing",
 *             Eurographics 1987.
 */
#include "common/model.h"
#include "raymarch/rays.h"

#if LEVELS == 1
#define SIDE_X 1
#define SIDE_Y 1
#define SIDE_Z 1
#else
#define SIDE_X BRICK_X
#define SIDE_Y BRICK_Y
#define SIDE_Z BRICK_Z
#endif

/* What is met: the axis along which it is entered, whether a cut opens it, and what it is. */
#define CUT 4
#define KIND(kind) ((kind) << 3)
#define INSIDE_VOXEL 0
#define TOUCHED_VOXEL 1
#define INSIDE_CELL 2

#if RULE == CENTRE
#define IS_TAKEN(word, bit) (bricks[word] >> (bit) & 1)
#define KIND_OF(word, bit) INSIDE_VOXEL
#else
#define IS_TAKEN(word, bit) ((bricks[word] | edge[word]) >> (bit) & 1)
#define KIND_OF(word, bit) (edge[word] >> (bit) & 1 ? TOUCHED_VOXEL : INSIDE_VOXEL)
#endif

/* Something is met between the moments (since, along) and `until`: note it, and if only the first
 * such thing is asked for, end the walk. */
#if LENGTHS
#define MEET(x, y, z, since, along, until, kind) within += min(until, end) - since
#else
#define MEET(x, y, z, since, along, until, kind) \
    do { \
        hits[4 * id] = x; \
        hits[4 * id + 1] = y; \
        hits[4 * id + 2] = z; \
        hits[4 * id + 3] = \
            along | (cut && since == begin && along == begun ? CUT : 0) | KIND(kind); \
        far[id] = (float)since / whole; \
        end = LONG_MIN; \
    } while (0)
#endif

/* Go on with a walk, to the next cell along the axis `way`. */
#define STEP(walk, way, x_apart, y_apart, z_apart) \
    do { \
        if (way == 0) { \
            walk##_x += 1; \
            walk##_out_x += x_apart; \
        } else if (way == 1) { \
            walk##_y += 1; \
            walk##_out_y += y_apart; \
        } else { \
            walk##_z += 1; \
            walk##_out_z += z_apart; \
        } \
    } while (0)

/* The voxel in which the ray is, along one axis of the grid. */
#define VOXEL_OF(axis) \
    (axis.turned ? (columns.axis - cell_##axis) * SIDE_OF_##axis - 1 - voxel_##axis \
                 : cell_##axis * SIDE_OF_##axis + voxel_##axis)
#define SIDE_OF_x SIDE_X
#define SIDE_OF_y SIDE_Y
#define SIDE_OF_z SIDE_Z

/* One work-item follows one ray.
 * size: rays along a row and a column; shape: voxels of the grid; columns: cells of voxels along
 * each axis, the voxels themselves in a dense grid; low, high: the voxels that are drawn.
 * starts: (tiles,) float32, for each tile of TILE x TILE rays how far nothing is met, in
 * directions; INFINITY if nothing is met at all; not read unless TILE is set.
 * hits: (size.y, size.x, 4) int32, the voxel (i, j, k) and what is met; -1, -1, -1, 0 if nothing.
 * far: (size.y, size.x) float32, where it is met, in directions; or, if LENGTHS is set, the
 * length within, in the unit of `widths`, a voxel's. */
__kernel void march(
    const int2 size, const int4 shape, const int4 columns, const int4 low, const int4 high,
    const float4 widths, RAY_PARAMETERS, const __global float *restrict starts, MODEL_PARAMETERS,
    __global int *restrict hits, __global float *restrict far)
{
    const ulong id = get_global_id(0);
    if (id >= (ulong)size.x * size.y) return;
    const int row = (int)(id / size.x), column = (int)(id - (ulong)row * size.x);
#if LENGTHS
    far[id] = 0.0f;
    long within = 0;
#else
    hits[4 * id] = hits[4 * id + 1] = hits[4 * id + 2] = -1;
    hits[4 * id + 3] = 0;
    far[id] = INFINITY;
#endif
#if TILE
    const int tiles = (size.x + TILE - 1) / TILE;
    const float start_at = starts[(row / TILE) * tiles + column / TILE];
    if (start_at == INFINITY) return;
#endif
    const long place_x = PLACE_OF(x, column, row), place_y = PLACE_OF(y, column, row);
    const long place_z = PLACE_OF(z, column, row);
    /* Others pass the grid so far off that their moments might not fit into 64 bits. */
    if (!is_within(place_x, reach) || !is_within(place_y, reach) || !is_within(place_z, reach))
        return;
    const long part_x = DIRECTION_OF(x, column, row), part_y = DIRECTION_OF(y, column, row);
    const long part_z = DIRECTION_OF(z, column, row);
    const long size_x = not_zero(part_x), size_y = not_zero(part_y), size_z = not_zero(part_z);
    Along x, y, z;
    begin_along(&x, place_x, part_x, size_y * size_z, bits, columns.x * SIDE_X, low.x, high.x);
    begin_along(&y, place_y, part_y, size_x * size_z, bits, columns.y * SIDE_Y, low.y, high.y);
    begin_along(&z, place_z, part_z, size_x * size_y, bits, columns.z * SIDE_Z, low.z, high.z);
    if (stands_outside(&x) || stands_outside(&y) || stands_outside(&z)) return;
    const float whole = (float)size_x * (float)size_y * (float)size_z;

    const long in_x = moment_in(&x), in_y = moment_in(&y), in_z = moment_in(&z);
    const long past_x = moment_past(&x), past_y = moment_past(&y), past_z = moment_past(&z);
    int axis = last_axis(in_x, in_y, in_z);
    long t = one_of(axis, in_x, in_y, in_z);
    const int last = first_axis(past_x, past_y, past_z);
    long end = one_of(last, past_x, past_y, past_z);
    /* What is met at once is cut open, unless that is where the grid ends. */
    bool cut = axis == 0 ? (part_x < 0 ? high.x < shape.x : low.x > 0)
             : axis == 1 ? (part_y < 0 ? high.y < shape.y : low.y > 0)
                         : (part_z < 0 ? high.z < shape.z : low.z > 0);
    if (begins && is_before(t, axis, 0, 2)) {
        t = 0;
        axis = 2;
        cut = true;
    }
#if TILE
    const long later = (long)(start_at * whole);
    if (is_before(t, axis, later, 2)) {
        t = later;
        axis = 2;
        cut = false;
    }
#endif
    const long begin = t;
    const int begun = axis;

    int cell_x = cells_passed(&x, x.zero, SIDE_X, x.standing, t, axis, 0);
    int cell_y = cells_passed(&y, y.zero, SIDE_Y, y.standing, t, axis, 1);
    int cell_z = cells_passed(&z, z.zero, SIDE_Z, z.standing, t, axis, 2);
    long cell_out_x = moment_out(&x, x.zero, SIDE_X, cell_x);
    long cell_out_y = moment_out(&y, y.zero, SIDE_Y, cell_y);
    long cell_out_z = moment_out(&z, z.zero, SIDE_Z, cell_z);
    while (is_before(t, axis, end, last)) {
        const int at_x = x.turned ? columns.x - 1 - cell_x : cell_x;
        const int at_y = y.turned ? columns.y - 1 - cell_y : cell_y;
        const int at_z = z.turned ? columns.z - 1 - cell_z : cell_z;
        const int way = first_axis(cell_out_x, cell_out_y, cell_out_z);
        const long out = one_of(way, cell_out_x, cell_out_y, cell_out_z);
#if LEVELS == 1
        const ulong word = ((ulong)at_z * cells.y + at_y) * ((cells.x + 31) / 32) + at_x / 32;
        if (IS_TAKEN(word, at_x % 32))
            MEET(at_x, at_y, at_z, t, axis, out, KIND_OF(word, at_x % 32));
#else
        const ulong state = cell_state(MODEL_ARGUMENTS, at_x, at_y, at_z);
        if (state != CELL_OUTSIDE) {
            const long since_x = x.zero + (long)cell_x * SIDE_X * x.step;
            const long since_y = y.zero + (long)cell_y * SIDE_Y * y.step;
            const long since_z = z.zero + (long)cell_z * SIDE_Z * z.step;
            const bool mixed = state != CELL_INSIDE;
            const ulong base = mixed ? state * BRICK_WORDS : 0;
            int voxel_x = cells_passed(
                &x, since_x, 1, x.standing - cell_x * SIDE_X, t, axis, 0);
            int voxel_y = cells_passed(
                &y, since_y, 1, y.standing - cell_y * SIDE_Y, t, axis, 1);
            int voxel_z = cells_passed(
                &z, since_z, 1, z.standing - cell_z * SIDE_Z, t, axis, 2);
            long voxel_out_x = moment_out(&x, since_x, 1, voxel_x);
            long voxel_out_y = moment_out(&y, since_y, 1, voxel_y);
            long voxel_out_z = moment_out(&z, since_z, 1, voxel_z);
            /* The bit of the voxel in its brick moves along with it. */
            const int go_x = x.turned ? -1 : 1, go_y = y.turned ? -BRICK_X : BRICK_X;
            const int go_z = z.turned ? -BRICK_X * BRICK_Y : BRICK_X * BRICK_Y;
            uint bit = ((z.turned ? SIDE_Z - 1 - voxel_z : voxel_z) * BRICK_Y
                        + (y.turned ? SIDE_Y - 1 - voxel_y : voxel_y)) * BRICK_X
                     + (x.turned ? SIDE_X - 1 - voxel_x : voxel_x);
            long now = t;
            int along = axis;
            while (voxel_x < SIDE_X && voxel_y < SIDE_Y && voxel_z < SIDE_Z
                   && is_before(now, along, end, last)) {
                const int next = first_axis(voxel_out_x, voxel_out_y, voxel_out_z);
                const long leave = one_of(next, voxel_out_x, voxel_out_y, voxel_out_z);
                const ulong word = base + bit / 32;
                if (!mixed) {
#if LENGTHS
                    within += min(out, end) - now;
                    break;
#else
                    MEET(VOXEL_OF(x), VOXEL_OF(y), VOXEL_OF(z), now, along, out, INSIDE_CELL);
#endif
                } else if (IS_TAKEN(word, bit % 32)) {
                    MEET(VOXEL_OF(x), VOXEL_OF(y), VOXEL_OF(z), now, along, leave,
                         KIND_OF(word, bit % 32));
                }
                now = leave;
                along = next;
                bit += next == 0 ? go_x : (next == 1 ? go_y : go_z);
                STEP(voxel, next, x.step, y.step, z.step);
            }
        }
#endif
        t = out;
        axis = way;
        STEP(cell, way, x.step * SIDE_X, y.step * SIDE_Y, z.step * SIDE_Z);
    }
#if LENGTHS
    const float ahead_x = (float)part_x * widths.x, ahead_y = (float)part_y * widths.y;
    const float ahead_z = (float)part_z * widths.z;
    far[id] = (float)within / whole / (float)(1L << bits)
            * sqrt(ahead_x * ahead_x + ahead_y * ahead_y + ahead_z * ahead_z);
#endif
}
