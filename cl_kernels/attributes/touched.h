/*
 * attributes/touched.h: the number of a touched voxel, and of a cell that holds some.
 *
 * Touched voxels are numbered in the order of their bits in `edge`, cells as their bricks are.  In a
 * dense model each touched voxel is a cell of its own: there TREE_ARGUMENTS are the grid's shape,
 * `edge` and `edge_rank`.
 *
 * Defines:    LEVELS, BRICK_*, MIDDLE_*  of the model (common/bricks.h)
 */
#ifndef CLVOX_TOUCHED_H
#define CLVOX_TOUCHED_H

#include "common/bricks.h"

#define TOUCHED_PARAMETERS \
    TREE_PARAMETERS, const __global uint *edge, const __global uint *edge_rank
#define TOUCHED_ARGUMENTS TREE_ARGUMENTS, edge, edge_rank
#define UNTOUCHED NO_BRICK

typedef struct {
    Tree tree;
    const __global uint *edge;
    const __global uint *edge_rank;
} Touched;

#define TOUCHED { TREE, edge, edge_rank }

/* Number of the touched voxel (x, y, z), or UNTOUCHED. */
static inline uint find_touched(const Touched *t, const int x, const int y, const int z)
{
#if LEVELS == 1
    return find_brick(t->tree, x, y, z);
#else
    const uint brick = find_brick(t->tree, x / BRICK_X, y / BRICK_Y, z / BRICK_Z);
    if (brick == NO_BRICK) return UNTOUCHED;
    const uint at = (place_in(z, BRICK_Z) * BRICK_Y + place_in(y, BRICK_Y)) * BRICK_X
                  + place_in(x, BRICK_X);
    const ulong word = (ulong)brick * BRICK_WORDS + at / 32;
    if (!(t->edge[word] >> (at % 32) & 1)) return UNTOUCHED;
    return rank_of(t->edge, t->edge_rank, word, at % 32);
#endif
}

/* Number of the cell that holds the voxel (x, y, z), or UNTOUCHED. */
static inline uint find_cell(const Touched *t, const int x, const int y, const int z)
{
#if LEVELS == 1
    return find_brick(t->tree, x, y, z);
#else
    return find_brick(t->tree, x / BRICK_X, y / BRICK_Y, z / BRICK_Z);
#endif
}

#endif
