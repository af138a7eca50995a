/*
 * common/bricks.h: where the bits of a two-level model are.
 *
 * Cells of the coarse grid are bits, x fastest, rows padded to whole 32-bit words.  A brick holds
 * the voxels of one boundary cell as bits, x fastest, padded to whole words; bricks are numbered
 * in the order of their cells.  A face is the n1x * n1z rays along y through a cell, as bits, x
 * fastest, padded to whole words (docs/layouts draws all of them).
 *
 * Defines:    BRICK_X, BRICK_Y, BRICK_Z  voxels along the sides of a brick
 */
#ifndef CLVOX_BRICKS_H
#define CLVOX_BRICKS_H

#define BRICK_WORDS ((BRICK_X * BRICK_Y * BRICK_Z + 31) / 32)
#define FACE_WORDS ((BRICK_X * BRICK_Z + 31) / 32)
#define RANK_WORDS 8
#define NO_BRICK 0xffffffffu

static inline uint words_in_row(const uint cells)
{
    return (cells + 31) / 32;
}

/* Word of the coarse bits that holds cell (x, y, z); the bit is x % 32. */
static inline ulong cell_word(const int4 cells, const int x, const int y, const int z)
{
    return ((ulong)z * cells.y + y) * words_in_row(cells.x) + x / 32;
}

/* Number of set bits of `boundary` before bit `bit` of word `word`. */
static inline uint rank_of(
    const __global uint *boundary, const __global uint *rank, const ulong word, const uint bit)
{
    uint count = rank[word / RANK_WORDS] + popcount(boundary[word] & ((1u << bit) - 1u));
    for (ulong w = word & ~(ulong)(RANK_WORDS - 1); w < word; ++w) count += popcount(boundary[w]);
    return count;
}

/* Brick of a cell, or NO_BRICK. */
static inline uint find_brick(
    const int4 cells, const __global uint *boundary, const __global uint *rank,
    const int x, const int y, const int z)
{
    const ulong word = cell_word(cells, x, y, z);
    if (!(boundary[word] >> (x % 32) & 1)) return NO_BRICK;
    return rank_of(boundary, rank, word, x % 32);
}

#endif
