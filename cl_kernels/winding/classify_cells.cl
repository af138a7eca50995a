/*
 * winding/classify_cells.cl: in which cells crossings alone decide what is inside.
 *
 * A sample is inside if the crossings before it, by sign, exceed what the caps over the holes wind
 * around it (winding/caps.h) by more than a half.  Away from the holes that winding is small, and
 * changes slowly.  So most cells have a threshold: the least sum of signs that is inside, for all
 * of their samples.
 *
 * Host:       clvox/ops/winding.py, classify_cells()
 * Reference:  clvox/reference/winding.py, winding_numbers()
 * Tests:      tests/kernels/test_winding.py
 * Defines:    STEP_BITS  log2 of the lattice steps in one voxel
 *             MIXED      the threshold of cells that have none
 */
#include "common/index.h"
#include "winding/box.h"

/* One work-item classifies one cell.
 * voxels: shape of the grid; cells: of the grid of cells; side: voxels in one of them.
 * nodes to corners: winding/caps.h.
 * above: thresholds of larger cells, `factor` cells of this grid along each axis, of the shape
 * `blocks`; a factor of 0: there are none.
 * thresholds: int16 per cell, x fastest: the least sum of signs that is inside, or MIXED.
 * marks: a bit per cell, rows padded to words, added to: set for MIXED. */
__kernel void classify_cells(
    const ulong count, const int4 voxels, const int4 cells, const int4 side,
    const int4 blocks, const int factor, const int nodes, const float4 scale,
    const __global int *restrict places, const __global float *restrict moments,
    const __global int *restrict corners, const __global short *restrict above,
    __global short *restrict thresholds, __global uint *restrict marks)
{
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
    const int3 low = (int3)(x, y, z) * side.xyz;
    const int3 high = min(low + side.xyz, voxels.xyz) - 1;
    const short threshold = threshold_of(low, high, CAPS);
    thresholds[id] = threshold;
    if (threshold == MIXED) {
        const ulong row = (ulong)z * cells.y + y;
        atomic_or(marks + row * ((cells.x + 31) / 32) + x / 32, 1u << (x % 32));
    }
}
