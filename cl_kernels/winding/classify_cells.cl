/*
 * winding/classify_cells.cl: in which cells crossings alone decide what is inside.
 *
 * A sample is inside if the crossings before it, by sign, exceed what the curtain over the rim
 * winds around it (winding/curtain.h) by more than a half.  Away from the rim that winding changes
 * slowly, and only the curtain makes it jump, by whole numbers.  So most cells have a threshold:
 * the least sum of signs that is inside, for all of their samples.
 *
 * Host:       clvox/ops/winding.py, classify_cells()
 * Reference:  clvox/reference/winding.py, winding_numbers()
 * Tests:      tests/kernels/test_winding.py
 * Defines:    STEP_BITS  log2 of the lattice steps in one voxel
 */
#include "common/index.h"
#include "winding/curtain.h"

#define MIXED (-32768)

/* One work-item classifies one cell.
 * voxels: shape of the grid; cells: of the grid of cells; side: voxels in one of them.
 * rim, scale: winding/curtain.h.
 * above: thresholds of larger cells, `factor` cells of this grid along each axis, of the shape
 * `blocks`; a factor of 0: there are none.
 * thresholds: int16 per cell, x fastest: the least sum of signs that is inside, or MIXED.
 * marks: a bit per cell, rows padded to words, added to: set for MIXED. */
__kernel void classify_cells(
    const ulong count, const int4 voxels, const int4 cells, const int4 side,
    const int4 blocks, const int factor, const uint edges, const float4 scale,
    const __global int *restrict rim, const __global short *restrict above,
    __global short *restrict thresholds, __global uint *restrict marks)
{
    #pragma OPENCL FP_CONTRACT OFF
    const ulong id = get_global_id(0);
    if (id >= count) return;
    ulong number = id;
    const int x = take_place(&number, cells.x);
    const int y = take_place(&number, cells.y);
    const int z = (int)number;
    if (factor) {
        const ulong block
            = ((ulong)(z / factor) * blocks.y + y / factor) * blocks.x + x / factor;
        const short known = above[block];
        if (known != MIXED) {
            thresholds[id] = known;
            return;
        }
    }
    const int3 from = (int3)(x, y, z) * side.xyz;
    const int3 low = from << STEP_BITS;
    const int3 high = (min(from + side.xyz, voxels.xyz) - 1) << STEP_BITS;
    const Box box = make_box(low, high, scale);
    float change = MARGIN;
    bool mixed = false;
    for (uint edge = 0; edge < edges && !mixed; ++edge) {
        const int3 a = vload3(2 * (ulong)edge, rim);
        const int3 b = vload3(2 * (ulong)edge + 1, rim);
        const float gap = gap_to(box, a, b, scale);
        mixed = gap <= 0.0f || curtain_meets(box, a, b);
        change += change_of(box, gap, a, b, scale);
    }
    short threshold = MIXED;
    if (!mixed && change < 0.5f) {
        const float least = curtain_winding(rim, edges, box.centre, scale) + 0.5f;
        const float below = floor(least);
        if (min(least - below, below + 1.0f - least) > change && fabs(below) < 32000.0f)
            threshold = (short)((int)below + 1);
    }
    thresholds[id] = threshold;
    if (threshold == MIXED) {
        const ulong row = (ulong)z * cells.y + y;
        atomic_or(marks + row * ((cells.x + 31) / 32) + x / 32, 1u << (x % 32));
    }
}
