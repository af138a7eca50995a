/*
 * lists/list_tiles.cl: the crossings of each ray, in order, tile by tile.
 *
 * A tile's counts lie in local memory and its part of the lists in a cache, so that each crossing
 * costs no trip to memory.  First the crossings are counted, per ray and per row of a tile; the
 * rows are scanned, in the order of the rays; then the crossings are written, and each ray's
 * sorted.  Where memory is short, tiles of one window of the rays are done after those of another,
 * and the triangles of a window in parts.
 *
 * Host:       clvox/ops/lists.py, list_crossings()
 * Reference:  clvox/reference/lists.py, list_crossings()
 * Tests:      tests/kernels/test_lists.py
 * Defines:    AXIS           axis of the rays: 0, 1 or 2
 *             STEP_BITS      log2 of the lattice steps in one voxel
 *             FRACTION_BITS  of the depths
 *             SINK           0: COUNT, 3: EMIT
 *             SIDE_U         rays along the sides of a tile
 *             SIDE_V
 *             SHORT          longest row of crossings that one work-item sorts
 *             GROUP          work-items that do a tile; 1 does without atomic operations
 *             MORE           1 to count triangles after others
 *             NUMBERED       1 if triangles have other numbers than their places in `faces`
 */
#include "common/rays.h"
#include "lists/tiles.h"

#define COUNT 0
#define EMIT 3
#define FIRST 1
#define LAST 2

#if NUMBERED
#define NUMBERS_PARAMETER const __global uint *numbers,
#define NUMBERS numbers,
#define NUMBER_OF(triangle) numbers[triangle]
#else
#define NUMBERS_PARAMETER
#define NUMBERS
#define NUMBER_OF(triangle) (triangle)
#endif

/* Triangles that a work-item loads together, so that it waits for memory once: where it is alone
 * with its cache, and has the room. */
#if GROUP == 1
#define NEXT(counter) ((*(counter))++)
#define BATCH 32
#else
#define NEXT(counter) atomic_inc(counter)
#define BATCH 1
#endif

/* next: per ray of the tile, its crossings so far, from the place of its first in the row on. */
typedef struct {
    int fast, slow;
    __local uint *next;
#if SINK == EMIT
    const __local ulong *bases;
    __global int *depths;
    __global uint *sides;
    uint side;
#endif
} Sink;

#if SINK == EMIT

/* A crossing's depth, to the next place of a ray; base: where its row begins. */
static inline void put(Sink *sink, __local uint *next, const ulong base, const int depth)
{
    const ulong at = base + NEXT(next);
    sink->depths[at] = depth;
    sink->sides[at] = sink->side;
}

/* What the other rasteriser hands on. */
static inline void cross(Sink *sink, const int u, const int v, const int depth)
{
    const int row = SLOW_OF(u, v) - sink->slow;
    put(sink, sink->next + row * TILE_WIDE + (FAST_OF(u, v) - sink->fast), sink->bases[row], depth);
}

#endif

#include "lists/lanes.h"

#if SINK == EMIT
#define EDGE_BITS 64
#include "crossings/rasterise.h"
#include "lists/rasterise_quick.h"
#else
#if GROUP == 1
#include "lists/count_lanes.h"
#define COUNT_NARROW count_lanes
#else
#define EDGE int
#define COUNT_COVERED count_narrow
#include "lists/count_covered.h"
#undef EDGE
#undef COUNT_COVERED
#define COUNT_NARROW count_narrow
#endif
#define EDGE long
#define COUNT_COVERED count_wide
#include "lists/count_covered.h"
#endif

/* Do the triangle's edge functions, in units of a voxel, fit an int, also one step beyond? */
static inline bool is_narrow(const Facet f)
{
    const int2 low = min(min(f.a.xy, f.b.xy), f.c.xy);
    const int2 high = max(max(f.a.xy, f.b.xy), f.c.xy);
    const long2 side = convert_long2(high - low);
    return ((side.x * side.y) >> STEP_BITS) + side.x + side.y < (long)INT_MAX - 16;
}

/* All crossings of the tile's rays with the tile's triangles, into the sink. */
static inline void cast_tile(
    Sink *sink, const int4 rays, const __global int *faces, const __global int *vertices,
    NUMBERS_PARAMETER const __global uint *triangles, const ulong first, const ulong last)
{
#if SINK == EMIT
    Found found;
    found.count = 0;
#endif
    Facet batch[BATCH];
    for (ulong at = first + get_local_id(0); at < last; at += BATCH * GROUP) {
        const int size = (int)min((ulong)BATCH, (last - at - 1) / GROUP + 1);
        for (int i = 0; i < size; ++i)
            batch[i] = load_facet(faces, vertices, triangles[at + i * GROUP]);
        for (int i = 0; i < size; ++i) {
            const Facet f = batch[i];
            const int4 box = ray_box(f, rays);
#if SINK == EMIT
            sink->side = NUMBER_OF(triangles[at + i * GROUP]) << 1 | f.flipped;
            if (is_narrow(f) && is_quick(f)) {
                rasterise_quick(sink, f, box);
            } else {
                rasterise(sink, &found, f, box);
                drain(&found, sink);
            }
#else
            if (is_narrow(f)) COUNT_NARROW(sink, f, box);
            else count_wide(sink, f, box);
#endif
        }
    }
}

#if SINK == COUNT

#if MORE
#define ADD_TO(sum, found) ((sum) += (found))
#else
#define ADD_TO(sum, found) ((sum) = (found))
#endif

/* One group counts the crossings of one tile.
 * first, last: tiles of the window.  window: rays from the first of a tile on.  along: all rays
 * along fast.  part: as for write_tile.
 * starts: (tiles + 1,) uint64, where each tile's entries of `triangles` begin.
 * rows: (all rays along slow, tiles along fast) uint32, crossings of each row of each tile; and
 * offsets: per ray, takes its number of crossings for now; undefined on entry unless MORE. */
__kernel void count_tile(
    const ulong first, const ulong last, const int4 window, const int along, const int part,
    const __global int *restrict faces, const __global int *restrict vertices, NUMBERS_PARAMETER
    const __global ulong *restrict starts, const __global uint *restrict triangles,
    __global uint *restrict rows, __global ulong *restrict offsets)
{
    /* Lanes beyond the last ray are written, unchanged. */
    __local uint next[RAYS + RAY_LANES];
    const ulong tile = first + get_global_id(0) / GROUP;
    const bool live = tile < last;
    for (int ray = get_local_id(0); ray < RAYS + RAY_LANES; ray += GROUP) next[ray] = 0;
    barrier(CLK_LOCAL_MEM_FENCE);
    const int4 rays = tile_window(window, live ? tile : first);
    Sink sink;
    sink.fast = FAST_OF(rays.x, rays.y);
    sink.slow = SLOW_OF(rays.x, rays.y);
    sink.next = next;
    if (live)
        cast_tile(
            &sink, rays, faces, vertices, NUMBERS triangles, starts[tile], starts[tile + 1]);
    barrier(CLK_LOCAL_MEM_FENCE);
    if (!live) return;
    const int count = FAST_OF(rays.z, rays.w) - sink.fast + 1;
    const int tiles = (along - 1) / TILE_WIDE + 1;
    for (int row = get_local_id(0); row <= SLOW_OF(rays.z, rays.w) - sink.slow; row += GROUP) {
        const ulong slow = sink.slow + row;
        __global ulong *counts = offsets + slow * along + sink.fast;
        __global uint *in_row = rows + slow * tiles + sink.fast / TILE_WIDE;
        uint sum = 0;
        for (int ray = 0; ray < count; ++ray) {
            ADD_TO(counts[ray], next[row * TILE_WIDE + ray]);
            sum += next[row * TILE_WIDE + ray];
        }
        ADD_TO(*in_row, sum);
    }
}

#else

/* A ray's crossings in order of depth, triangle and sign. */
static inline void sort_row(__global int *depths, __global uint *sides, const uint length)
{
    for (uint i = 1; i < length; ++i) {
        const int depth = depths[i];
        const uint side = sides[i];
        uint at = i;
        for (; at > 0; --at) {
            const int before = depths[at - 1];
            if (before < depth || (before == depth && sides[at - 1] < side)) break;
            depths[at] = before;
            sides[at] = sides[at - 1];
        }
        depths[at] = depth;
        sides[at] = side;
    }
}

/* One group writes the crossings of one tile.
 * part: FIRST if no other triangles have been written before, and LAST if none come after.
 * all_rays, total: of all windows, and crossings of theirs.
 * row_starts: (rows,) uint64, exclusive prefix sum of `rows`.
 * offsets: (all_rays + 1,) uint64, per ray from its number of crossings to where they begin, and
 * between the parts to where those of the next are to go; the last entry, undefined on entry,
 * takes the total.
 * depths: int32, sides: triangle * 2 + (1 if the ray goes in), undefined on entry.
 * found: (2,) uint32, zero on entry: rays with more than SHORT crossings, and the most of them;
 * they are not sorted.  list: their numbers; lengths: of crossings, in the same order, which is
 * none. */
__kernel void write_tile(
    const ulong first, const ulong last, const int4 window, const int along, const int part,
    const __global int *restrict faces, const __global int *restrict vertices, NUMBERS_PARAMETER
    const __global ulong *restrict starts, const __global uint *restrict triangles,
    const ulong all_rays, const ulong total, const __global ulong *restrict row_starts,
    __global ulong *restrict offsets,
    __global int *depths, __global uint *sides,
    __global uint *found, __global ulong *restrict list, __global uint *restrict lengths)
{
    __local uint next[RAYS];
    __local ulong bases[TILE_HIGH];
    const ulong tile = first + get_global_id(0) / GROUP;
    const bool live = tile < last;
    const int4 rays = tile_window(window, live ? tile : first);
    Sink sink;
    sink.fast = FAST_OF(rays.x, rays.y);
    sink.slow = SLOW_OF(rays.x, rays.y);
    sink.next = next;
    sink.bases = bases;
    sink.depths = depths;
    sink.sides = sides;
    const int count = FAST_OF(rays.z, rays.w) - sink.fast + 1;
    const int height = SLOW_OF(rays.z, rays.w) - sink.slow + 1;
    const int tiles = (along - 1) / TILE_WIDE + 1;
    for (int row = get_local_id(0); live && row < height; row += GROUP) {
        const ulong slow = sink.slow + row;
        __global ulong *begins = offsets + slow * along + sink.fast;
        const ulong base = row_starts[slow * tiles + sink.fast / TILE_WIDE];
        uint place = 0;
        for (int ray = 0; (part & FIRST) && ray < count; ++ray) {
            const uint length = (uint)begins[ray];
            begins[ray] = base + place;
            next[row * TILE_WIDE + ray] = place;
            place += length;
        }
        for (int ray = 0; !(part & FIRST) && ray < count; ++ray)
            next[row * TILE_WIDE + ray] = (uint)(begins[ray] - base);
        bases[row] = base;
    }
    if (tile == 0 && get_local_id(0) == 0) offsets[all_rays] = total;
    barrier(CLK_LOCAL_MEM_FENCE);
    if (live)
        cast_tile(
            &sink, rays, faces, vertices, NUMBERS triangles, starts[tile], starts[tile + 1]);
    barrier(CLK_LOCAL_MEM_FENCE | CLK_GLOBAL_MEM_FENCE);
    if (!live) return;
    for (int ray = get_local_id(0); ray < height * TILE_WIDE; ray += GROUP) {
        const int row = ray / TILE_WIDE;
        const int at = ray - row * TILE_WIDE;
        if (at >= count) continue;
        __global ulong *begins = offsets + (ulong)(sink.slow + row) * along + sink.fast;
        if (!(part & LAST)) {
            begins[at] = bases[row] + next[ray];
            continue;
        }
        /* What was counted up has come to where the next ray begins. */
        const uint begin = at ? next[ray - 1] : 0;
        if (!(part & FIRST)) begins[at] = bases[row] + begin;
        const uint length = next[ray] - begin;
        if (length <= SHORT) {
            sort_row(depths + bases[row] + begin, sides + bases[row] + begin, length);
        } else {
            const uint entry = atomic_inc(found);
            atomic_max(found + 1, length);
            list[entry] = (ulong)(sink.slow + row) * along + (sink.fast + at);
            lengths[entry] = length;
        }
    }
}

#endif
