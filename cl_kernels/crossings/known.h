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

#if !WIDE
#define KNOWN_WORDS 1
#elif LEVELS == 3
#define KNOWN_WORDS 32
#else
#define KNOWN_WORDS 16
#endif

/* The last word of each place, which `owner` tells from others and is 0 at first. */
typedef struct {
    ulong owner[KNOWN_WORDS];
    uint touched[KNOWN_WORDS], before[KNOWN_WORDS];
} Known;

/* A word of the bits of a cell's brick, as a number: the cell, and the word in the brick. */
#define WORD_OF(x, y, z, word) ((ulong)(z) << 47 | (ulong)(y) << 30 | (ulong)(x) << 13 | (word))
#define X_OF(id) ((uint)((id) >> 13) & 0x1ffff)
#define Y_OF(id) ((uint)((id) >> 30) & 0x1ffff)
#define Z_OF(id) ((uint)((id) >> 47))

/* The number of the brick that word `id` is in, or NO_BRICK. */
static inline uint known_brick(Known *known, const Tree tree, const ulong id)
{
#if LEVELS == 3
    const uint x = X_OF(id) / MIDDLE_X, y = Y_OF(id) / MIDDLE_Y, z = Z_OF(id) / MIDDLE_Z;
    const uint cell
        = ((Z_OF(id) - z * MIDDLE_Z) * MIDDLE_Y + (Y_OF(id) - y * MIDDLE_Y)) * MIDDLE_X
        + (X_OF(id) - x * MIDDLE_X);
    const uint bit = cell % 32;
    const ulong owner = WORD_OF(x, y, z, cell / 32) + 1;
    const uint place = (cell / 32 % 16 + 16 * ((x ^ y ^ z) & 1)) % KNOWN_WORDS;
#else
    const uint bit = X_OF(id) % 32;
    const ulong owner = (id >> 18) + 1;
    const uint place = (Y_OF(id) % 4 + 4 * (Z_OF(id) % 4)) % KNOWN_WORDS;
#endif
    if (known->owner[place] != owner) {
        known->owner[place] = owner;
#if LEVELS == 3
        const uint node = find_node(tree, X_OF(id), Y_OF(id), Z_OF(id));
        known->touched[place] = 0;
        if (node != NO_BRICK) {
            const ulong word = (ulong)node * MIDDLE_WORDS + cell / 32;
            known->touched[place] = tree.middle[word];
            known->before[place] = rank_of(tree.middle, tree.middle_rank, word, 0);
        }
#else
        const ulong word = cell_word(tree.cells, X_OF(id), Y_OF(id), Z_OF(id));
        known->touched[place] = tree.boundary[word];
        known->before[place] = rank_of(tree.boundary, tree.rank, word, 0);
#endif
    }
    const uint touched = known->touched[place];
    const uint number = known->before[place] + popcount(touched & ((1u << bit) - 1));
    return touched >> bit & 1 ? number : NO_BRICK;
}

#endif
