/*
 * lists/tiles.h: the order of rays, and tiles of SIDE_U by SIDE_V rays in the same order.
 *
 * Tiles that follow each other are written next to each other, whose lines of memory they share.
 */
#ifndef CLVOX_LISTS_TILES_H
#define CLVOX_LISTS_TILES_H

#include "common/index.h"

/* Neighbours in a row of rays follow along `fast`: x before y before z. */
#if AXIS == 1
#define FAST_OF(u, v) (v)
#define SLOW_OF(u, v) (u)
#else
#define FAST_OF(u, v) (u)
#define SLOW_OF(u, v) (v)
#endif

/* A tile's rays along fast, along slow, and all. */
#define TILE_WIDE FAST_OF(SIDE_U, SIDE_V)
#define TILE_HIGH SLOW_OF(SIDE_U, SIDE_V)
#define RAYS (TILE_WIDE * TILE_HIGH)

/* How many tiles a window (first u, first v, last u, last v) has along fast. */
static inline uint tiles_along(const int4 window)
{
    return (uint)(FAST_OF(window.z - window.x, window.w - window.y) / TILE_WIDE + 1);
}

/* Number of a tile. */
static inline uint tile_number(const int4 window, const int u, const int v)
{
    return (uint)SLOW_OF(u, v) * tiles_along(window) + (uint)FAST_OF(u, v);
}

/* The rays (first u, first v, last u, last v) of a tile. */
static inline int4 tile_window(const int4 window, const ulong tile)
{
    ulong number = tile;
    const int fast = take_place(&number, tiles_along(window)) * TILE_WIDE;
    const int slow = (int)number * TILE_HIGH;
    /* The macros are their own inverse. */
    const int u = window.x + FAST_OF(fast, slow);
    const int v = window.y + SLOW_OF(fast, slow);
    return (int4)(u, v, min(u + SIDE_U - 1, window.z), min(v + SIDE_V - 1, window.w));
}

#endif
