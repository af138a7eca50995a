/*
 * crossings/known.h: the bricks of cells, with what was looked up before.
 *
 * One word of the bits of touched cells, and the bricks before it, answer for all its 32 cells: 32
 * neighbours along x of the coarse grid, or of a brick of 8 x 8 x 8 cells a block of 8 x 4.  Words
 * that neighbouring triangles meet have different places, mostly.
 *
 * Defines:    WIDE  1 if triangles meet some words each, 0 if neighbours mostly one
 */
#ifndef CLVOX_KNOWN_H
#define CLVOX_KNOWN_H

#include "common/bricks.h"

#if WIDE
#define KNOWN_WORDS 32
#else
#define KNOWN_WORDS 1
#endif

/* The last word of each place, which `owner` tells from others and is 0 at first. */
typedef struct {
    ulong owner[KNOWN_WORDS];
    uint touched[KNOWN_WORDS], before[KNOWN_WORDS];
} Known;

/* A word of the cells of a brick of cells, or of the coarse grid, as a number above 0. */
#define OWNER_OF(x, y, z, word) (((ulong)(z) << 47 | (ulong)(y) << 30 | (ulong)(x) << 13 | (word)) + 1)

/* Brick of voxels of the cell (x, y, z) of the last level but one, or NO_BRICK. */
static inline uint known_brick(
    Known *known, const Tree tree, const uint x, const uint y, const uint z)
{
#if LEVELS == 3
    const uint above_x = x / MIDDLE_X, above_y = y / MIDDLE_Y, above_z = z / MIDDLE_Z;
    const uint cell = ((z - above_z * MIDDLE_Z) * MIDDLE_Y + (y - above_y * MIDDLE_Y)) * MIDDLE_X
                    + (x - above_x * MIDDLE_X);
    const uint bit = cell % 32;
    const ulong owner = OWNER_OF(above_x, above_y, above_z, cell / 32);
    const uint place = (cell / 32 % 16 + 16 * ((above_x ^ above_y ^ above_z) & 1)) % KNOWN_WORDS;
#else
    const uint bit = x % 32;
    const ulong owner = OWNER_OF(x / 32, y, z, 0);
    const uint place = (y % 4 + 4 * (z % 4) + 16 * (x / 32 % 2)) % KNOWN_WORDS;
#endif
    if (known->owner[place] != owner) {
        known->owner[place] = owner;
        known->touched[place] = 0;
#if LEVELS == 3
        const uint node = find_node(tree, x, y, z);
        const ulong word = (ulong)node * MIDDLE_WORDS + cell / 32;
        if (node != NO_BRICK) {
            known->touched[place] = tree.middle[word];
            known->before[place] = rank_of(tree.middle, tree.middle_rank, word, 0);
        }
#else
        const ulong word = cell_word(tree.cells, x, y, z);
        known->touched[place] = tree.boundary[word];
        known->before[place] = rank_of(tree.boundary, tree.rank, word, 0);
#endif
    }
    const uint touched = known->touched[place];
    if (!(touched >> bit & 1)) return NO_BRICK;
    return known->before[place] + popcount(touched & ((1u << bit) - 1));
}

#endif
