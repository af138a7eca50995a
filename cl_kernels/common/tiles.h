/*
 * common/tiles.h: a triangle of many rays, or columns of cells, is cut into tiles.
 *
 * Triangles of few candidates are done where they are met; the others are put on a list, their
 * tiles counted and the counts scanned, and each (triangle, tile) pair is one work-item.  A tile is
 * some rows of the triangle's box, as many as hold about TILE * TILE candidates, but not more than
 * 4 * TILE; in a row, only where the triangle is: so slivers across a large box cost what they
 * touch.
 *
 * Defines:    DIRECT  most candidates of a triangle that is done directly
 *             TILE    its square is about how many candidates a tile has
 */
#ifndef CLVOX_TILES_H
#define CLVOX_TILES_H

#include "common/entries.h"

static inline bool is_small(const int4 box)
{
    return (long)(box.z - box.x + 1) * (box.w - box.y + 1) <= DIRECT;
}

/* Rows in each tile of a triangle but the last; `box` is not empty.
 * area: twice that of the triangle's shadow; extent: of the shadow across the rows; side: from
 * place to place along a row; all in steps. */
static inline int rows_in_tile(const int4 box, const long area, const int extent, const int side)
{
    const long in_row = area / (2L * side * max(extent, 1)) + 1;
    const int candidates = (int)min(in_row, (long)(box.w - box.y + 1));
    return clamp(TILE * TILE / candidates, 1, 4 * TILE);
}

static inline uint tiles_of(const int4 box, const int rows)
{
    return (uint)((box.z - box.x) / rows + 1);
}

/* The part of the box in its tile number `tile`. */
static inline int4 tile_box(const int4 box, const int rows, const uint tile)
{
    const int first = box.x + (int)tile * rows;
    return (int4)(first, box.y, min(first + rows - 1, box.z), box.w);
}

#endif
