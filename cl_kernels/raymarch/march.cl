/*
 * raymarch/march.cl: what each ray of a picture meets first, or how far it runs inside.
 *
 * Coarse cells first, then the voxels of their bricks.  All moments are integers, so that no voxel
 * is missed or met twice, and every device finds the same ones.  Some rays go side by side: each
 * waits at the next brick until all have come to one, or have ended.
 *
 * Host:       clvox/ops/raymarch.py, march() and measure_lengths()
 * Reference:  clvox/reference/raymarch.py
 * Tests:      tests/kernels/test_raymarch.py
 * Defines:    LEVELS, RULE, BRICK_*, MIDDLE_*  (common/model.h)
 *             LENGTHS  0: the first voxel that the rule takes; 1: the length within such voxels
 *             WIDTH    (raymarch/lanes.h)
 *             TILE     places along the side of a tile that `starts` knows of; 0 without
 *             BLOCK_*  cells along the sides of a block, if TILE is not 0
 *             LISTED, SAMPLES, EACH  (raymarch/samples.h)
 *             PLANE    1: a plane cuts something away; with PLANE_BITS and TIME_BITS
 *             STATES   1: blocks are cells, and one word tells all about each
 * Source:     after Amanatides and Woo, "A fast voxel traversal algorithm for ray tracing",
 *             Eurographics 1987.
 */
#include "common/index.h"
#include "common/model.h"
#include "raymarch/along.h"
#if PLANE
#include "raymarch/plane.h"
#endif
#include "raymarch/rays.h"
#include "raymarch/samples.h"
#include "raymarch/states.h"

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
#define BY_PLANE 3
#define KIND(kind) ((kind) << 3)
#define INSIDE_VOXEL 0
#define TOUCHED_VOXEL 1
#define INSIDE_CELL 2

#if RULE == CENTRE
#define WORD_OF(word) bricks[word]
#define KIND_OF(word, bit) INSIDE_VOXEL
#define LOOK_UP_WORDS(words) LOOK_UP(bricks, words)
#else
#define WORD_OF(word) (bricks[word] | edge[word])
#define KIND_OF(word, bit) (edge[word] >> (bit) & 1 ? TOUCHED_VOXEL : INSIDE_VOXEL)
#define LOOK_UP_WORDS(words) (LOOK_UP(bricks, words) | LOOK_UP(edge, words))
#endif

/* How many voxels of a brick are behind a place are three numbers above its bit, each so high that
 * one more bit is set, one of LEFT, past the last voxel.  SPARE takes what the bit may borrow. */
#define HALF 256L
#define PASSED(axis) (1L << (34 + 9 * (axis)))
#define LEFT (HALF * (PASSED(0) | PASSED(1) | PASSED(2)))
#define SPARE (2L << 32)

/* The place of a bit in its brick. */
#define BIT_X(bit) place_in(bit, BRICK_X)
#define BIT_Y(bit) place_in((bit) / BRICK_X, BRICK_Y)
#define BIT_Z(bit) ((bit) / (BRICK_X * BRICK_Y))

#if !STATES

#if TILE

/* How many cells follow cell `at`, of `count`, along one axis before something may change, if that
 * is so for all blocks that are less than `free` away; none beyond the grid: where blocks are wide
 * along that axis and it has few of them, moments so far off would not fit into 64 bits. */
static inline long cells_after(
    const int at, const int count, const int free, const int block, const bool turned)
{
    const int place = place_in(at, block);
    const int same = (free - 1) * block + (turned ? place : block - 1 - place);
    return min(same, turned ? at : count - 1 - at);
}

#endif

/* The state of cell (x, y, z), as raymarch/states.h has it.
 * turned: 1, 2 and 4 for axes along which the ray runs backwards; after: for each axis, how many
 * cells of the same kind follow. */
static inline long state_of(
    MODEL_PARAMETERS, const int4 columns, const int4 blocks, const __global uchar *distances,
    const int x, const int y, const int z, const int turned, long *after_x, long *after_y,
    long *after_z)
{
    *after_x = *after_y = *after_z = 0;
#if TILE
    const int near_x = x / BLOCK_X, near_y = y / BLOCK_Y, near_z = z / BLOCK_Z;
    const uint near = distances[((ulong)near_z * blocks.y + near_y) * blocks.x + near_x];
    const int free = (int)(near & FREE);
    if (free > 0) {
        *after_x = cells_after(x, columns.x, free, BLOCK_X, turned & 1);
        *after_y = cells_after(y, columns.y, free, BLOCK_Y, turned & 2);
        *after_z = cells_after(z, columns.z, free, BLOCK_Z, turned & 4);
        return UNIFORM | (near & INSIDE_STATE);
    }
#endif
#if LEVELS == 1
    const ulong word = ((ulong)z * cells.y + y) * ((cells.x + 31) / 32) + x / 32;
    return UNIFORM | (WORD_OF(word) >> (x % 32) & 1 ? INSIDE_STATE : 0);
#else
    const ulong state = cell_state(MODEL_ARGUMENTS, x, y, z);
    if (state < CELL_OUTSIDE) return (long)state;
    return UNIFORM | (state == CELL_INSIDE ? INSIDE_STATE : 0);
#endif
}

#endif

/* One work-item follows WIDTH rays.
 * shape: voxels of the grid; columns: cells of voxels along each axis, the voxels themselves in a
 * dense grid; low, high: the voxels that are drawn; plane: if PLANE is set, its normal, and what
 * the product of that and a place is at most.
 * starts: (tiles,) float32, for each tile of TILE x TILE places how far nothing is met, in
 * directions; INFINITY if nothing is met at all.  blocks, distances: shape of the grid of blocks,
 * and for each what clvox/ops/distances.py says.  None of the three is read unless TILE is
 * set.  states: (cells,) uint32 as merge() in distances.cl leaves them, read if STATES is set.
 * hits: (rays, 4) int32, the voxel (i, j, k) and what is met; -1, -1, -1, 0 if nothing.
 * far: (rays,) float32, where it is met, in directions; or, if LENGTHS is set, the
 * length within, in the unit of `widths`, a voxel's. */
__kernel void march(
    PIXEL_PARAMETERS, const int4 shape, const int4 columns, const int4 low, const int4 high,
    const float4 widths, RAY_PARAMETERS, const long4 plane, const __global float *restrict starts,
    const int4 blocks, const __global uchar *restrict distances,
    const __global uint *restrict states, MODEL_PARAMETERS,
    __global int *restrict hits, __global float *restrict far)
{
    const ulong first_ray = get_global_id(0) * WIDTH;
    const ulong rays = pixel_count * RAYS;
    if (first_ray >= rays) return;
    const int count = (int)min((ulong)WIDTH, rays - first_ray);
    long column_of[WIDTH], row_of[WIDTH], live_of[WIDTH];
#if TILE
    float start_of[WIDTH];
#endif
    bool none_live = true;
    for (int lane = 0; lane < WIDTH; ++lane) {
        const ulong id = first_ray + min(lane, count - 1);
        const ulong item = id / RAYS;
        const int2 ray = ray_of_sample(NUMBER_OF_PIXEL(item), picture.x, (int)(id - item * RAYS));
        column_of[lane] = ray.x;
        row_of[lane] = ray.y;
        bool live = lane < count;
#if TILE
        const int tiles = (picture.x * PLACES + TILE - 1) / TILE;
        const float start_at = starts[(ray.y / TILE) * tiles + ray.x / TILE];
        live = live && start_at < INFINITY;
        start_of[lane] = live ? start_at : 0.0f;
#endif
        live_of[lane] = -(long)live;
        none_live = none_live && !live;
    }
    for (int lane = 0; lane < count; ++lane) {
        const ulong id = first_ray + lane;
#if LENGTHS
        far[id] = 0.0f;
#else
        hits[4 * id] = hits[4 * id + 1] = hits[4 * id + 2] = -1;
        hits[4 * id + 3] = 0;
        far[id] = INFINITY;
#endif
    }
    if (none_live) return;
    const longs column = LOAD(column_of), row = LOAD(row_of);
    const longs place_x = PLACE_OF(x, column, row), place_y = PLACE_OF(y, column, row);
    const longs place_z = PLACE_OF(z, column, row);
    /* Others pass the grid so far off that their moments might not fit into 64 bits. */
    longs going = LOAD(live_of)
        & WHERE(place_x < reach) & WHERE(place_x > -reach) & WHERE(place_y < reach)
        & WHERE(place_y > -reach) & WHERE(place_z < reach) & WHERE(place_z > -reach);
    const longs part_x = DIRECTION_OF(x, column, row), part_y = DIRECTION_OF(y, column, row);
    const longs part_z = DIRECTION_OF(z, column, row);
    const longs size_x = not_zero(part_x), size_y = not_zero(part_y), size_z = not_zero(part_z);
    Along x, y, z;
    begin_along(&x, place_x, part_x, size_y * size_z, bits, columns.x * SIDE_X, low.x, high.x);
    begin_along(&y, place_y, part_y, size_x * size_z, bits, columns.y * SIDE_Y, low.y, high.y);
    begin_along(&z, place_z, part_z, size_x * size_y, bits, columns.z * SIDE_Z, low.z, high.z);
    going &= ~(x.outside | y.outside | z.outside);
    const floats whole = AS_FLOATS(size_x) * AS_FLOATS(size_y) * AS_FLOATS(size_z);

    /* A moment t is one of the axis x, y, or z, whichever is all bits. */
    longs by_z = WHERE(z.in >= x.in) & WHERE(z.in >= y.in);
    longs by_y = WHERE(y.in >= x.in) & ~by_z;
    longs by_x = ~(by_y | by_z);
    longs t = max(x.in, max(y.in, z.in));
    longs end = min(x.past, min(y.past, z.past));
    longs ends_x = WHERE(x.past <= y.past) & WHERE(x.past <= z.past);
    longs ends_z = ~ends_x & WHERE(z.past < y.past);
    /* What is met at once is cut open, unless that is where the grid ends. */
    const longs opened =
        (by_x & EITHER(x.turned, -(long)(high.x < shape.x), -(long)(low.x > 0)))
        | (by_y & EITHER(y.turned, -(long)(high.y < shape.y), -(long)(low.y > 0)))
        | (by_z & EITHER(z.turned, -(long)(high.z < shape.z), -(long)(low.z > 0)));
    longs cut = opened & (CUT | (by_y & 1) | (by_z & 2));
    if (begins) {
        const longs behind = WHERE(t < 0) | (WHERE(t == 0) & ~by_z);
        t &= ~behind;
        by_x &= ~behind;
        by_y &= ~behind;
        by_z |= behind;
        cut = EITHER(behind, (long)(CUT | 2), cut);
    }
#if PLANE
    {
        const longs slope = plane.x * part_x + plane.y * part_y + plane.z * part_z;
        const longs rest =
            plane.w - (plane.x * place_x + plane.y * place_y + plane.z * place_z);
        const longs level = WHERE(slope == 0), nears = WHERE(slope < 0);
        going &= ~(level & WHERE(rest < 0));
        const longs meets = moments_at_plane(
            (rest ^ nears) - nears, EITHER(level, 1L, (slope ^ nears) - nears),
            size_x * size_y * size_z);
        const longs later = nears & (WHERE(t < meets) | (WHERE(t == meets) & ~by_z));
        t = EITHER(later, meets, t);
        by_x &= ~later;
        by_y &= ~later;
        by_z |= later;
        cut = EITHER(later, (long)(CUT | BY_PLANE), cut);
        const longs sooner = ~nears & ~level & WHERE(meets < end);
        end = EITHER(sooner, meets, end);
        ends_x &= ~sooner;
        ends_z |= sooner;
    }
#endif
#if TILE
    {
        const longs meets = AS_LONGS(LOAD(start_of) * whole);
        const longs later = WHERE(t < meets) | (WHERE(t == meets) & ~by_z);
        t = EITHER(later, meets, t);
        by_x &= ~later;
        by_y &= ~later;
        by_z |= later;
        cut &= ~later;
    }
#endif
    const longs begin = t, begun_x = by_x, begun_z = by_z;
    /* A moment along an axis is before the end if it is below these. */
    const longs end_x = end + (~ends_x & 1), end_y = end + (ends_z & 1);

    const longs apart_x = x.step * SIDE_X, apart_y = y.step * SIDE_Y, apart_z = z.step * SIDE_Z;
    const floats pace_x = x.pace / SIDE_X, pace_y = y.pace / SIDE_Y, pace_z = z.pace / SIDE_Z;
    /* The numbers of cells, and when they are left. */
    longs cell_x = planes_met(t - x.zero, apart_x, pace_x) + x.standing / SIDE_X;
    longs cell_y = planes_met(t - y.zero + by_x, apart_y, pace_y) + y.standing / SIDE_Y;
    longs cell_z = planes_met(t - z.zero + ~by_z, apart_z, pace_z) + z.standing / SIDE_Z;
    longs cell_out_x = x.zero + (cell_x + 1) * apart_x;
    longs cell_out_y = y.zero + (cell_y + 1) * apart_y;
    longs cell_out_z = z.zero + (cell_z + 1) * apart_z;
    cell_x = EITHER(x.turned, columns.x - 1 - cell_x, cell_x);
    cell_y = EITHER(y.turned, columns.y - 1 - cell_y, cell_y);
    cell_z = EITHER(z.turned, columns.z - 1 - cell_z, cell_z);
#if STATES
    const long line = cells.x, layer = line * cells.y;
    const longs go_cell_x = x.turned | 1, go_cell_y = EITHER(y.turned, -line, line);
    const longs go_cell_z = EITHER(z.turned, -layer, layer);
    longs index = cell_z * layer + cell_y * cells.x + cell_x;
#else
    const longs go_cell_x = x.turned | 1, go_cell_y = y.turned | 1, go_cell_z = z.turned | 1;
    long turned_of[WIDTH];
    STORE((x.turned & 1) | (y.turned & 2) | (z.turned & 4), turned_of);
    long x_of[WIDTH], y_of[WIDTH], z_of[WIDTH], fresh_of[WIDTH], state_in[WIDTH];
    long after_in_x[WIDTH], after_in_y[WIDTH], after_in_z[WIDTH];
    for (int lane = 0; lane < WIDTH; ++lane)
        state_in[lane] = after_in_x[lane] = after_in_y[lane] = after_in_z[lane] = 0;
#endif
#if LEVELS > 1
    /* The bit of a voxel in its brick, and how many of the brick are behind it, move with it. */
    const longs go_x = PASSED(0) + (x.turned | 1);
    const long row_bits = BRICK_X, layer_bits = BRICK_X * BRICK_Y;
    const longs go_y = PASSED(1) + EITHER(y.turned, -row_bits, row_bits);
    const longs go_z = PASSED(2) + EITHER(z.turned, -layer_bits, layer_bits);
    /* What both are for the first voxel that a ray may meet in a brick. */
    const longs corner = (x.turned & (SIDE_X - 1)) + (y.turned & ((SIDE_Y - 1) * BRICK_X))
        + (z.turned & ((SIDE_Z - 1) * BRICK_X * BRICK_Y)) + SPARE + (HALF - SIDE_X) * PASSED(0)
        + (HALF - SIDE_Y) * PASSED(1) + (HALF - SIDE_Z) * PASSED(2)
        + (x.standing - x.standing / SIDE_X * SIDE_X) * go_x
        + (y.standing - y.standing / SIDE_Y * SIDE_Y) * go_y
        + (z.standing - z.standing / SIDE_Z * SIDE_Z) * go_z;
#endif
#if LENGTHS
    longs within = 0;
#else
    longs met = 0;
#if LEVELS > 1
    longs place = 0;
#endif
#endif
    /* The cells in which rays wait until others have come as far; of which all is known then. */
    longs walked = 0;
    going &= WHERE(t < EITHER(by_x, end_x, EITHER(by_y, end_y, end)));
#if !STATES
    /* Rays that have come to a cell of which nothing is known yet. */
    longs fresh = going;
#endif
    while (any_of(going)) {
#if STATES
        const longs at = index & going;
        const longs near = LOOK_UP(distances, at);
        /* Some of these cells may be beyond the grid; they are narrow enough that moments fit. */
        const longs uniform = WHERE(near != 0), after = (near & FREE) - 1;
        const longs after_x = after, after_y = after, after_z = after;
        const longs filled = WHERE((near & INSIDE_STATE) != 0);
#else
        STORE(cell_x, x_of);
        STORE(cell_y, y_of);
        STORE(cell_z, z_of);
        STORE(fresh, fresh_of);
        for (int lane = 0; lane < WIDTH; ++lane) {
            if (fresh_of[lane])
                state_in[lane] = state_of(
                    MODEL_ARGUMENTS, columns, blocks, distances, (int)x_of[lane],
                    (int)y_of[lane], (int)z_of[lane], (int)turned_of[lane], after_in_x + lane,
                    after_in_y + lane, after_in_z + lane);
        }
        const longs state = LOAD(state_in), after_x = LOAD(after_in_x);
        const longs after_y = LOAD(after_in_y), after_z = LOAD(after_in_z);
        const longs uniform = WHERE(state >= UNIFORM);
        const longs filled = uniform & WHERE((state & INSIDE_STATE) != 0);
#endif
#if LENGTHS
        const longs stops = ~uniform & ~walked & going;
#else
        const longs stops = (~uniform | filled) & ~walked & going;
#endif
        longs moving = going & ~stops;
#if LEVELS == 1
#if !LENGTHS
        met |= stops;
        going &= ~stops;
#endif
#else
        if (!any_of(moving)) {
            const longs since_x = cell_out_x - apart_x, since_y = cell_out_y - apart_y;
            const longs since_z = cell_out_z - apart_z;
            const longs voxel_x = planes_met(t - since_x, x.step, x.pace);
            const longs voxel_y = planes_met(t - since_y + by_x, y.step, y.pace);
            const longs voxel_z = planes_met(t - since_z + ~by_z, z.step, z.pace);
            const longs held = stops & ~uniform;
            /* Of a model that is all inside there is no brick to read. */
            const bool reads = any_of(held);
#if STATES
            const longs cell = index & held, state = LOOK_UP(states, cell);
#endif
            const longs base = (state & held) * BRICK_WORDS;
            longs out_x = since_x + (voxel_x + 1) * x.step;
            longs out_y = since_y + (voxel_y + 1) * y.step;
            longs out_z = since_z + (voxel_z + 1) * z.step;
            longs at_voxel = corner + voxel_x * go_x + voxel_y * go_y + voxel_z * go_z;
            longs live = stops & WHERE((at_voxel & LEFT) == 0);
            longs now = t;
#if !LENGTHS
            longs now_x = by_x, now_y = by_y;
            longs found = 0;
#endif
            do {
                /* Who has left, or found something, steps on all the same, and nobody looks: what
                 * comes next waits for nothing that has to be looked up. */
                for (int twice = 0; twice < 2; ++twice) {
                    const longs bit = at_voxel & 0xffffffffL & live;
                    const longs words = base + (bit >> 5);
                    longs bits = 0;
                    if (reads) bits = LOOK_UP_WORDS(words);
                    const longs next = min(out_x, min(out_y, out_z));
#if LENGTHS
                    const longs taken = -(bits >> (bit & 31) & 1) & live;
                    within += (min(next, end) - min(now, end)) & taken;
#else
                    const longs taken = (-(bits >> (bit & 31) & 1) | filled) & live & ~found;
                    found |= taken;
                    t = EITHER(taken, now, t);
                    by_x = EITHER(taken, now_x, by_x);
                    by_y = EITHER(taken, now_y, by_y);
                    place = EITHER(taken, at_voxel, place);
#endif
                    const longs step_x = WHERE(out_x <= out_y) & WHERE(out_x <= out_z);
                    const longs step_y = WHERE(out_y <= out_z) & ~step_x;
                    const longs step_z = ~(step_x | step_y);
                    now = next;
#if !LENGTHS
                    now_x = step_x;
                    now_y = step_y;
#endif
                    out_x += step_x & x.step;
                    out_y += step_y & y.step;
                    out_z += step_z & z.step;
                    at_voxel += (step_x & go_x) + (step_y & go_y) + (step_z & go_z);
                    live &= WHERE((at_voxel & LEFT) == 0);
                }
#if LENGTHS
            } while (any_of(live));
#else
            } while (any_of(live & ~found));
            by_z = ~(by_x | by_y);
            met |= found;
            going &= ~found;
#endif
            walked = stops & going;
            moving = walked;
        }
#endif
        /* As far as all cells are of one kind. */
        const longs free = moving & uniform & ~walked;
        const bool jumps = any_of((after_x | after_y | after_z) & free);
        longs then_x = cell_out_x, then_y = cell_out_y, then_z = cell_out_z;
        if (jumps) {
            then_x += (after_x & free) * apart_x;
            then_y += (after_y & free) * apart_y;
            then_z += (after_z & free) * apart_z;
        }
        const longs next = min(then_x, min(then_y, then_z));
#if LENGTHS
        within += (min(next, end) - t) & filled & moving;
#endif
        const longs next_x = WHERE(then_x <= then_y) & WHERE(then_x <= then_z);
        const longs next_y = WHERE(then_y <= then_z) & ~next_x, next_z = ~(next_x | next_y);
        t = EITHER(moving, next, t);
        by_x = EITHER(moving, next_x, by_x);
        by_y = EITHER(moving, next_y, by_y);
        by_z = EITHER(moving, next_z, by_z);
        longs move_x = next_x & moving, move_y = next_y & moving, move_z = next_z & moving;
        cell_out_x += move_x & apart_x;
        cell_out_y += move_y & apart_y;
        cell_out_z += move_z & apart_z;
        move_x &= 1;
        move_y &= 1;
        move_z &= 1;
        if (jumps) {
            /* The plane of the jump is passed; so are all before it. */
            const longs far_x = moving & planes_met(next - cell_out_x + apart_x, apart_x, pace_x);
            const longs far_y =
                moving & planes_met(next - cell_out_y + apart_y + next_x, apart_y, pace_y);
            const longs far_z =
                moving & planes_met(next - cell_out_z + apart_z + ~next_z, apart_z, pace_z);
            cell_out_x += far_x * apart_x;
            cell_out_y += far_y * apart_y;
            cell_out_z += far_z * apart_z;
            move_x += far_x;
            move_y += far_y;
            move_z += far_z;
        }
#if STATES
        index += move_x * go_cell_x + move_y * go_cell_y + move_z * go_cell_z;
#else
        cell_x += move_x * go_cell_x;
        cell_y += move_y * go_cell_y;
        cell_z += move_z * go_cell_z;
#endif
        walked &= ~moving;
        going &= WHERE(t < EITHER(by_x, end_x, EITHER(by_y, end_y, end))) | ~moving;
#if !STATES
        fresh = moving & going;
#endif
    }
#if LENGTHS
    const floats ahead_x = AS_FLOATS(part_x) * widths.x, ahead_y = AS_FLOATS(part_y) * widths.y;
    const floats ahead_z = AS_FLOATS(part_z) * widths.z;
    const floats length_of = AS_FLOATS(within) / whole / (float)(1L << bits)
        * sqrt(ahead_x * ahead_x + ahead_y * ahead_y + ahead_z * ahead_z);
    float lengths[WIDTH];
    STORE(length_of, lengths);
    for (int lane = 0; lane < count; ++lane) far[first_ray + lane] = lengths[lane];
#else
    met &= WHERE(t < EITHER(by_x, end_x, EITHER(by_y, end_y, end)));
    if (!any_of(met)) return;
    const longs at_once = WHERE(t == begin) & (by_x ^ ~begun_x) & (by_z ^ ~begun_z);
    const longs entered = EITHER(at_once & WHERE(cut != 0), cut, (by_y & 1) | (by_z & 2));
    long met_of[WIDTH], entered_of[WIDTH];
    float far_of[WIDTH];
    STORE(met, met_of);
    STORE(entered, entered_of);
    STORE(AS_FLOATS(t) / whole, far_of);
#if STATES
    long index_of[WIDTH];
    STORE(index, index_of);
#else
    STORE(cell_x, x_of);
    STORE(cell_y, y_of);
    STORE(cell_z, z_of);
#endif
#if LEVELS > 1
    long place_of[WIDTH];
    STORE(place, place_of);
#endif
    for (int lane = 0; lane < WIDTH; ++lane) {
        if (!met_of[lane]) continue;
        const ulong id = first_ray + lane;
#if STATES
        ulong number = index_of[lane];
        const int at_x = take_place(&number, cells.x);
        const int at_y = take_place(&number, cells.y), at_z = (int)number;
        const long state = states[index_of[lane]];
#else
        const int at_x = (int)x_of[lane], at_y = (int)y_of[lane], at_z = (int)z_of[lane];
#endif
#if LEVELS == 1
        const ulong word = ((ulong)at_z * cells.y + at_y) * ((cells.x + 31) / 32) + at_x / 32;
        const int kind = KIND_OF(word, at_x % 32);
        hits[4 * id] = at_x;
        hits[4 * id + 1] = at_y;
        hits[4 * id + 2] = at_z;
#else
#if !STATES
        const ulong state = cell_state(MODEL_ARGUMENTS, at_x, at_y, at_z);
#endif
        const uint bit = (uint)place_of[lane];
        const int kind = state >= UNIFORM
            ? INSIDE_CELL : KIND_OF((ulong)state * BRICK_WORDS + bit / 32, bit % 32);
        hits[4 * id] = at_x * SIDE_X + BIT_X(bit);
        hits[4 * id + 1] = at_y * SIDE_Y + BIT_Y(bit);
        hits[4 * id + 2] = at_z * SIDE_Z + BIT_Z(bit);
#endif
        hits[4 * id + 3] = (int)entered_of[lane] | KIND(kind);
        far[id] = far_of[lane];
    }
#endif
}
