/*
 * pack/pack_voxels.cl: an array of bytes as a two-level model.
 *
 * Cells whose voxels differ get a brick; the others are wholly in or out.
 *
 * Host:       clvox/ops/pack.py
 * Reference:  clvox/reference/multilevel.py, from_voxels()
 * Tests:      tests/kernels/test_pack.py
 * Defines:    BRICK_X, BRICK_Y, BRICK_Z  voxels along the sides of a brick
 */
#include "common/bricks.h"

/* One work-item tells the 32 cells of one word apart.
 * layer: first of the layers of cells along z that `bytes` holds; layers: how many.
 * voxels: shape of the fine grid.
 * bytes: (planes, voxels.y, voxels.x) uint8, 0 or 1, the planes of those layers.
 * boundary, inside: bits of all cells; the words of those layers are written. */
__kernel void pack_cells(
    const int layer, const int layers, const int4 cells, const int4 voxels,
    const __global uchar *restrict bytes,
    __global uint *restrict boundary, __global uint *restrict inside)
{
    const uint row_words = words_in_row(cells.x);
    const ulong id = get_global_id(0);
    if (id >= (ulong)row_words * cells.y * layers) return;
    ulong number = id;
    const int first = take_place(&number, row_words) * 32;
    const int y = take_place(&number, cells.y);
    const int z = (int)number;
    uint mixed = 0, solid = 0;
    for (int lane = 0; lane < min(cells.x - first, 32); ++lane) {
        const int3 low = (int3)(first + lane, y, z) * (int3)(BRICK_X, BRICK_Y, BRICK_Z);
        const int3 size = min(
            voxels.xyz - low - (int3)(0, 0, layer * BRICK_Z), (int3)(BRICK_X, BRICK_Y, BRICK_Z));
        uint count = 0;
        for (int k = 0; k < size.z; ++k)
            for (int j = 0; j < size.y; ++j)
                for (int i = 0; i < size.x; ++i)
                    count += bytes[((ulong)(low.z + k) * voxels.y + low.y + j) * voxels.x
                                   + low.x + i];
        const bool full = count == (uint)(size.x * size.y * size.z);
        solid |= (uint)full << lane;
        mixed |= (uint)(count != 0 && !full) << lane;
    }
    const ulong word = cell_word(cells, first, y, z + layer);
    boundary[word] = mixed;
    inside[word] = solid;
}

/* One work-item writes the bricks of the 32 cells of one word.
 * bricks: words, all of those bricks written. */
__kernel void pack_bricks(
    const int layer, const int layers, const int4 cells, const int4 voxels,
    const __global uchar *restrict bytes,
    const __global uint *restrict boundary, const __global uint *restrict rank,
    __global uint *restrict bricks)
{
    const uint row_words = words_in_row(cells.x);
    const ulong id = get_global_id(0);
    if (id >= (ulong)row_words * cells.y * layers) return;
    ulong number = id;
    const int first = take_place(&number, row_words) * 32;
    const int y = take_place(&number, cells.y);
    const int z = (int)number;
    const ulong word = cell_word(cells, first, y, z + layer);
    const uint touched = boundary[word];
    if (!touched) return;
    __global uint *brick = bricks + (ulong)rank_of(boundary, rank, word, 0) * BRICK_WORDS;
    for (uint left = touched; left; left &= left - 1, brick += BRICK_WORDS) {
        const int lane = popcount((left & -left) - 1);
        const int3 low = (int3)(first + lane, y, z) * (int3)(BRICK_X, BRICK_Y, BRICK_Z);
        uint bits = 0;
        for (int voxel = 0; voxel < BRICK_X * BRICK_Y * BRICK_Z; ++voxel) {
            ulong place = voxel;
            const int i = take_place(&place, BRICK_X), j = take_place(&place, BRICK_Y);
            const int3 at = low + (int3)(i, j, (int)place);
            if (at.x < voxels.x && at.y < voxels.y && at.z + layer * BRICK_Z < voxels.z)
                bits |= (uint)bytes[((ulong)at.z * voxels.y + at.y) * voxels.x + at.x]
                        << (voxel % 32);
            if (voxel % 32 == 31 || voxel == BRICK_X * BRICK_Y * BRICK_Z - 1) {
                brick[voxel / 32] = bits;
                bits = 0;
            }
        }
    }
}
