/*
 * common/bricks.h: where the bits of a model of two or three levels are.
 *
 * Cells of the coarse grid are bits, x fastest, rows padded to whole 32-bit words.  A brick holds
 * the cells of the next level within one boundary cell as bits, x fastest, padded to whole words;
 * bricks are numbered in the order of their cells' bits.  A face is the rays along y through a
 * cell of voxels, as bits, x fastest, padded to whole words (docs/layouts draws all of them).
 *
 * Defines:    LEVELS                        2 or 3
 *             BRICK_X, BRICK_Y, BRICK_Z     voxels along the sides of a brick of voxels
 *             MIDDLE_X, MIDDLE_Y, MIDDLE_Z  if LEVELS is 3, cells along the sides of a brick of
 *                                           cells
 *             RANK_WORDS                    words for each entry of a rank, if not 8
 */
#ifndef CLVOX_BRICKS_H
#define CLVOX_BRICKS_H

#include "common/index.h"

#define BRICK_WORDS ((BRICK_X * BRICK_Y * BRICK_Z + 31) / 32)
#define FACE_WORDS ((BRICK_X * BRICK_Z + 31) / 32)
#ifndef RANK_WORDS
#define RANK_WORDS 8
#endif
#define NO_BRICK 0xffffffffu

static inline uint words_in_row(const uint cells)
{
    return (cells + 31) / 32;
}

/* Word of the coarse bits that holds cell (x, y, z); the bit is x % 32. */
static inline ulong cell_word(const int4 cells, const int x, const int y, const int z)
{
    return ((ulong)z * cells.y + y) * words_in_row(cells.x) + (uint)x / 32;
}

/* Number of set bits of `boundary` before bit `bit` of word `word`. */
static inline uint rank_of(
    const __global uint *boundary, const __global uint *rank, const ulong word, const uint bit)
{
    uint count = rank[word / RANK_WORDS] + popcount(boundary[word] & ((1u << bit) - 1u));
    for (ulong w = word & ~(ulong)(RANK_WORDS - 1); w < word; ++w) count += popcount(boundary[w]);
    return count;
}

/* Brick of cell (x, y, z) of the coarse grid, or NO_BRICK. */
static inline uint find_coarse(
    const int4 cells, const __global uint *boundary, const __global uint *rank,
    const int x, const int y, const int z)
{
    const ulong word = cell_word(cells, x, y, z);
    const uint bit = (uint)x % 32;
    if (!(boundary[word] >> bit & 1)) return NO_BRICK;
    return rank_of(boundary, rank, word, bit);
}

/* The tree above the bricks of voxels, as kernel arguments and as a value.
 * cells: shape of the coarse grid; boundary, rank: its bits and their ranks;
 * middle, middle_rank: the same in bricks of cells, if LEVELS is 3. */
#if LEVELS == 3

#define MIDDLE_WORDS ((MIDDLE_X * MIDDLE_Y * MIDDLE_Z + 31) / 32)
#define TREE_PARAMETERS \
    const int4 cells, const __global uint *boundary, const __global uint *rank, \
    const __global uint *middle, const __global uint *middle_rank
#define TREE_ARGUMENTS cells, boundary, rank, middle, middle_rank
#define TREE { TREE_ARGUMENTS }

typedef struct {
    int4 cells;
    const __global uint *boundary;
    const __global uint *rank;
    const __global uint *middle;
    const __global uint *middle_rank;
} Tree;

/* Bit, counted over all bricks of cells, of the cell of voxels (x, y, z), which lies in brick
 * `node`. */
static inline ulong middle_bit(const uint node, const int x, const int y, const int z)
{
    const int at = (place_in(z, MIDDLE_Z) * MIDDLE_Y + place_in(y, MIDDLE_Y)) * MIDDLE_X
                 + place_in(x, MIDDLE_X);
    return (ulong)node * (32 * MIDDLE_WORDS) + at;
}

/* Brick of cells that holds the cell of voxels (x, y, z), or NO_BRICK. */
static inline uint find_node(const Tree tree, const int x, const int y, const int z)
{
    return find_coarse(
        tree.cells, tree.boundary, tree.rank, x / MIDDLE_X, y / MIDDLE_Y, z / MIDDLE_Z);
}

/* Brick of voxels of the cell (x, y, z) of the last level but one, which lies in brick `node`, or
 * NO_BRICK. */
static inline uint find_in_node(
    const Tree tree, const uint node, const int x, const int y, const int z)
{
    if (node == NO_BRICK) return NO_BRICK;
    const ulong bit = middle_bit(node, x, y, z);
    if (!(tree.middle[bit / 32] >> (bit % 32) & 1)) return NO_BRICK;
    return rank_of(tree.middle, tree.middle_rank, bit / 32, bit % 32);
}

static inline uint find_brick(const Tree tree, const int x, const int y, const int z)
{
    return find_in_node(tree, find_node(tree, x, y, z), x, y, z);
}

#else

#define TREE_PARAMETERS \
    const int4 cells, const __global uint *boundary, const __global uint *rank
#define TREE_ARGUMENTS cells, boundary, rank
#define TREE { TREE_ARGUMENTS }

typedef struct {
    int4 cells;
    const __global uint *boundary;
    const __global uint *rank;
} Tree;

/* Brick of voxels of the cell (x, y, z), or NO_BRICK. */
static inline uint find_brick(const Tree tree, const int x, const int y, const int z)
{
    return find_coarse(tree.cells, tree.boundary, tree.rank, x, y, z);
}

#endif
#endif
