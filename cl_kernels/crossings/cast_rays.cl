/*
 * crossings/cast_rays.cl: every crossing of a bundle of parallel rays with a mesh, into a sink.
 *
 * The one rasteriser of the project: a sink, chosen when it is built, counts the crossings, flips
 * bits of a dense grid or flips bits of the bricks of a two-level model.  It costs one pass over
 * the triangles, and work grows with triangles and crossings, never with their product.
 *
 * Host:       clvox/ops/crossings.py
 * Reference:  clvox/reference/crossings.py
 * Tests:      tests/kernels/test_crossings.py
 * Defines:    AXIS       axis of the rays: 0, 1 or 2; 1 for all sinks but COUNT
 *             STEP_BITS  log2 of the lattice steps in one voxel
 *             SINK       0: COUNT, 1: DENSE, 2: BRICKS (crossings/sinks.h)
 *             EDGE_BITS  32 or 64, of the edge functions (crossings/rasterise.h)
 *             RUN        triangles in a row that one work-item does directly
 *             DIRECT     most candidate rays of a triangle that is done directly
 *             TILE       side of a tile, in rays
 *             LEVELS, BRICK_*, MIDDLE_*  of the model, for the sink BRICKS (common/bricks.h)
 * Source:     after M. Schwarz, H.-P. Seidel, "Fast parallel surface and solid voxelization on
 *             GPUs", ACM TOG 29(6), 2010, in integers and with ties broken by an infinitesimal.
 */
#include "common/rays.h"
#include "common/tiles.h"
#include "crossings/sinks.h"

#include "crossings/rasterise.h"

/* Do the triangle's edge functions, in units of a voxel, fit edge_t wherever they are stepped? */
static inline bool fits_edge(const Facet f)
{
#if EDGE_BITS == 64
    return true;
#endif
    const int2 low = min(min(f.a.xy, f.b.xy), f.c.xy);
    const int2 high = max(max(f.a.xy, f.b.xy), f.c.xy);
    const long2 side = convert_long2(high - low);
    return ((side.x * side.y) >> STEP_BITS) + side.x + side.y < (long)INT_MAX - 16;
}

/* One work-item does RUN triangles in a row, from `first` on: those of few candidate rays whose
 * edge functions fit; the others it puts on the list.
 * rays: how many along u and v.
 * faces: (m, 3) int32, vertices: (n, 3) int32, on the lattice.
 * listed: (1,) uint32, length of the list, zero before the first launch.
 * list: (m,) uint32, triangle numbers in no particular order. */
__kernel void cast_direct(
    const ulong first, const ulong last, const int2 rays,
    const __global int *restrict faces, const __global int *restrict vertices,
    __global uint *listed, __global uint *list, SINK_PARAMETERS)
{
    const ulong start = first + get_global_id(0) * RUN;
    Sink sink = MAKE_SINK(rays);
    for (ulong triangle = start; triangle < min(start + RUN, last); ++triangle) {
        const Facet f = load_facet(faces, vertices, triangle);
        const int4 box = ray_box(f, rays);
        if (f.area == 0 || box_is_empty(box)) continue;
        if (is_small(box) && fits_edge(f)) rasterise(&sink, f, box);
        else list[atomic_inc(listed)] = (uint)triangle;
    }
    finish(&sink);
}

/* One work-item counts the tiles of one listed triangle.
 * tiles: (entries,) uint32. */
__kernel void count_tiles(
    const uint entries, const int2 rays,
    const __global int *restrict faces, const __global int *restrict vertices,
    const __global uint *restrict list, __global uint *restrict tiles)
{
    const uint id = get_global_id(0);
    if (id >= entries) return;
    const int2 sides = tiles_of(ray_box(load_facet(faces, vertices, list[id]), rays));
    tiles[id] = (uint)sides.x * (uint)sides.y;
}

/* One work-item does one tile of one listed triangle.
 * offsets: (entries,) uint64, exclusive prefix sum of the tiles. */
__kernel void cast_tiles(
    const ulong first, const ulong last, const uint entries, const int2 rays,
    const __global int *restrict faces, const __global int *restrict vertices,
    const __global uint *restrict list, const __global ulong *restrict offsets, SINK_PARAMETERS)
{
    const ulong pair = first + get_global_id(0);
    if (pair >= last) return;
    const uint item = entry_of(offsets, entries, pair);
    const Facet f = load_facet(faces, vertices, list[item]);
    const int4 box = tile_box(ray_box(f, rays), (uint)(pair - offsets[item]));
    Sink sink = MAKE_SINK(rays);
    rasterise(&sink, f, box);
    finish(&sink);
}
