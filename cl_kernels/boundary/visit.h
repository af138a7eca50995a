/*
 * boundary/visit.h: every pair of a cell and a triangle that touches it.
 *
 * Small triangles fill blocks of bits (boundary/block.h).  Others walk the columns of cells in
 * their shadow along the dominant axis of their normal, and their plane bounds the cells of each
 * column: never all cells of a box.  A triangle within one row of cells takes a shorter way, and so
 * does one within a layer that is too small or too large for blocks.  What is done with a pair is
 * up to the sink, which comes first: SINK_PARAMETERS, MAKE_SINK(grid), the type Sink, and
 *
 *     mark(&sink, cell, triangle)   for each pair, once
 *     finish(&sink)                 when a work-item has no more
 *
 * A sink that defines IDEMPOTENT may be told of a pair twice; for branches that nobody could
 * foresee are saved so, and by
 *
 *     mark_if(&sink, touches, cell, triangle)   for cells of the grid, touched or not
 *
 * One that defines TAKES_BLOCKS marks all cells of a block together:
 *
 *     mark_block(&sink, &block, triangle)
 *
 * Defines:    VISIT_HINT attributes of the kernels, if a sink needs any
 *             RUN        triangles in a row that one work-item does directly
 *             DIRECT     most columns of a triangle that is done directly: below 64, the columns of
 *                        a block, there are no blocks, and from 64 on columns only within a layer
 *             TILE       its square is about how many columns a tile has (common/tiles.h)
 *             STEP_BITS, CELL_*  (boundary/overlap.h)
 */
#ifndef CLVOX_VISIT_H
#define CLVOX_VISIT_H

#ifndef VISIT_HINT
#define VISIT_HINT
#endif

#include "common/tiles.h"
#include "boundary/block.h"
#include "boundary/flat.h"
#include "boundary/overlap.h"

#define TRIES_BLOCKS (BLOCKS_FIT && BLOCK * BLOCK <= DIRECT)

#ifndef IDEMPOTENT
static inline void mark_if(
    Sink *sink, const bool touches, const int3 cell, const ulong triangle)
{
    if (touches) mark(sink, cell, triangle);
}
#endif

#ifndef TAKES_BLOCKS
static inline void mark_block(Sink *sink, const Block *block, const ulong triangle)
{
    for (int z = block->from.z; z <= block->to.z; ++z)
        for (ulong left = block->faces[z - block->first.z]; left; left &= left - 1) {
            const int bit = (int)(63 - clz(left & (0 - left)));
            mark(sink, (int3)(block->first.x + bit % 8, block->first.y + bit / 8, z), triangle);
        }
}
#endif

/* All cells in some columns of a row, first to last, that the triangle touches. */
static inline void mark_row(
    Sink *sink, const Solid *s, const int i, const int first, const int last,
    const ulong triangle)
{
    const int u = i * s->cell.x - HALF_STEP;
    for (int j = first; j <= last; ++j) {
        const int v = j * s->cell.y - HALF_STEP;
        if (!column_meets(s, u, v)) continue;
        const int2 depths = depths_in_column(s, u, v);
        for (int k = depths.x; k <= depths.y; ++k)
            if (cell_meets(s, u, v, k * s->cell.z - HALF_STEP))
                mark(sink, restore((int3)(i, j, k), s->axis), triangle);
    }
}

/* All cells in a box of columns. */
static void mark_columns(Sink *sink, const Solid *s, const int4 box, const ulong triangle)
{
    for (int i = box.x; i <= box.z; ++i) mark_row(sink, s, i, box.y, box.w, triangle);
}

/* What the columns of rows from `row` on, and column `first` of them, are narrowed to by a side of
 * the shadow. */
static inline Bounds bounds_by(
    const Solid *s, const Side side, const int row, const int first, const int last)
{
    const long value = side_of(side, row * s->cell.x - HALF_STEP, first * s->cell.y - HALF_STEP);
    return bounds_of(value, (long)side.along_q * s->cell.y, -(long)side.along_p * s->cell.x,
                     last - first);
}

/* The same, with few of the columns tried that the shadow does not meet. */
static void mark_tile(Sink *sink, const Solid *s, const int4 box, const ulong triangle)
{
    for (int block = box.x; block <= box.z; block += ROWS) {
        Spans spans;
        spans_of(&spans, bounds_by(s, s->uv[0], block, box.y, box.w),
                 bounds_by(s, s->uv[1], block, box.y, box.w),
                 bounds_by(s, s->uv[2], block, box.y, box.w), box.w - box.y);
        for (int k = 0; k < min(box.z - block + 1, ROWS); ++k)
            mark_row(sink, s, block + k, box.y + spans.first[k], box.y + spans.last[k], triangle);
    }
}

/* All cells that a triangle touches which lies within one layer of cells across `axis`: there its
 * shadow decides.  a, b, c: its corners, across that axis; box: the columns of the layer. */
static void mark_layer(
    Sink *sink, const int2 a, const int2 b, const int2 c, const int axis, const int4 box,
    const int layer, const ulong triangle)
{
    const int2 cell = permute(CELL_SIDES, axis).xy;
    const long turn = cross2(a, b, c);
    const Side sides[3] = {
        make_side(a, b, turn, cell), make_side(b, c, turn, cell), make_side(c, a, turn, cell)};
    for (int i = box.x; i <= box.z; ++i) {
        const int u = i * cell.x - HALF_STEP;
        for (int j = box.y; j <= box.w; ++j) {
            const int v = j * cell.y - HALF_STEP;
            mark_if(sink, all_meet(sides, u, v), restore((int3)(i, j, layer), axis), triangle);
        }
    }
}

/* All cells that a triangle touches, block by block from cell `start` on; alone: there is one.
 * from, to: the cells of its box in the grid. */
static void mark_blocks(
    Sink *sink, const int3 a, const int3 b, const int3 c, const int3 start, const int3 from,
    const int3 to, const bool alone, const ulong triangle)
{
    Block block;
    for (int z = start.z; z <= to.z; z += BLOCK)
        for (int y = start.y; y <= to.y; y += BLOCK)
            for (int x = start.x; x <= to.x; x += BLOCK) {
                block.first = (int3)(x, y, z);
                block.from = max(from, block.first);
                block.to = min(to, block.first + (BLOCK - 1));
                if (fill_block(&block, a, b, c, alone)) mark_block(sink, &block, triangle);
            }
}

/* All cells that one triangle touches; or false if its columns are too many.  `flat` grows by one
 * if it has no area. */
static bool mark_triangle(
    Sink *sink, uint *flat, const int3 grid, const __global int *faces,
    const __global int *vertices, const ulong triangle)
{
    const int3 a = load_corner(vertices, faces[3 * triangle]);
    const int3 b = load_corner(vertices, faces[3 * triangle + 1]);
    const int3 c = load_corner(vertices, faces[3 * triangle + 2]);
    *flat += is_flat(b - a, c - a);
    const int3 low = min(min(a, b), c);
    const int3 high = max(max(a, b), c);
    const int3 first_cell = first_cell_of(low);
    const int3 last_cell = last_cell_of(high);
    const int3 from = max(first_cell, (int3)(0));
    const int3 to = min(last_cell, grid - 1);
    if (to.x < from.x || to.y < from.y || to.z < from.z) return true;
    const int3 more = last_cell - first_cell;
#ifdef IDEMPOTENT
    if (more.x + more.y + more.z <= 1) {
        mark(sink, from, triangle);
        mark(sink, to, triangle);
        return true;
    }
#endif
    if ((more.x > 0) + (more.y > 0) + (more.z > 0) <= 1) {
        /* One row of cells holds the whole triangle and is touched at both ends: all of it is. */
        for (int z = from.z; z <= to.z; ++z)
            for (int y = from.y; y <= to.y; ++y)
                for (int x = from.x; x <= to.x; ++x) mark(sink, (int3)(x, y, z), triangle);
        return true;
    }
    const bool layer = more.x == 0 || more.y == 0 || more.z == 0;
    /* Four cells of a layer are sooner tried than a block is filled. */
    const bool four = layer && more.x + more.y + more.z == 2;
    if (TRIES_BLOCKS && !four && suits_blocks(a, b, c, more)) {
        const bool alone = fits_block(more);
        mark_blocks(sink, a, b, c, alone ? first_cell : from & -BLOCK, from, to, alone, triangle);
        return true;
    }
    if (layer) {
        const int axis = more.x == 0 ? 0 : more.y == 0 ? 1 : 2;
        const int3 first = permute(from, axis);
        const int3 last = permute(to, axis);
        const int4 box = (int4)(first.x, first.y, last.x, last.y);
        if (!is_small(box)) return false;
        mark_layer(sink, permute(a, axis).xy, permute(b, axis).xy, permute(c, axis).xy, axis,
                   box, first.z, triangle);
        return true;
    }
    /* The few that are left become tiles: without them the kernel is built sooner. */
    if (TRIES_BLOCKS) return false;
    Solid s;
    const int4 box = make_solid(&s, faces, vertices, triangle, grid);
    if (!is_small(box)) return false;
    mark_columns(sink, &s, box, triangle);
    return true;
}

/* One work-item does RUN triangles in a row, from `first` on: those of few columns; the others it
 * puts on the list.
 * grid: shape of the grid of cells (x, y, z).
 * faces: (m, 3) int32, vertices: (3 n + 1,) int32, on the lattice.
 * listed: (2,) uint32, length of the list and number of triangles without area, zero before the
 * first launch.
 * list: (m,) uint32, triangle numbers in no particular order. */
__kernel VISIT_HINT void mark_direct(
    const ulong first, const ulong last, const int4 grid,
    const __global int *restrict faces, const __global int *restrict vertices,
    __global uint *listed, __global uint *list, SINK_PARAMETERS)
{
    const ulong start = first + get_global_id(0) * RUN;
    Sink sink = MAKE_SINK(grid);
    uint flat = 0;
    for (ulong triangle = start; triangle < min(start + RUN, last); ++triangle)
        if (!mark_triangle(&sink, &flat, grid.xyz, faces, vertices, triangle))
            list[atomic_inc(listed)] = (uint)triangle;
    finish(&sink);
    if (flat) atomic_add(listed + 1, flat);
}

static inline int rows_of(const Solid *s, const int4 box)
{
    return rows_in_tile(box, (long)abs(s->nw), s->extent, s->cell.y);
}

/* One work-item counts the tiles of one listed triangle.
 * tiles: (entries,) uint32. */
__kernel void count_tiles(
    const uint entries, const int4 grid,
    const __global int *restrict faces, const __global int *restrict vertices,
    const __global uint *restrict list, __global uint *restrict tiles)
{
    const uint id = get_global_id(0);
    if (id >= entries) return;
    Solid s;
    const int4 box = make_solid(&s, faces, vertices, list[id], grid.xyz);
    tiles[id] = tiles_of(box, rows_of(&s, box));
}

/* One work-item does one tile of columns of one listed triangle.
 * offsets: (entries,) uint64, exclusive prefix sum of the tiles. */
__kernel VISIT_HINT void mark_tiles(
    const ulong first, const ulong last, const uint entries, const int4 grid,
    const __global int *restrict faces, const __global int *restrict vertices,
    const __global uint *restrict list, const __global ulong *restrict offsets, SINK_PARAMETERS)
{
    const ulong pair = first + get_global_id(0);
    if (pair >= last) return;
    const uint item = entry_of(offsets, entries, pair);
    Solid s;
    const int4 box = make_solid(&s, faces, vertices, list[item], grid.xyz);
    Sink sink = MAKE_SINK(grid);
    const int4 part = tile_box(box, rows_of(&s, box), (uint)(pair - offsets[item]));
    mark_tile(&sink, &s, part, list[item]);
    finish(&sink);
}

#endif
