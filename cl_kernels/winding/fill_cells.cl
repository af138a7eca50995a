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

/* Most edges whose curtain meets a box and is followed from sample to sample. */
#define MET 32

/* What the curtain winds around the samples of a box.
 * smooth: it is `winding` at the sample `start`, and anywhere else the same but for jumps across
 * the curtain over the edges `met`, and for no more than `change`; else nothing is known. */
typedef struct {
    int3 start;
    bool smooth;
    float winding, change;
    uint count;
    uint met[MET];
} Curtain;

static inline void hang_curtain(
    Curtain *curtain, const Box box, const uint edges, const float4 scale,
    const __global int *rim)
{
    curtain->start = box.low;
    curtain->smooth = true;
    curtain->change = MARGIN;
    curtain->count = 0;
    for (uint edge = 0; edge < edges && curtain->smooth; ++edge) {
        const int3 a = vload3(2 * (ulong)edge, rim);
        const int3 b = vload3(2 * (ulong)edge + 1, rim);
        const float gap = gap_to(box, a, b, scale);
        /* From the first sample to any other it is twice as far as from the centre. */
        curtain->change += 2.0f * change_of(box, gap, a, b, scale);
        if (gap <= 0.0f || curtain->change >= 0.5f) {
            curtain->smooth = false;
        } else if (curtain_meets(box, a, b)) {
            if (curtain->count == MET || box.low.y <= max(a.y, b.y)) curtain->smooth = false;
            else curtain->met[curtain->count++] = edge;
        }
    }
    if (curtain->smooth) curtain->winding = curtain_winding(rim, edges, box.low, scale);
}

/* Is the sample at p inside, after crossings whose signs have the sum `sum`? */
static inline bool is_inside(
    const Curtain *curtain, const int sum, const int3 p, const uint edges, const float4 scale,
    const __global int *rim)
{
    if (curtain->smooth) {
        const int3 corner = (int3)(p.x, p.y, curtain->start.z);
        int jumps = 0;
        for (uint i = 0; i < curtain->count; ++i) {
            const int3 a = vload3(2 * (ulong)curtain->met[i], rim);
            const int3 b = vload3(2 * (ulong)curtain->met[i] + 1, rim);
            jumps += jump_along(a, b, (int3)(curtain->start.x, p.y, corner.z), corner)
                   + jump_along(a, b, corner, p);
        }
        const float over = (float)(sum - jumps) - curtain->winding - 0.5f;
        if (fabs(over) > curtain->change) return over > 0.0f;
    }
    return (float)sum > curtain_winding(rim, edges, p, scale) + 0.5f;
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
 * rim, scale: winding/curtain.h.  bricks: (count, words) uint32, undefined on entry. */
__kernel void fill_bricks(
    const ulong words, const int4 voxels, const int4 cells, const int4 window,
    const uint edges, const float4 scale, const __global int *restrict rim,
    const __global ulong *restrict offsets, const __global long *restrict rows,
    const __global short *restrict thresholds, const __global int *restrict owners,
    __global uint *restrict bricks)
{
    const ulong id = get_global_id(0);
    if (id >= words) return;
    ulong brick = id;
    const int first = 32 * take_place(&brick, BRICK_WORDS);
    const int last = min(first + 32, BRICK_X * BRICK_Y * BRICK_Z);
    const int3 cell = vload3(brick, owners);
    const int3 corner = cell * (int3)(BRICK_X, BRICK_Y, BRICK_Z);
    if (corner.z < window.x || corner.z > window.z) return;
    const int threshold
        = thresholds[((ulong)cell.z * cells.y + cell.y) * cells.x + cell.x];
    Curtain curtain;
    if (threshold == MIXED) {
        int3 low = voxels.xyz, high = corner;
        for (int number = first; number < last; ++number) {
            const int3 voxel = corner + place_of(number);
            low = min(low, voxel);
            high = max(high, voxel);
        }
        high = min(high, voxels.xyz - 1);
        low = min(low, high);
        hang_curtain(&curtain, make_box(low << STEP_BITS, high << STEP_BITS, scale), edges, scale,
                     rim);
    }
    uint bits = 0;
    for (int number = first; number < last; ++number) {
        const int3 voxel = corner + place_of(number);
        if (any(voxel >= voxels.xyz)) continue;
        const int sum = signs_before(window, offsets, rows, voxel.x, voxel.y, voxel.z);
        const bool in = threshold == MIXED
            ? is_inside(&curtain, sum, voxel << STEP_BITS, edges, scale, rim)
            : sum >= threshold;
        if (in) bits |= 1u << (number - first);
    }
    bricks[id] = bits;
}
