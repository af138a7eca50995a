/*
 * raymarch/around.h: the bits of rows of voxels, many at once.
 *
 * Defines:    LEVELS, RULE, BRICK_*, MIDDLE_*  (common/model.h)
 */
#ifndef CLVOX_AROUND_H
#define CLVOX_AROUND_H

#include "common/model.h"

/* So many bits, at most 32, from a bit of a word on; the next word is read only if needed. */
static inline uint bits_from(
    const __global uint *words, const ulong first, const uint bit, const int count)
{
    uint found = words[first] >> bit;
    if (bit + count > 32) found |= words[first + 1] << (32 - bit);
    return count < 32 ? found & ((1u << count) - 1u) : found;
}

#if LEVELS == 1

/* Voxels from (x, y, z) on along x, at most 32 and within the grid. */
static inline uint row_bits(
    MODEL_PARAMETERS, const int x, const int y, const int z, const int count)
{
    const ulong row = ((ulong)z * cells.y + y) * ((cells.x + 31) / 32);
    return bits_from(bricks, row + x / 32, x % 32, count);
}

#else

/* The same of a cell in the state `state`, at (x, y, z) in its brick, which holds all of them. */
static inline uint cell_bits(
    const __global uint *bricks, const ulong state, const int x, const int y, const int z,
    const int count)
{
    if (state >= CELL_OUTSIDE) {
        const uint all = count < 32 ? (1u << count) - 1u : 0xffffffffu;
        return state == CELL_INSIDE ? all : 0;
    }
    const uint bit = (z * BRICK_Y + y) * BRICK_X + x;
    return bits_from(bricks, state * BRICK_WORDS + bit / 32, bit % 32, count);
}

#endif
#endif
