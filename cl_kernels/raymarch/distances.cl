/*
 * raymarch/distances.cl: how many blocks of cells each block is away from one that is not empty.
 *
 * Along one axis after the other: the distance is the largest of those along the axes, so that the
 * least of what neighbours along one axis know, and of how far away they are, is exact.
 *
 * Host:       clvox/ops/distances.py
 * Reference:  clvox/reference/raymarch.py, block_distances()
 * Tests:      tests/kernels/test_distances.py
 * Defines:    SIDE  coarse cells along the side of a block
 *             MOST  distances are at most this
 */
#include "common/bricks.h"

/* One work-item looks at one block.
 * blocks: shape of the grid of blocks; cells: of the coarse grid; boundary, inside: their bits.
 * distances: (blocks,) uint8, x fastest; 0 where some cell is not empty, else MOST. */
__kernel void occupy(
    const int4 blocks, const int4 cells, const __global uint *restrict boundary,
    const __global uint *restrict inside, __global uchar *restrict distances)
{
    const ulong id = get_global_id(0);
    ulong number = id;
    const int x = take_place(&number, blocks.x), y = take_place(&number, blocks.y);
    const int z = (int)number;
    if (z >= blocks.z) return;
    uint found = 0;
    for (int k = z * SIDE; k < min((z + 1) * SIDE, cells.z); ++k)
        for (int j = y * SIDE; j < min((y + 1) * SIDE, cells.y); ++j)
            for (int i = x * SIDE; i < min((x + 1) * SIDE, cells.x); ++i) {
                const ulong word = cell_word(cells, i, j, k);
                found |= (boundary[word] | inside[word]) >> (i % 32) & 1;
            }
    distances[id] = found ? 0 : MOST;
}

/* One work-item looks along one axis; blocks lie `apart` in the array, `count` of them in a row. */
__kernel void spread(
    const int4 blocks, const int axis, const __global uchar *restrict given,
    __global uchar *restrict distances)
{
    const ulong id = get_global_id(0);
    ulong number = id;
    const int x = take_place(&number, blocks.x), y = take_place(&number, blocks.y);
    const int z = (int)number;
    if (z >= blocks.z) return;
    const int at = axis == 0 ? x : (axis == 1 ? y : z);
    const int count = axis == 0 ? blocks.x : (axis == 1 ? blocks.y : blocks.z);
    const long apart = axis == 0 ? 1 : (axis == 1 ? (long)blocks.x : (long)blocks.x * blocks.y);
    int best = given[id];
    for (int away = 1; away < best; ++away) {
        if (at >= away) best = min(best, max(away, (int)given[(long)id - away * apart]));
        if (at + away < count) best = min(best, max(away, (int)given[(long)id + away * apart]));
    }
    distances[id] = (uchar)best;
}
