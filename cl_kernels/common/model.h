/*
 * common/model.h: reading a voxel of a model, in O(levels) look-ups.
 *
 * Defines:    LEVELS  1: a dense grid of bits; 2: a coarse grid and bricks
 *             RULE    which bit is asked for, below
 *             BRICK_X, BRICK_Y, BRICK_Z  sides of a brick, if LEVELS is 2
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

/* Arguments of a model: shape of its coarse grid (of the fine one if LEVELS is 1); its arrays (see
 * docs/layouts.md); and `edge`, laid out like `bricks`: which voxels are touched, not read if RULE
 * is CENTRE.  Arrays that a one-level model lacks are not read. */
#define MODEL_PARAMETERS \
    const int4 cells, const __global uint *restrict boundary, \
    const __global uint *restrict inside, const __global uint *restrict rank, \
    const __global uint *restrict bricks, const __global uint *restrict edge
/* The same for functions: from `restrict` there, compilers make what Oclgrind does not know. */
#define MODEL_READ \
    const int4 cells, const __global uint *boundary, const __global uint *inside, \
    const __global uint *rank, const __global uint *bricks, const __global uint *edge
#define MODEL_ARGUMENTS cells, boundary, inside, rank, bricks, edge

#if RULE == CENTRE
#define EDGE_BIT(word, bit) 0
#else
#define EDGE_BIT(word, bit) (edge[word] >> (bit) & 1)
#endif

#if LEVELS == 1

static inline uint read_voxel(MODEL_READ, const int x, const int y, const int z)
{
    const ulong word = ((ulong)z * cells.y + y) * ((cells.x + 31) / 32) + x / 32;
    return by_rule(bricks[word] >> (x % 32) & 1, EDGE_BIT(word, x % 32));
}

#else

#include "common/bricks.h"

static inline uint read_voxel(MODEL_READ, const int x, const int y, const int z)
{
    const int cx = x / BRICK_X, cy = y / BRICK_Y, cz = z / BRICK_Z;
    const ulong at = cell_word(cells, cx, cy, cz);
    if (!(boundary[at] >> (cx % 32) & 1)) return by_rule(inside[at] >> (cx % 32) & 1, 0);
    const uint brick = rank_of(boundary, rank, at, cx % 32);
    const int in_x = x - cx * BRICK_X, in_y = y - cy * BRICK_Y, in_z = z - cz * BRICK_Z;
    const uint voxel = (in_z * BRICK_Y + in_y) * BRICK_X + in_x;
    const ulong word = (ulong)brick * BRICK_WORDS + voxel / 32;
    return by_rule(bricks[word] >> (voxel % 32) & 1, EDGE_BIT(word, voxel % 32));
}

#endif
#endif
