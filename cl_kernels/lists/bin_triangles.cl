/*
 * lists/bin_triangles.cl: the triangles that each tile of rays may meet.
 *
 * A tile is SIDE_U by SIDE_V rays.  Triangles are counted per tile, the counts scanned, and the
 * numbers of the triangles written, in no particular order: what is made of them is sorted.
 *
 * Host:       clvox/ops/bins.py, Binner
 * Reference:  clvox/reference/lists.py, list_crossings()
 * Tests:      tests/kernels/test_lists.py
 * Defines:    AXIS       axis of the rays: 0, 1 or 2
 *             STEP_BITS  log2 of the lattice steps in one voxel
 *             SIDE_U     rays along the sides of a tile
 *             SIDE_V
 *             PASS       0: COUNT, 1: WRITE
 *             DIRECT     most tiles of a triangle that one work-item does alone
 *             RUN        triangles in a row that one work-item does
 */
#include "common/entries.h"
#include "common/index.h"
#include "common/rays.h"
#include "lists/tiles.h"

#define COUNT 0
#define WRITE 1

/* counts: (tiles,) uint32; zero on entry to COUNT, and on return from WRITE.
 * starts: where each tile's triangles begin; triangles: uint32. */
#if PASS == COUNT
#define BINS_PARAMETERS __global uint *counts
#define BINS counts
#else
#define BINS_PARAMETERS \
    const __global ulong *starts, __global uint *counts, __global uint *triangles
#define BINS starts, counts, triangles
#endif

static inline void put(BINS_PARAMETERS, const uint tile, const uint triangle)
{
#if PASS == COUNT
    atomic_inc(counts + tile);
#else
    triangles[starts[tile] + (atomic_dec(counts + tile) - 1)] = triangle;
#endif
}

/* The tiles (first u, first v, last u, last v) of the triangle's box, which is in the window. */
static inline int4 tiles_below(const int4 box, const int4 window)
{
    return (int4)((box.x - window.x) / SIDE_U, (box.y - window.y) / SIDE_V,
                  (box.z - window.x) / SIDE_U, (box.w - window.y) / SIDE_V);
}

/* One work-item does RUN triangles in a row, those of few tiles; the others it lists.
 * window: the rays.  The rest as for cast_direct. */
__kernel void bin_direct(
    const ulong first, const ulong last, const int4 window,
    const __global int *restrict faces, const __global int *restrict vertices,
    __global uint *listed, __global uint *list, BINS_PARAMETERS)
{
    const ulong start = first + get_global_id(0) * RUN;
    for (ulong triangle = start; triangle < min(start + RUN, last); ++triangle) {
        const Facet f = load_facet(faces, vertices, triangle);
        const int4 box = ray_box(f, window);
        if (f.area == 0 || box_is_empty(box)) continue;
        const int4 tiles = tiles_below(box, window);
        if ((long)(tiles.z - tiles.x + 1) * (tiles.w - tiles.y + 1) > DIRECT) {
            list[atomic_inc(listed)] = (uint)triangle;
            continue;
        }
        for (int u = tiles.x; u <= tiles.z; ++u) {
            for (int v = tiles.y; v <= tiles.w; ++v)
                put(BINS, tile_number(window, u, v), (uint)triangle);
        }
    }
}

/* One work-item counts the tiles of one listed triangle. */
__kernel void count_tiles(
    const uint entries, const int4 window,
    const __global int *restrict faces, const __global int *restrict vertices,
    const __global uint *restrict list, __global uint *restrict tiles)
{
    const uint id = get_global_id(0);
    if (id >= entries) return;
    const int4 box = ray_box(load_facet(faces, vertices, list[id]), window);
    const int4 below = tiles_below(box, window);
    tiles[id] = (uint)(below.z - below.x + 1) * (uint)(below.w - below.y + 1);
}

/* One work-item does one tile of one listed triangle. */
__kernel void bin_tiles(
    const ulong first, const ulong last, const uint entries, const int4 window,
    const __global int *restrict faces, const __global int *restrict vertices,
    const __global uint *restrict list, const __global ulong *restrict offsets, BINS_PARAMETERS)
{
    const ulong pair = first + get_global_id(0);
    if (pair >= last) return;
    const uint item = entry_of(offsets, entries, pair);
    const int4 box = ray_box(load_facet(faces, vertices, list[item]), window);
    const int4 below = tiles_below(box, window);
    ulong number = pair - offsets[item];
    const int v = below.y + take_place(&number, below.w - below.y + 1);
    put(BINS, tile_number(window, below.x + (int)number, v), list[item]);
}
