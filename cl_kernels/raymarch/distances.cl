/*
 * raymarch/distances.cl: how many blocks of cells each block is away from one that is not empty.
 *
 * Along one axis after the other: the distance is the largest of those along the axes, so that the
 * least of what neighbours along one axis know, and of how far away they are, is exact.
 *
 * Host:       clvox/ops/distances.py
 * Reference:  clvox/reference/raymarch.py, block_distances()
 * Tests:      tests/kernels/test_distances.py
 * Defines:    SIDE  coarse cells along the side of a block, a power of two
 *             MOST  distances are at most this
 */
#include "common/bricks.h"
#include "raymarch/states.h"

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
    /* The side is a power of two: a block's row is part of one word, or some words. */
    const uint bits = SIDE < 32 ? (1u << (SIDE % 32)) - 1u : 0xffffffffu;
    uint found = 0;
    for (int k = z * SIDE; k < min((z + 1) * SIDE, cells.z); ++k)
        for (int j = y * SIDE; j < min((y + 1) * SIDE, cells.y); ++j)
            for (int i = x * SIDE; i < min((x + 1) * SIDE, cells.x); i += 32) {
                const ulong word = cell_word(cells, i, j, k);
                found |= ((boundary[word] | inside[word]) >> (i % 32)) & bits;
            }
    distances[id] = found ? 0 : MOST;
}

/* One work-item looks at one block, as occupy() does: MOST where all of it is inside, else 0. */
__kernel void fill(
    const int4 blocks, const int4 cells, const __global uint *restrict inside,
    __global uchar *restrict distances)
{
    const ulong id = get_global_id(0);
    ulong number = id;
    const int x = take_place(&number, blocks.x), y = take_place(&number, blocks.y);
    const int z = (int)number;
    if (z >= blocks.z) return;
    uint found = 0;
    for (int k = z * SIDE; k < min((z + 1) * SIDE, cells.z); ++k)
        for (int j = y * SIDE; j < min((y + 1) * SIDE, cells.y); ++j)
            for (int i = x * SIDE; i < min((x + 1) * SIDE, cells.x); i += 32) {
                const int count = min((x + 1) * SIDE, cells.x) - i;
                const uint bits = count < 32 ? (1u << count) - 1u : 0xffffffffu;
                found |= (~inside[cell_word(cells, i, j, k)] >> (i % 32)) & bits;
            }
    distances[id] = found ? 0 : MOST;
}

/* One work-item puts together what is known of one of `count` blocks, from how far the next one is
 * that is not empty, and that is not inside (raymarch/states.h); at most `most`, how many blocks
 * the grid is long.  Along an axis with fewer, or wider ones, so many may be far beyond the grid:
 * march.cl says what keeps a ray's moments within 64 bits. */
__kernel void join(
    const ulong count, const uint most, const __global uchar *restrict outer,
    const __global uchar *restrict inner, __global uchar *restrict distances)
{
    const ulong id = get_global_id(0);
    if (id >= count) return;
    const uint away = min(max((uint)inner[id], (uint)outer[id]), most);
    distances[id] = inner[id] > 0 ? INSIDE_STATE | away : away;
}

/* One work-item puts together what is known of one cell.
 * distances: (cells,) uint8, as join() leaves them.
 * states: (cells,) uint32 (raymarch/states.h). */
__kernel void merge(
    const int4 cells, const __global uint *restrict boundary, const __global uint *restrict rank,
    const __global uchar *restrict distances, __global uint *restrict states)
{
    const ulong id = get_global_id(0);
    ulong number = id;
    const int x = take_place(&number, cells.x), y = take_place(&number, cells.y);
    const int z = (int)number;
    if (z >= cells.z) return;
    const uint brick = find_coarse(cells, boundary, rank, x, y, z);
    states[id] = brick != NO_BRICK ? brick : UNIFORM | distances[id];
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
