/*
 * winding/fill_cells.cl: the voxels whose generalised winding number is above a half.
 *
 * The winding number of a sample is the sum of the signs of the crossings before it, along its ray
 * along y, less what the curtain over the rim winds around it (winding/curtain.h).
 *
 * Host:       clvox/ops/winding.py, fill_winding()
 * Reference:  clvox/reference/winding.py, winding_numbers()
 * Tests:      tests/kernels/test_winding.py
 * Defines:    STEP_BITS      log2 of the lattice steps in one voxel
 *             FRACTION_BITS  of the depths of crossings
 *             BRICK_X, BRICK_Y, BRICK_Z  voxels along the sides of a cell
 */
#include "common/index.h"
#include "winding/curtain.h"

#define MIXED (-32768)
#define BRICK_WORDS ((BRICK_X * BRICK_Y * BRICK_Z + 31) / 32)

/* Sum of the signs of the crossings before voxel (x, y, z) on its ray.
 * window: the rays listed, (first z, first x, last z, last x).
 * offsets: (rays + 1,) uint64; rows: sorted crossings, depth * 2^32 + 2 * triangle + (1 if in). */
static inline int signs_before(
    const int4 window, const __global ulong *offsets, const __global long *rows,
    const int x, const int y, const int z)
{
    const ulong ray = (ulong)(z - window.x) * (window.w - window.y + 1) + (x - window.y);
    const ulong stop = offsets[ray + 1];
    const long end = (long)y << FRACTION_BITS;
    int sum = 0;
    for (ulong at = offsets[ray]; at < stop && rows[at] >> 32 <= end; ++at)
        sum += rows[at] & 1 ? 1 : -1;
    return sum;
}

/* One work-item decides the cells without a brick of one word of the grid of cells.
 * words: of the layers of cells whose rays are listed, the first of which is layer `layer`.
 * cells: shape of that grid.  thresholds: int16 per cell, x fastest (classify_cells.cl).
 * boundary: bits of cells with a brick.  inside: bits, undefined on entry. */
__kernel void fill_cells(
    const ulong words, const int layer, const int4 cells, const int4 window,
    const __global ulong *restrict offsets, const __global long *restrict rows,
    const __global short *restrict thresholds, const __global uint *restrict boundary,
    __global uint *restrict inside)
{
    if (get_global_id(0) >= words) return;
    const int row_words = (cells.x + 31) / 32;
    ulong rest = get_global_id(0);
    const int first = 32 * take_place(&rest, row_words);
    const int y = take_place(&rest, cells.y);
    const int z = layer + (int)rest;
    const ulong row = (ulong)z * cells.y + y;
    const ulong word = row * row_words + first / 32;
    uint bits = 0;
    for (int lane = 0; lane < min(cells.x - first, 32); ++lane) {
        const int x = first + lane;
        if (boundary[word] >> lane & 1) continue;
        const int sum = signs_before(
            window, offsets, rows, x * BRICK_X, y * BRICK_Y, z * BRICK_Z);
        if (sum >= thresholds[row * cells.x + x]) bits |= 1u << lane;
    }
    inside[word] = bits;
}

/* One work-item writes one word of one brick, if the rays through it are listed.
 * voxels: shape of the grid.  owners: (bricks, 3) int32, the cell of each brick.
 * rim, scale: winding/curtain.h.  bricks: (count, words) uint32, undefined on entry. */
__kernel void fill_bricks(
    const ulong start, const ulong stop, const int4 voxels, const int4 cells, const int4 window,
    const uint edges, const float4 scale, const __global int *restrict rim,
    const __global ulong *restrict offsets, const __global long *restrict rows,
    const __global short *restrict thresholds, const __global int *restrict owners,
    __global uint *restrict bricks)
{
    const ulong id = start + get_global_id(0);
    if (id >= stop) return;
    ulong brick = id;
    const int first = 32 * take_place(&brick, BRICK_WORDS);
    const int3 cell = vload3(brick, owners);
    const int3 low = cell * (int3)(BRICK_X, BRICK_Y, BRICK_Z);
    if (low.z < window.x || low.z > window.z) return;
    const int threshold
        = thresholds[((ulong)cell.z * cells.y + cell.y) * cells.x + cell.x];
    uint bits = 0;
    for (int lane = 0; lane < min(BRICK_X * BRICK_Y * BRICK_Z - first, 32); ++lane) {
        ulong rest = first + lane;
        const int x = low.x + take_place(&rest, BRICK_X);
        const int y = low.y + take_place(&rest, BRICK_Y);
        const int z = low.z + (int)rest;
        if (x >= voxels.x || y >= voxels.y || z >= voxels.z) continue;
        const int sum = signs_before(window, offsets, rows, x, y, z);
        bool in = sum >= threshold;
        if (threshold == MIXED) {
            const int3 centre = (int3)(x, y, z) << STEP_BITS;
            in = (float)sum > curtain_winding(rim, edges, centre, scale) + 0.5f;
        }
        if (in) bits |= 1u << lane;
    }
    bricks[id] = bits;
}
