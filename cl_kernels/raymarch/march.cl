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
 *             TILE     places along the side of a tile that `starts` knows of; 0 without
 *             BLOCK_*  cells along the sides of a block, if TILE is not 0
 *             LISTED, SAMPLES, EACH  (raymarch/samples.h)
 *             PLANE    1: a plane cuts something away; with PLANE_BITS and TIME_BITS
 *             STATES   1: blocks are cells, and one word tells all about each
 * Source:     after Amanatides and Woo, "A fast voxel traversal algorithm for ray tracing",
 *             Eurographics 1987.
 */
#include "common/model.h"
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

/* After so many empty cells in a row a ray asks how far the next thing is.  Where nothing changes
 * for so many blocks it goes on at once. */
#define IDLE 6
#define WORTH 3

#if RULE == CENTRE
#define IS_TAKEN(word, bit) (bricks[word] >> (bit) & 1)
#define KIND_OF(word, bit) INSIDE_VOXEL
#else
#define IS_TAKEN(word, bit) ((bricks[word] | edge[word]) >> (bit) & 1)
#define KIND_OF(word, bit) (edge[word] >> (bit) & 1 ? TOUCHED_VOXEL : INSIDE_VOXEL)
#endif

/* The first thing is met at the moment (since, along): note it, and end the walk. */
#define MEET(x, y, z, since, along, kind) \
    do { \
        hits[4 * id] = x; \
        hits[4 * id + 1] = y; \
        hits[4 * id + 2] = z; \
        hits[4 * id + 3] = (cut && since == begin && along == begun ? cut : along) | KIND(kind); \
        far[id] = (float)since / whole; \
    } while (0)

/* The cell in which the ray is, along one axis of the grid. */
#define PLACE_IN_GRID(axis) (axis.turned ? columns.axis - 1 - cell_##axis : cell_##axis)

#if STATES
#define INDEX ((PLACE_IN_GRID(z) * cells.y + PLACE_IN_GRID(y)) * cells.x + PLACE_IN_GRID(x))
#define GO(axis) index += go_cell_##axis
#else
#define GO(axis) cell_##axis += 1
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

#if TILE && !STATES

/* The moment at which everything within `free` blocks of the block `near` is left along an axis,
 * or the grid, of `columns` cells of `side` voxels, `block` to a block. */
static inline long moment_beyond(
    const Along *along, const int near, const int free, const int block, const int columns,
    const int side)
{
    if (along->step == 0) return LONG_MAX;
    const int cell = along->turned ? columns - (near - free + 1) * block : (near + free) * block;
    return along->zero + (long)min(cell, columns) * side * along->step;
}

#endif

/* One work-item follows one ray.
 * shape: voxels of the grid; columns: cells of voxels along each axis, the voxels themselves in a
 * dense grid; low, high: the voxels that are drawn; plane: if PLANE is set, its normal, and what
 * the product of that and a place is at most.
 * starts: (tiles,) float32, for each tile of TILE x TILE places how far nothing is met, in
 * directions; INFINITY if nothing is met at all.  blocks, distances: shape of the grid of blocks,
 * and for each how far it is from one that is not empty.  None of the three is read unless TILE is
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
    const ulong id = get_global_id(0);
    const ulong item = id / RAYS;
    if (item >= pixel_count) return;
    const int2 ray = ray_of_sample(NUMBER_OF_PIXEL(item), picture.x, (int)(id - item * RAYS));
    const int row = ray.y, column = ray.x;
#if LENGTHS
    far[id] = 0.0f;
    long within = 0;
#else
    hits[4 * id] = hits[4 * id + 1] = hits[4 * id + 2] = -1;
    hits[4 * id + 3] = 0;
    far[id] = INFINITY;
#endif
#if TILE
    const int tiles = (picture.x * PLACES + TILE - 1) / TILE;
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
    int last = first_axis(past_x, past_y, past_z);
    long end = one_of(last, past_x, past_y, past_z);
    /* What is met at once is cut open, unless that is where the grid ends. */
    const bool opened = axis == 0 ? (part_x < 0 ? high.x < shape.x : low.x > 0)
             : axis == 1 ? (part_y < 0 ? high.y < shape.y : low.y > 0)
                         : (part_z < 0 ? high.z < shape.z : low.z > 0);
    int cut = opened ? CUT | axis : 0;
    if (begins && is_before(t, axis, 0, 2)) {
        t = 0;
        axis = 2;
        cut = CUT | 2;
    }
#if PLANE
    const long slope = plane.x * part_x + plane.y * part_y + plane.z * part_z;
    const long rest = plane.w - (plane.x * place_x + plane.y * place_y + plane.z * place_z);
    if (slope == 0 && rest < 0) return;
    if (slope != 0) {
        const long meets = moment_at_plane(
            slope < 0 ? -rest : rest, slope < 0 ? -slope : slope, size_x * size_y * size_z);
        if (slope < 0 && is_before(t, axis, meets, 2)) {
            t = meets;
            axis = 2;
            cut = CUT | BY_PLANE;
        }
        if (slope > 0 && is_before(meets, 2, end, last)) {
            end = meets;
            last = 2;
        }
    }
#endif
#if TILE
    const long later = (long)(start_at * whole);
    if (is_before(t, axis, later, 2)) {
        t = later;
        axis = 2;
        cut = 0;
    }
#endif
    const long begin = t;
    const int begun = axis;
    /* A moment along an axis is before the end if it is below these. */
    const long end_x = end + (0 < last), end_y = end + (1 < last), end_z = end;

    int cell_x = cells_passed(&x, x.zero, SIDE_X, x.standing, t, axis, 0);
    int cell_y = cells_passed(&y, y.zero, SIDE_Y, y.standing, t, axis, 1);
    int cell_z = cells_passed(&z, z.zero, SIDE_Z, z.standing, t, axis, 2);
    long cell_out_x = moment_out(&x, x.zero, SIDE_X, cell_x);
    long cell_out_y = moment_out(&y, y.zero, SIDE_Y, cell_y);
    long cell_out_z = moment_out(&z, z.zero, SIDE_Z, cell_z);
    const long apart_x = x.step * SIDE_X, apart_y = y.step * SIDE_Y, apart_z = z.step * SIDE_Z;
#if LEVELS > 1
    /* The bit of a voxel in its brick, and how many of the brick are behind it, move with it. */
    const long go_x = PASSED(0) + (x.turned ? -1 : 1);
    const long go_y = PASSED(1) + (y.turned ? -BRICK_X : BRICK_X);
    const long go_z = PASSED(2) + (z.turned ? -BRICK_X * BRICK_Y : BRICK_X * BRICK_Y);
    /* Where in their bricks rays are that stand still along an axis. */
    const int still_x = place_in(x.standing, SIDE_X), still_y = place_in(y.standing, SIDE_Y);
    const int still_z = place_in(z.standing, SIDE_Z);
    /* What both are for the first voxel that a ray may meet in a brick. */
    const long corner =
        ((z.turned ? SIDE_Z - 1 : 0) * BRICK_Y + (y.turned ? SIDE_Y - 1 : 0)) * BRICK_X
        + (x.turned ? SIDE_X - 1 : 0) + SPARE + (HALF - SIDE_X) * PASSED(0)
        + (HALF - SIDE_Y) * PASSED(1) + (HALF - SIDE_Z) * PASSED(2);
#endif
#if STATES
    const int go_cell_x = x.turned ? -1 : 1, go_cell_y = y.turned ? -cells.x : cells.x;
    const int go_cell_z = z.turned ? -cells.x * cells.y : cells.x * cells.y;
    int index = INDEX;
#elif TILE
    int idle = 0;
#endif
    bool going = is_before(t, axis, end, last);
    while (going) {
#if STATES
        const uint state = states[index];
        /* An empty cell with something near it: most are. */
        const bool passed = state - (UNIFORM + 1) < WORTH - 1;
#else
        const bool passed = false;
#endif
        if (!passed) {
#if STATES
            const bool uniform = state >= UNIFORM;
            const int free = uniform ? (int)(state & FREE) : 0;
            const bool within_cell = uniform && (state & INSIDE_STATE) != 0;
#else
            const int at_x = PLACE_IN_GRID(x), at_y = PLACE_IN_GRID(y), at_z = PLACE_IN_GRID(z);
#if LEVELS == 1
            const ulong word = ((ulong)at_z * cells.y + at_y) * ((cells.x + 31) / 32) + at_x / 32;
            const bool uniform = !IS_TAKEN(word, at_x % 32), within_cell = false;
#else
            const ulong state = cell_state(MODEL_ARGUMENTS, at_x, at_y, at_z);
            const bool uniform = state >= CELL_OUTSIDE, within_cell = state == CELL_INSIDE;
#endif
#endif
#if LENGTHS
            const bool entered = !uniform;
#else
            const bool entered = !uniform || within_cell;
#endif
            if (entered) {
#if LEVELS == 1
#if LENGTHS
                within += min(min(cell_out_x, min(cell_out_y, cell_out_z)), end) - t;
#else
                MEET(at_x, at_y, at_z, t, axis, KIND_OF(word, at_x % 32));
                break;
#endif
#else
                const long since_x = cell_out_x - apart_x, since_y = cell_out_y - apart_y;
                const long since_z = cell_out_z - apart_z;
                const int voxel_x = cells_passed(&x, since_x, 1, still_x, t, axis, 0);
                const int voxel_y = cells_passed(&y, since_y, 1, still_y, t, axis, 1);
                const int voxel_z = cells_passed(&z, since_z, 1, still_z, t, axis, 2);
                const ulong base = (ulong)state * BRICK_WORDS;
                long out_x = moment_out(&x, since_x, 1, voxel_x);
                long out_y = moment_out(&y, since_y, 1, voxel_y);
                long out_z = moment_out(&z, since_z, 1, voxel_z);
                long place = corner + voxel_x * go_x + voxel_y * go_y + voxel_z * go_z;
#if LENGTHS
                /* Lengths are added where they begin and end. */
                bool inside_it = false;
                long now = t;
                while (!(place & LEFT)) {
                    if (IS_TAKEN(base + (uint)place / 32, (uint)place % 32) != inside_it) {
                        within += inside_it ? min(now, end) : -min(now, end);
                        inside_it = !inside_it;
                    }
                    if (out_x <= out_y && out_x <= out_z) {
                        now = out_x;
                        out_x += x.step;
                        place += go_x;
                    } else if (out_y <= out_z) {
                        now = out_y;
                        out_y += y.step;
                        place += go_y;
                    } else {
                        now = out_z;
                        out_z += z.step;
                        place += go_z;
                    }
                }
                if (inside_it) within += min(now, end);
#else
                long before = place;
                while (!(place & LEFT)) {
                    if (within_cell || IS_TAKEN(base + (uint)place / 32, (uint)place % 32)) break;
                    before = place;
                    if (out_x <= out_y && out_x <= out_z) {
                        out_x += x.step;
                        place += go_x;
                    } else if (out_y <= out_z) {
                        out_y += y.step;
                        place += go_y;
                    } else {
                        out_z += z.step;
                        place += go_z;
                    }
                }
                if (!(place & LEFT)) {
                    /* The last step tells when, and along which axis, the voxel is entered. */
                    const long step = place - before;
                    const int stepped = step == go_x ? 0 : (step == go_y ? 1 : 2);
                    const int along = step == 0 ? axis : stepped;
                    const long moment =
                        one_of(stepped, out_x - x.step, out_y - y.step, out_z - z.step);
                    const long now = step == 0 ? t : moment;
                    const uint bit = (uint)place;
#if STATES
                    ulong number = index;
                    const int at_x = take_place(&number, cells.x);
                    const int at_y = take_place(&number, cells.y), at_z = (int)number;
#endif
                    if (is_before(now, along, end, last))
                        MEET(at_x * SIDE_X + BIT_X(bit), at_y * SIDE_Y + BIT_Y(bit),
                             at_z * SIDE_Z + BIT_Z(bit), now, along,
                             within_cell ? INSIDE_CELL : KIND_OF(base + bit / 32, bit % 32));
                    break;
                }
#endif
#endif
            }
#if STATES
            if (free >= WORTH) {
                /* As far as all cells within `free` of this one reach, but for the last of them. */
                const long then_x = cell_out_x + (free - 1) * apart_x;
                const long then_y = cell_out_y + (free - 1) * apart_y;
                const long then_z = cell_out_z + (free - 1) * apart_z;
                const long since = t;
                axis = first_axis(then_x, then_y, then_z);
                t = one_of(axis, then_x, then_y, then_z);
#if LENGTHS
                within += within_cell ? min(t, end) - since : 0;
#endif
                const int by_x = cells_passed(&x, cell_out_x - apart_x, SIDE_X, 0, t, axis, 0);
                const int by_y = cells_passed(&y, cell_out_y - apart_y, SIDE_Y, 0, t, axis, 1);
                const int by_z = cells_passed(&z, cell_out_z - apart_z, SIDE_Z, 0, t, axis, 2);
                cell_out_x += by_x * apart_x;
                cell_out_y += by_y * apart_y;
                cell_out_z += by_z * apart_z;
                index += by_x * go_cell_x + by_y * go_cell_y + by_z * go_cell_z;
                going = is_before(t, axis, end, last);
                continue;
            }
#elif TILE
            /* Rays that have met nothing for a while may be far from everything. */
            idle = uniform && !within_cell ? idle + 1 : 0;
            if (idle >= IDLE) {
                idle = 0;
                const int near_x = at_x / BLOCK_X, near_y = at_y / BLOCK_Y, near_z = at_z / BLOCK_Z;
                const int free = distances[((ulong)near_z * blocks.y + near_y) * blocks.x + near_x];
                if (free >= WORTH) {
                    const long then_x = moment_beyond(&x, near_x, free, BLOCK_X, columns.x, SIDE_X);
                    const long then_y = moment_beyond(&y, near_y, free, BLOCK_Y, columns.y, SIDE_Y);
                    const long then_z = moment_beyond(&z, near_z, free, BLOCK_Z, columns.z, SIDE_Z);
                    axis = first_axis(then_x, then_y, then_z);
                    t = one_of(axis, then_x, then_y, then_z);
                    cell_x = cells_passed(&x, x.zero, SIDE_X, x.standing, t, axis, 0);
                    cell_y = cells_passed(&y, y.zero, SIDE_Y, y.standing, t, axis, 1);
                    cell_z = cells_passed(&z, z.zero, SIDE_Z, z.standing, t, axis, 2);
                    cell_out_x = moment_out(&x, x.zero, SIDE_X, cell_x);
                    cell_out_y = moment_out(&y, y.zero, SIDE_Y, cell_y);
                    cell_out_z = moment_out(&z, z.zero, SIDE_Z, cell_z);
                    going = is_before(t, axis, end, last);
                    continue;
                }
            }
#endif
#if LENGTHS
            if (within_cell) within += min(min(cell_out_x, min(cell_out_y, cell_out_z)), end) - t;
#endif
        }
        if (cell_out_x <= cell_out_y && cell_out_x <= cell_out_z) {
            t = cell_out_x;
            axis = 0;
            going = t < end_x;
            cell_out_x += apart_x;
            GO(x);
        } else if (cell_out_y <= cell_out_z) {
            t = cell_out_y;
            axis = 1;
            going = t < end_y;
            cell_out_y += apart_y;
            GO(y);
        } else {
            t = cell_out_z;
            axis = 2;
            going = t < end_z;
            cell_out_z += apart_z;
            GO(z);
        }
    }
#if LENGTHS
    const float ahead_x = (float)part_x * widths.x, ahead_y = (float)part_y * widths.y;
    const float ahead_z = (float)part_z * widths.z;
    far[id] = (float)within / whole / (float)(1L << bits)
            * sqrt(ahead_x * ahead_x + ahead_y * ahead_y + ahead_z * ahead_z);
#endif
}
