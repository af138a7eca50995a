/*
 * winding/fill_cells.cl: the voxels whose generalised winding number is above a half.
 *
 * The winding number of a sample is the sum of the signs of the crossings before it, along its ray
 * along y, with the mesh and the caps over its holes, less what these caps wind around it
 * (winding/caps.h).  Where that is too near to a half to tell, it is the sum of those with the mesh
 * alone, less what the curtain over the rim winds (winding/curtain.h).
 *
 * Host:       clvox/ops/winding.py, fill_winding()
 * Reference:  clvox/reference/winding.py, winding_numbers()
 * Tests:      tests/kernels/test_winding.py
 * Defines:    STEP_BITS      log2 of the lattice steps in one voxel
 *             FRACTION_BITS  of the depths of crossings
 *             MIXED          the threshold of cells that have none
 *             BRICK_X, BRICK_Y, BRICK_Z  voxels along the sides of a cell
 */
#include "common/index.h"
#include "winding/box.h"
#include "winding/curtain.h"

#define BRICK_WORDS ((BRICK_X * BRICK_Y * BRICK_Z + 31) / 32)

/* Sum of the signs of the crossings before a voxel on its ray.
 * window: the rays listed, (first z, first x, last z, last x).
 * offsets: (rays + 1,) uint64; rows: sorted crossings, depth * 2^32 + 2 * triangle + (1 if in). */
static inline int signs_before(
    const int4 window, const __global ulong *offsets, const __global long *rows, const int3 voxel)
{
    const ulong ray
        = (ulong)(voxel.z - window.x) * (window.w - window.y + 1) + (voxel.x - window.y);
    const ulong stop = offsets[ray + 1];
    const long end = (long)voxel.y << FRACTION_BITS;
    int sum = 0;
    for (ulong at = offsets[ray]; at < stop && rows[at] >> 32 <= end; ++at)
        sum += rows[at] & 1 ? 1 : -1;
    return sum;
}

/* One work-item decides the cells without a brick of one word of the grid of cells.
 * words: of the layers of cells whose rays are listed, the first of which is layer `layer`.
 * offsets, rows: crossings with the mesh; cap_offsets, cap_rows: with the caps.
 * cells: shape of that grid.  thresholds: int16 per cell, x fastest (classify_cells.cl).
 * boundary: bits of cells with a brick.  inside: bits, undefined on entry. */
__kernel void fill_cells(
    const ulong words, const int layer, const int4 cells, const int4 window,
    const __global ulong *restrict offsets, const __global long *restrict rows,
    const __global ulong *restrict cap_offsets, const __global long *restrict cap_rows,
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
        const int3 first = (int3)(x * BRICK_X, y * BRICK_Y, z * BRICK_Z);
        const int sum = signs_before(window, offsets, rows, first)
                      + signs_before(window, cap_offsets, cap_rows, first);
        if (sum >= thresholds[row * cells.x + x]) bits |= 1u << lane;
    }
    inside[word] = bits;
}

/* Is the sample at p inside?  The caps tell in nearly all cases, most of them by what the sample
 * shares with its neighbours, the others the more closely they are looked at; otherwise the curtain
 * over the whole rim does.
 * signs: of the crossings with the mesh before it; caps: of those with the caps. */
static inline bool is_inside(
    const int signs, const int caps, const int3 p, const Surroundings *around,
    const uint edges, const __global int *rim, CAPS_PARAMETERS)
{
    Estimate found = wind_near(around, p, CAPS);
    float over = (float)(signs + caps) - found.winding - 0.5f;
    for (float care = 4.0f; care <= 16.0f && !(fabs(over) > found.error); care *= 4.0f) {
        found = wind_caps(p, 0.0f, care, CAPS);
        over = (float)(signs + caps) - found.winding - 0.5f;
    }
    if (fabs(over) > found.error) return over > 0.0f;
    return (float)signs > curtain_winding(rim, edges, p, scale) + 0.5f;
}

/* Place of voxel `number` of a brick, x fastest. */
static inline int3 place_of(const int number)
{
    ulong rest = number;
    const int x = take_place(&rest, BRICK_X);
    const int y = take_place(&rest, BRICK_Y);
    return (int3)(x, y, (int)rest);
}

/* One work-item writes one word of one brick, if the rays through it are listed.
 * voxels: shape of the grid.  owners: (bricks, 3) int32, the cell of each brick.
 * edges, rim: winding/curtain.h; nodes to corners: winding/caps.h.
 * bricks: (count, words) uint32, undefined on entry. */
__kernel void fill_bricks(
    const ulong words, const int4 voxels, const int4 cells, const int4 window, const uint edges,
    const __global int *restrict rim, const int nodes, const float4 scale,
    const __global int *restrict places, const __global float *restrict moments,
    const __global int *restrict corners, const __global ulong *restrict offsets,
    const __global long *restrict rows, const __global ulong *restrict cap_offsets,
    const __global long *restrict cap_rows, const __global short *restrict thresholds,
    const __global int *restrict owners, __global uint *restrict bricks)
{
    const ulong id = get_global_id(0);
    if (id >= words) return;
    ulong brick = id;
    const int first = 32 * take_place(&brick, BRICK_WORDS);
    const int last = min(first + 32, BRICK_X * BRICK_Y * BRICK_Z);
    const int3 cell = vload3(brick, owners);
    const int3 corner = cell * (int3)(BRICK_X, BRICK_Y, BRICK_Z);
    if (corner.z < window.x || corner.z > window.z) return;
    Surroundings around;
    short threshold = thresholds[((ulong)cell.z * cells.y + cell.y) * cells.x + cell.x];
    if (threshold == MIXED) {
        int3 low = voxels.xyz, high = corner;
        for (int number = first; number < last; ++number) {
            const int3 voxel = corner + place_of(number);
            low = min(low, voxel);
            high = max(high, voxel);
        }
        high = min(high, voxels.xyz - 1);
        low = min(low, high);
        threshold = threshold_of(low, high, CAPS);
        if (threshold == MIXED)
            look_around(&around, centre_of(low, high), reach_of(low, high, scale), CAPS);
    }
    uint bits = 0;
    for (int number = first; number < last; ++number) {
        const int3 voxel = corner + place_of(number);
        if (any(voxel >= voxels.xyz)) continue;
        const int signs = signs_before(window, offsets, rows, voxel);
        const int caps = signs_before(window, cap_offsets, cap_rows, voxel);
        const bool in = threshold == MIXED
            ? is_inside(signs, caps, voxel << STEP_BITS, &around, edges, rim, CAPS)
            : signs + caps >= threshold;
        if (in) bits |= 1u << (number - first);
    }
    bricks[id] = bits;
}
