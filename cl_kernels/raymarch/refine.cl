/*
 * raymarch/refine.cl: how far the rays of a small tile can go, looking into the bricks.
 *
 * Where a beam comes near something (raymarch/start.cl), parts of it are followed on in small
 * steps, each of which lies within a box; the beam goes on while no box holds a taken voxel.  A
 * brick is looked at by its 4 x 4 x 4 crumbs, one bit each, so that a box is a mask or a few.
 *
 * Host:       clvox/ops/beams.py, refine_starts(), and clvox/ops/distances.py
 * Reference:  clvox/reference/raymarch.py, brick_crumbs(); and first_voxels(), with which starts
 *             must not interfere
 * Tests:      tests/kernels/test_distances.py
 * Defines:    LEVELS, RULE, BRICK_*, MIDDLE_*  (common/model.h); RULE says what is taken
 *             TILE, WIDE_TILE  rays along the sides of a small tile and of one of find_starts()
 *             STATES  1: one word tells all about a cell (raymarch/states.h)
 */
#include "raymarch/around.h"
#include "raymarch/rays.h"
#include "raymarch/states.h"

#define CRUMBS 4
/* More than float32 is off, in crumbs, and at a distance, as a part of it. */
#define SLACK 0.02f
#define FAR_SLACK 0x1p-21f
/* A step, in crumbs, and how many there are at most; and how many crumbs wide a box may be. */
#define STRIDE 1.5f
#define STEPS 24
#define WIDEST 32

/* First and last crumb along a side of `side` voxels that hold part of one of them. */
#define FIRST_CRUMB(voxel, side) ((voxel) * CRUMBS / (side))
#define LAST_CRUMB(voxel, side) ((((voxel) + 1) * CRUMBS - 1) / (side))

/* Times these, crumbs of a row are those of all rows, and rows of a layer those of all layers. */
#define EACH_ROW 0x1111111111111111UL
#define EACH_LAYER 0x0001000100010001UL

/* The crumbs from first to last along each axis. */
static inline ulong crumbs_between(const int4 first, const int4 last)
{
    const ulong x = (2UL << last.x) - (1UL << first.x);
    const ulong y = (1UL << (4 * last.y + 4)) - (1UL << (4 * first.y));
    const ulong z = ULONG_MAX >> (48 - 16 * last.z) & ULONG_MAX << (16 * first.z);
    return x * EACH_ROW & y * EACH_LAYER & z;
}

/* The crumbs of a row of voxels along x, from voxel `first` on, whose bits are `row`. */
static inline ulong crumbs_of(uint row, const int first)
{
    ulong found = 0;
    for (int crumb = 0; crumb < CRUMBS; ++crumb) {
        /* Voxels from the one that holds the crumb's beginning to the one that holds its end. */
        const int from = max(crumb * BRICK_X / CRUMBS - first, 0);
        const int to = min(((crumb + 1) * BRICK_X - 1) / CRUMBS - first, 31);
        if (from > to) continue;
        const uint mask = (0xffffffffu >> (31 - to)) & (0xffffffffu << from);
        found |= (ulong)((row & mask) != 0) << crumb;
    }
    return found;
}

/* One work-item looks at one brick of `count`.
 * edge: which voxels are touched, if RULE says that those count.  crumbs: (bricks,) uint64, x
 * fastest, set where part of a taken voxel is. */
__kernel void crumble(
    const uint count, const __global uint *bricks, const __global uint *edge,
    __global ulong *restrict crumbs)
{
    const uint id = get_global_id(0);
    if (id >= count) return;
    ulong found = 0;
    for (int z = 0; z < BRICK_Z; ++z)
        for (int y = 0; y < BRICK_Y; ++y)
            for (int x = 0; x < BRICK_X; x += 32) {
                const int size = min(BRICK_X - x, 32);
                uint row = cell_bits(bricks, id, x, y, z, size);
#if RULE != CENTRE
                row |= cell_bits(edge, id, x, y, z, size);
#endif
                if (row == 0) continue;
                const ulong here = crumbs_of(row, x);
                for (int k = FIRST_CRUMB(z, BRICK_Z); k <= LAST_CRUMB(z, BRICK_Z); ++k)
                    for (int j = FIRST_CRUMB(y, BRICK_Y); j <= LAST_CRUMB(y, BRICK_Y); ++j)
                        found |= here << (16 * k + 4 * j);
            }
    crumbs[id] = found;
}

/* Is any of the crumbs from low to high taken?  Both are of the whole grid. */
static inline bool holds_any(
    MODEL_PARAMETERS, const int4 columns, const __global uint *states,
    const __global ulong *crumbs, const int4 low, const int4 high)
{
    ulong found = 0;
    for (int k = low.z / CRUMBS; k <= high.z / CRUMBS; ++k)
        for (int j = low.y / CRUMBS; j <= high.y / CRUMBS; ++j)
            for (int i = low.x / CRUMBS; i <= high.x / CRUMBS; ++i) {
#if STATES
                const uint state = states[((ulong)k * columns.y + j) * columns.x + i];
                const bool uniform = state >= UNIFORM;
                const bool filled = uniform && (state & INSIDE_STATE) != 0;
#else
                const ulong state = cell_state(MODEL_ARGUMENTS, i, j, k);
                const bool uniform = state >= CELL_OUTSIDE, filled = state == CELL_INSIDE;
#endif
                found |= filled;
                if (uniform) continue;
                const int4 base = (int4)(i * CRUMBS, j * CRUMBS, k * CRUMBS, 0);
                const int4 first = max(low - base, (int4)(0));
                const int4 last = min(high - base, (int4)(CRUMBS - 1));
                found |= crumbs[state] & crumbs_between(first, last);
            }
    return found != 0;
}

/* One work-item follows one small tile.
 * size: rays along a row and a column; columns: cells of voxels along each axis; per_crumb: steps
 * along the sides of a crumb.  wide_starts: (wide tiles,) float32, as find_starts() leaves
 * them.  states: of raymarch/states.h, if STATES.  crumbs: (bricks,) uint64.
 * starts: (small tiles,) float32, in directions; INFINITY for a miss. */
__kernel void refine_starts(
    const int2 size, const int4 columns, const float4 per_crumb, RAY_PARAMETERS,
    const __global float *restrict wide_starts, const __global uint *restrict states,
    const __global ulong *restrict crumbs, MODEL_PARAMETERS, __global float *restrict starts)
{
    const int tiles_x = (size.x + TILE - 1) / TILE, tiles_y = (size.y + TILE - 1) / TILE;
    const uint id = get_global_id(0);
    if (id >= (uint)tiles_x * tiles_y) return;
    const int tile_y = (int)(id / tiles_x), tile_x = (int)(id - (uint)tile_y * tiles_x);
    const int wide_tiles = (size.x + WIDE_TILE - 1) / WIDE_TILE;
    float t = wide_starts[tile_y * TILE / WIDE_TILE * wide_tiles + tile_x * TILE / WIDE_TILE];
    starts[id] = t;
    if (t == INFINITY) return;
    /* The lowest and the highest place and direction of the rays at the corners. */
    float4 from = (float4)(INFINITY), to = -from, slowest = from, fastest = to;
    for (int corner = 0; corner < 4; ++corner) {
        const int u = min(tile_x * TILE + (corner & 1) * (TILE - 1), size.x - 1);
        const int v = min(tile_y * TILE + (corner >> 1) * (TILE - 1), size.y - 1);
        const float4 place = (float4)((float)PLACE_OF(x, u, v), (float)PLACE_OF(y, u, v),
                                      (float)PLACE_OF(z, u, v), 0.0f);
        const float4 ahead = (float4)((float)DIRECTION_OF(x, u, v), (float)DIRECTION_OF(y, u, v),
                                      (float)DIRECTION_OF(z, u, v), 0.0f);
        from = fmin(from, place);
        to = fmax(to, place);
        slowest = fmin(slowest, ahead);
        fastest = fmax(fastest, ahead);
    }
    /* Rays between them are rounded on their own; and a whole unit of direction is more than is
     * lost where places are multiplied out, here and where rays set off. */
    from = (from - 1.0f) / per_crumb;
    to = (to + 1.0f) / per_crumb;
    const float4 slack = SLACK + FAR_SLACK * fmax(fabs(from), fabs(to));
    from -= slack;
    to += slack;
    slowest = (slowest - 1.0f) / per_crumb;
    fastest = (fastest + 1.0f) / per_crumb;
    const float4 pace = fmax(fabs(slowest), fabs(fastest));
    const float stride = STRIDE / fmax(pace.x, fmax(pace.y, pace.z));
    const int4 last = columns * CRUMBS - 1;
    for (int step = 0; step < STEPS; ++step) {
        const float then = t + stride;
        const float4 low = fmin(from + t * slowest, from + then * slowest);
        const float4 high = fmax(to + t * fastest, to + then * fastest);
        const int4 first_crumb = convert_int4_rtn(low), last_crumb = convert_int4_rtn(high);
        if (first_crumb.x <= last.x && first_crumb.y <= last.y && first_crumb.z <= last.z
            && last_crumb.x >= 0 && last_crumb.y >= 0 && last_crumb.z >= 0) {
            const int4 begin = max(first_crumb, (int4)(0)), end = min(last_crumb, last);
            const int4 size = end - begin;
            if (size.x >= WIDEST || size.y >= WIDEST || size.z >= WIDEST
                || holds_any(MODEL_ARGUMENTS, columns, states, crumbs, begin, end))
                break;
        }
        t = then;
    }
    starts[id] = t;
}
