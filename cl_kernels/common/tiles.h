/*
 * common/tiles.h: a large box of rays, or of columns of cells, is cut into tiles.
 *
 * Triangles of few candidates are done where they are met; the others are put on a list, their
 * tiles counted and the counts scanned, and each (triangle, tile) pair is one work-item.
 *
 * Defines:    DIRECT  most candidates of a triangle that is done directly
 *             TILE    side of a tile
 */
#ifndef CLVOX_TILES_H
#define CLVOX_TILES_H

#include "common/entries.h"

/* Tiles along u and v of a box (first u, first v, last u, last v) that is not empty. */
static inline int2 tiles_of(const int4 box)
{
    return (box.zw - box.xy) / TILE + 1;
}

static inline bool is_small(const int4 box)
{
    return (long)(box.z - box.x + 1) * (box.w - box.y + 1) <= DIRECT;
}

/* The part of the box in its tile number `tile`. */
static inline int4 tile_box(const int4 box, const uint tile)
{
    const int tiles_v = tiles_of(box).y;
    const int row = (int)tile / tiles_v;
    const int2 first = box.xy + (int2)(row, (int)tile - row * tiles_v) * TILE;
    const int2 last = min(first + TILE - 1, box.zw);
    return (int4)(first.x, first.y, last.x, last.y);
}

#endif
