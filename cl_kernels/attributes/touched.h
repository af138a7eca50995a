/*
 * attributes/touched.h: the number of a touched voxel, and of a cell that holds some.
 *
 * Touched voxels are numbered in the order of their bits in `edge`, cells as their bricks are.  In
 * a dense model each touched voxel is a cell of its own: there TREE_ARGUMENTS are the grid's shape,
 * `edge` and `edge_rank`.
 *
 * Defines:    LEVELS, BRICK_*, MIDDLE_*  of the model (common/bricks.h)
 */
#ifndef CLVOX_TOUCHED_H
#define CLVOX_TOUCHED_H

#include "common/bricks.h"

#define TOUCHED_PARAMETERS \
    TREE_PARAMETERS, const __global uint *edge, const __global uint *edge_rank
#define UNTOUCHED NO_BRICK

/* Number of the cell that holds the voxel (x, y, z), or UNTOUCHED. */
static inline uint find_cell(const Tree tree, const int x, const int y, const int z)
{
#if LEVELS == 1
    return find_brick(tree, x, y, z);
#else
    return find_brick(tree, x / BRICK_X, y / BRICK_Y, z / BRICK_Z);
#endif
}

/* Bit of the voxel (x, y, z), which lies in cell `cell`, counted over all words of `edge`. */
static inline ulong edge_bit(const uint cell, const int x, const int y, const int z)
{
#if LEVELS == 1
    return 0;
#else
    const uint at = (place_in(z, BRICK_Z) * BRICK_Y + place_in(y, BRICK_Y)) * BRICK_X
                  + place_in(x, BRICK_X);
    return (ulong)cell * (32 * BRICK_WORDS) + at;
#endif
}

/* Number of a touched voxel of cell `cell`, which has the bit `bit`. */
static inline uint touched_number(
    const uint cell, const __global uint *edge, const __global uint *edge_rank, const ulong bit)
{
#if LEVELS == 1
    return cell;
#else
    return rank_of(edge, edge_rank, bit / 32, bit % 32);
#endif
}

#endif
