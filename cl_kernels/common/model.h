/*
 * common/model.h: reading a voxel of a model, in O(levels) look-ups.
 *
 * Defines:    LEVELS  1: a dense grid of bits; 2: a coarse grid and bricks; 3: a level between
 *             RULE    which bit is asked for, below
 *             BRICK_X, BRICK_Y, BRICK_Z     sides of a brick of voxels, unless LEVELS is 1
 *             MIDDLE_X, MIDDLE_Y, MIDDLE_Z  sides of a brick of cells, if LEVELS is 3
 */
#ifndef CLVOX_MODEL_H
#define CLVOX_MODEL_H

/* In or out at the sample; in or touched; in and not touched; 0 out, 1 in, 2 touched. */
#define CENTRE 0
#define TOUCH 1
#define WITHIN 2
#define CLASS 3

static inline uint by_rule(const uint solid, const uint touched)
{
#if RULE == TOUCH
    return solid | touched;
#elif RULE == WITHIN
    return solid & ~touched;
#elif RULE == CLASS
    return touched ? 2 : solid;
#else
    return solid;
#endif
}

#if RULE == CENTRE
#define EDGE_BIT(word, bit) 0
#else
#define EDGE_BIT(word, bit) (edge[word] >> (bit) & 1)
#endif

/* Arguments of a model: the shape of its coarse grid (of the fine one if LEVELS is 1); its arrays
 * (docs/layouts.md); and `edge`, laid out like `bricks`: which voxels are touched, not read if
 * RULE is CENTRE. */
#if LEVELS == 1

#define MODEL_PARAMETERS \
    const int4 cells, const __global uint *bricks, const __global uint *edge
#define MODEL_ARGUMENTS cells, bricks, edge

static inline uint read_voxel(MODEL_PARAMETERS, const int x, const int y, const int z)
{
    const ulong word = ((ulong)z * cells.y + y) * ((cells.x + 31) / 32) + x / 32;
    return by_rule(bricks[word] >> (x % 32) & 1, EDGE_BIT(word, x % 32));
}

#else

#include "common/bricks.h"

#if LEVELS == 2
#define MODEL_PARAMETERS \
    TREE_PARAMETERS, const __global uint *inside, \
    const __global uint *bricks, const __global uint *edge
#define MODEL_ARGUMENTS TREE_ARGUMENTS, inside, bricks, edge
#else
#define MODEL_PARAMETERS \
    TREE_PARAMETERS, const __global uint *inside, \
    const __global uint *middle_inside, \
    const __global uint *bricks, const __global uint *edge
#define MODEL_ARGUMENTS TREE_ARGUMENTS, inside, middle_inside, bricks, edge
#endif

/* State of a cell: one of these, or the number of its brick. */
#define CELL_OUTSIDE 0xfffffffeUL
#define CELL_INSIDE 0xffffffffUL

/* State of cell (x, y, z) of the coarse grid. */
static inline ulong coarse_state(MODEL_PARAMETERS, const int x, const int y, const int z)
{
    const ulong word = cell_word(cells, x, y, z);
    if (boundary[word] >> (x % 32) & 1) return rank_of(boundary, rank, word, x % 32);
    return inside[word] >> (x % 32) & 1 ? CELL_INSIDE : CELL_OUTSIDE;
}

#if LEVELS == 3

/* State of cell (x, y, z) of the middle level. */
static inline ulong cell_state(MODEL_PARAMETERS, const int x, const int y, const int z)
{
    const ulong node = coarse_state(MODEL_ARGUMENTS, x / MIDDLE_X, y / MIDDLE_Y, z / MIDDLE_Z);
    if (node >= CELL_OUTSIDE) return node;
    const ulong bit = middle_bit((uint)node, x, y, z);
    if (middle[bit / 32] >> (bit % 32) & 1)
        return rank_of(middle, middle_rank, bit / 32, bit % 32);
    return middle_inside[bit / 32] >> (bit % 32) & 1 ? CELL_INSIDE : CELL_OUTSIDE;
}

#else
#define cell_state coarse_state
#endif

static inline uint read_voxel(MODEL_PARAMETERS, const int x, const int y, const int z)
{
    const ulong state = cell_state(MODEL_ARGUMENTS, x / BRICK_X, y / BRICK_Y, z / BRICK_Z);
    if (state >= CELL_OUTSIDE) return by_rule(state == CELL_INSIDE, 0);
    const uint voxel =
        (place_in(z, BRICK_Z) * BRICK_Y + place_in(y, BRICK_Y)) * BRICK_X + place_in(x, BRICK_X);
    const ulong word = state * BRICK_WORDS + voxel / 32;
    return by_rule(bricks[word] >> (voxel % 32) & 1, EDGE_BIT(word, voxel % 32));
}

#endif
#endif
