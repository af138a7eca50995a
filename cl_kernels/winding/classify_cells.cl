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
 * Source:     the gradient of a solid angle is an integral along its rim, that of Biot and Savart.
 */
#include "common/index.h"
#include "winding/curtain.h"

#define MIXED (-32768)

/* More than the error of a winding summed in float32. */
#define MARGIN 1e-3f

/* Distance of a point from the segment (a, b), everything in units of length. */
static inline float distance_to(const float3 a, const float3 b, const float3 p)
{
    const float3 ab = b - a, ap = p - a;
    const float length = dot(ab, ab);
    const float at = length > 0.0f ? clamp(dot(ap, ab) / length, 0.0f, 1.0f) : 0.0f;
    const float3 off = ap - at * ab;
    return sqrt(dot(off, off));
}

static inline long turn_of(const int3 a, const int3 b, const int x, const int z)
{
    return (long)(b.x - a.x) * (z - a.z) - (long)(b.z - a.z) * (x - a.x);
}

/* May the curtain over the edge (a, b) pass through the box? */
static inline bool curtain_meets(const int3 a, const int3 b, const int3 low, const int3 high)
{
    if (high.y < min(a.y, b.y)) return false;
    if (max(a.x, b.x) < low.x || min(a.x, b.x) > high.x) return false;
    if (max(a.z, b.z) < low.z || min(a.z, b.z) > high.z) return false;
    const long p = turn_of(a, b, low.x, low.z), q = turn_of(a, b, high.x, low.z);
    const long r = turn_of(a, b, low.x, high.z), s = turn_of(a, b, high.x, high.z);
    return !((p > 0 && q > 0 && r > 0 && s > 0) || (p < 0 && q < 0 && r < 0 && s < 0));
}

/* One work-item classifies one cell.
 * voxels: shape of the grid; cells: of the grid of cells; side: voxels in one of them.
 * rim, scale: winding/curtain.h.
 * above: thresholds of larger cells, `factor` cells of this grid along each axis, of the shape
 * `blocks`; a factor of 0: there are none.
 * thresholds: int16 per cell, x fastest: the least sum of signs that is inside, or MIXED.
 * marks: a bit per cell, rows padded to words, added to: set for MIXED. */
__kernel void classify_cells(
    const ulong first, const ulong last, const int4 voxels, const int4 cells, const int4 side,
    const int4 blocks, const int factor, const uint edges, const float4 scale,
    const __global int *restrict rim, const __global short *restrict above,
    __global short *restrict thresholds, __global uint *restrict marks)
{
    #pragma OPENCL FP_CONTRACT OFF
    const ulong id = first + get_global_id(0);
    if (id >= last) return;
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
    const int3 centre = low + ((high - low) >> 1);
    const float3 unit = scale.xyz;
    const float3 half_size = (convert_float3(high - low) * 0.5f + 1.0f) * unit;
    const float radius = sqrt(dot(half_size, half_size));
    float change = 0.0f;
    bool mixed = false;
    for (uint edge = 0; edge < edges && !mixed; ++edge) {
        const int3 a = vload3(2 * (ulong)edge, rim);
        const int3 b = vload3(2 * (ulong)edge + 1, rim);
        const float3 p = convert_float3(a - centre) * unit;
        const float3 q = convert_float3(b - centre) * unit;
        const float gap = distance_to(p, q, (float3)(0.0f)) - radius;
        mixed = gap <= 0.0f || curtain_meets(a, b, low, high);
        const float3 along = q - p;
        change += sqrt(dot(along, along)) / (gap * gap);
    }
    short threshold = MIXED;
    if (!mixed) {
        change *= radius / (2.0f * TURN);
        const float winding = curtain_winding(rim, edges, centre, scale) + 0.5f;
        const float below = floor(winding);
        const float rest = winding - below;
        if (min(rest, 1.0f - rest) > change + MARGIN && fabs(below) < 32000.0f)
            threshold = (short)((int)below + 1);
    }
    thresholds[id] = threshold;
    if (threshold == MIXED) {
        const ulong row = (ulong)z * cells.y + y;
        atomic_or(marks + row * ((cells.x + 31) / 32) + x / 32, 1u << (x % 32));
    }
}
