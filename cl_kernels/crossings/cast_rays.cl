/*
 * crossings/cast_rays.cl: every crossing of a bundle of parallel rays with a mesh, into a sink.
 *
 * The one rasteriser of the project: a sink, chosen when it is built, counts the crossings, flips
 * bits of a dense grid or of the bricks of a model, or lists the crossings.  It costs one pass over
 * the triangles, and work grows with triangles and crossings, never with their product.
 *
 * Host:       clvox/ops/crossings.py
 * Reference:  clvox/reference/crossings.py
 * Tests:      tests/kernels/test_crossings.py
 * Defines:    AXIS       axis of the rays: 0, 1 or 2; 1 for the sinks DENSE and BRICKS
 *             STEP_BITS  log2 of the lattice steps in one voxel
 *             SINK       0: COUNT, 1: DENSE, 2: BRICKS, 3: EMIT (crossings/sinks.h)
 *             EDGE_BITS  32 for cast_direct, 64 for cast_tiles (crossings/planes.h)
 *             WIDE       1 if triangles have more than some candidate rays each, 0 if hardly
 *             RUN        triangles in a row that one work-item does directly
 *             DIRECT     most candidate rays of a triangle that is done directly
 *             FEW        most of a sliver that is
 *             TILE       its square is about how many candidates a tile has (common/tiles.h)
 *             LEVELS, BRICK_*, MIDDLE_*  of the model, for the sink BRICKS (common/bricks.h)
 *             FRACTION_BITS  of the depths, for the sink EMIT
 * Source:     after M. Schwarz, H.-P. Seidel, "Fast parallel surface and solid voxelization on
 *             GPUs", ACM TOG 29(6), 2010, in integers and with ties broken by an infinitesimal.
 */
#include "common/rays.h"
#include "common/tiles.h"
#include "crossings/sinks.h"

#define CUBIC_BRICKS(side) (BRICK_X == side && BRICK_Y == side && BRICK_Z == side)
#if SINK == BRICKS && WIDE && EDGE_BITS == 32 && DIRECT <= 1 << 12 \
    && (CUBIC_BRICKS(4) || CUBIC_BRICKS(8))
#include "crossings/patches.h"
#else
#include "crossings/rasterise.h"
#endif

/* A triangle done directly spans less than one voxel more than its rays along u and along v.  So
 * its edge functions, in units of a voxel, stay below 4 * DIRECT * STEP <= 2^30 in its box, and one
 * step beyond it below 2^31. */
#if EDGE_BITS == 32 && DIRECT > 1 << 14
#error "DIRECT is at most 2^14, so that edge functions fit 32 bits"
#endif

/* Is a triangle done directly that has few enough candidate rays?  Where all candidates are tried,
 * it should meet an eighth of them, or have few: those of slivers are rather solved for. */
static inline bool fills(const Facet f, const int4 box)
{
#if WIDE
    return true;
#endif
    const long candidates = (long)(box.z - box.x + 1) * (box.w - box.y + 1);
    return candidates <= FEW || f.area >> (2 * STEP_BITS - 2) >= candidates;
}

/* One work-item does RUN triangles in a row, from `first` on: those of few candidate rays; the
 * others it puts on the list.
 * window: the rays (first u, first v, last u, last v) that are cast.
 * faces: (m, 3) int32, vertices: (3 n + 1,) int32, on the lattice.
 * listed: (1,) uint32, length of the list, zero before the first launch.
 * list: (m,) uint32, triangle numbers in no particular order. */
__kernel void cast_direct(
    const ulong first, const ulong last, const int4 window,
    const __global int *restrict faces, const __global int *restrict vertices,
    __global uint *listed, __global uint *list, SINK_PARAMETERS)
{
    const ulong start = first + get_global_id(0) * RUN;
    Sink sink = MAKE_SINK(window);
    Found found;
    found.count = 0;
    for (ulong triangle = start; triangle < min(start + RUN, last); ++triangle) {
        const Facet f = load_facet(faces, vertices, triangle);
        const int4 box = ray_box(f, window);
        if (f.area == 0 || box_is_empty(box)) continue;
        const int4 whole = ray_box(f, ALL_RAYS);
        if (is_small(whole) && fills(f, whole)) {
            begin(&sink, triangle, f.flipped);
            rasterise(&sink, &found, f, box);
        } else {
            list[atomic_inc(listed)] = (uint)triangle;
        }
    }
    drain(&found, &sink);
}

static inline int rows_of(const Facet f, const int4 box)
{
    const int low = min(min(f.a.x, f.b.x), f.c.x);
    const int high = max(max(f.a.x, f.b.x), f.c.x);
    return rows_in_tile(box, f.area, high - low, STEP);
}

/* One work-item counts the tiles of one listed triangle.
 * tiles: (entries,) uint32. */
__kernel void count_tiles(
    const uint entries, const int4 window,
    const __global int *restrict faces, const __global int *restrict vertices,
    const __global uint *restrict list, __global uint *restrict tiles)
{
    const uint id = get_global_id(0);
    if (id >= entries) return;
    const Facet f = load_facet(faces, vertices, list[id]);
    const int4 box = ray_box(f, window);
    tiles[id] = tiles_of(box, rows_of(f, box));
}

/* One work-item does one tile of one listed triangle.
 * offsets: (entries,) uint64, exclusive prefix sum of the tiles. */
__kernel void cast_tiles(
    const ulong first, const ulong last, const uint entries, const int4 window,
    const __global int *restrict faces, const __global int *restrict vertices,
    const __global uint *restrict list, const __global ulong *restrict offsets, SINK_PARAMETERS)
{
    const ulong pair = first + get_global_id(0);
    if (pair >= last) return;
    const uint item = entry_of(offsets, entries, pair);
    const Facet f = load_facet(faces, vertices, list[item]);
    const int4 whole = ray_box(f, window);
    const int4 box = tile_box(whole, rows_of(f, whole), (uint)(pair - offsets[item]));
    Sink sink = MAKE_SINK(window);
    Found found;
    found.count = 0;
    begin(&sink, list[item], f.flipped);
    rasterise(&sink, &found, f, box);
    drain(&found, &sink);
}
