/*
 * dexels/combine_rows.cl: union, intersection and differences of solids on one set of rays.
 *
 * Both rows of a ray are walked side by side.  Where both have an end at one depth it acts at
 * once, so that solids which touch merge and what cancels leaves nothing.
 *
 * Host:       clvox/ops/dexels.py, combine(), complement()
 * Reference:  clvox/reference/dexels.py, combine(), complement()
 * Tests:      tests/kernels/test_dexels.py
 * Defines:    OP    0: UNION, 1: INTERSECTION, 2: DIFFERENCE, 3: XOR
 *             PASS  0: COUNT, 1: WRITE (dexels/ends.h)
 */
#include "common/entries.h"
#include "dexels/ends.h"

#define UNION 0
#define INTERSECTION 1
#define DIFFERENCE 2
#define XOR 3

static inline bool decide(const bool in_a, const bool in_b)
{
#if OP == UNION
    return in_a || in_b;
#elif OP == INTERSECTION
    return in_a && in_b;
#elif OP == DIFFERENCE
    return in_a && !in_b;
#else
    return in_a != in_b;
#endif
}

/* A triangle of the second operand, in the numbering of the result.
 * starts: (meshes,) uint64, its first triangle of each mesh; moved: (meshes,) int32, by how much
 * the number of those grows. */
static inline uint renumbered(
    const uint triangle, const uint meshes, const __global ulong *starts, const __global int *moved)
{
    if (triangle == CAP || meshes == 0) return triangle;
    return triangle + (uint)moved[entry_of(starts, meshes, triangle)];
}

/* One work-item combines one ray of both.
 * offsets_*: (rays + 1,) uint64; depths_*, sides_*: ends, resolved. */
__kernel void combine_rows(
    const ulong first, const ulong last, const uint meshes,
    const __global ulong *restrict mesh_starts, const __global int *restrict moved,
    const __global ulong *restrict offsets_a, const __global int *restrict depths_a,
    const __global uint *restrict sides_a,
    const __global ulong *restrict offsets_b, const __global int *restrict depths_b,
    const __global uint *restrict sides_b, ENDS_PARAMETERS)
{
    const ulong ray = first + get_global_id(0);
    if (ray >= last) return;
    ulong a = offsets_a[ray];
    ulong b = offsets_b[ray];
    const ulong stop_a = offsets_a[ray + 1];
    const ulong stop_b = offsets_b[ray + 1];
    Ends ends = MAKE_ENDS(ray);
    bool in_a = false;
    bool in_b = false;
    while (a < stop_a || b < stop_b) {
        const int next_a = a < stop_a ? depths_a[a] : INT_MAX;
        const int next_b = b < stop_b ? depths_b[b] : INT_MAX;
        const int depth = min(next_a, next_b);
        const bool before = decide(in_a, in_b);
        uint triangle = CAP;
        if (next_b == depth) {
            in_b = !in_b;
            triangle = renumbered(sides_b[b] >> 1, meshes, mesh_starts, moved);
            ++b;
        }
        if (next_a == depth) {
            in_a = !in_a;
            if (sides_a[a] >> 1 != CAP) triangle = sides_a[a] >> 1;
            ++a;
        }
        const bool now = decide(in_a, in_b);
        if (now != before) put_end(&ends, depth, triangle, now);
    }
    FINISH_ENDS(ends, ray);
}

/* One work-item takes one ray from the box.
 * low, high: depths of the box's faces. */
__kernel void complement_rows(
    const ulong first, const ulong last, const int low, const int high,
    const __global ulong *restrict offsets, const __global int *restrict depths,
    const __global uint *restrict sides, ENDS_PARAMETERS)
{
    const ulong ray = first + get_global_id(0);
    if (ray >= last) return;
    const ulong start = offsets[ray];
    const ulong stop = offsets[ray + 1];
    Ends ends = MAKE_ENDS(ray);
    if (start == stop || depths[start] > low) put_end(&ends, low, CAP, true);
    for (ulong at = start; at < stop; ++at) {
        if (depths[at] > low && depths[at] < high)
            put_end(&ends, depths[at], sides[at] >> 1, (at - start) & 1);
    }
    if (start == stop || depths[stop - 1] < high) put_end(&ends, high, CAP, false);
    FINISH_ENDS(ends, ray);
}
