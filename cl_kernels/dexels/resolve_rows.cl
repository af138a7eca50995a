/*
 * dexels/resolve_rows.cl: from the crossings of each ray to the pieces of it that are inside.
 *
 * A ray is walked along its sorted crossings with its winding number, or the number of crossings
 * for parity.  Crossings of one depth act together, so that solids which touch merge and pieces of
 * no length vanish, whatever the numbering of triangles.  Crossings beyond the grid's box act at
 * its face.
 *
 * Host:       clvox/ops/dexels.py, resolve()
 * Reference:  clvox/reference/dexels.py, resolve()
 * Tests:      tests/kernels/test_dexels.py
 * Defines:    RULE  0: PARITY, 1: NONZERO, 2: POSITIVE
 *             PASS  0: COUNT, 1: WRITE (dexels/ends.h)
 */
#include "dexels/ends.h"

#define PARITY 0
#define NONZERO 1
#define POSITIVE 2
#define NOTHING 0xffffffffu

static inline bool is_inside(const int winding)
{
#if RULE == PARITY
    return winding & 1;
#elif RULE == NONZERO
    return winding != 0;
#else
    return winding > 0;
#endif
}

static inline int step_of(const uint side)
{
#if RULE == PARITY
    return 1;
#else
    return side & 1 ? 1 : -1;
#endif
}

/* The triangle that an end keeps: one crossed its way, or the other way, or none at all. */
static inline uint kept_triangle(const uint wanted, const uint other)
{
    if (wanted != NOTHING) return wanted >> 1;
    return other != NOTHING ? other >> 1 : CAP;
}

/* One work-item resolves one ray.
 * low, high: depths of the box's faces.  offsets: (rays + 1,) uint64.
 * depths, sides: crossings, sorted by depth and then by triangle. */
__kernel void resolve_rows(
    const ulong first, const ulong last, const int low, const int high,
    const __global ulong *restrict offsets, const __global int *restrict depths,
    const __global uint *restrict sides, ENDS_PARAMETERS)
{
    const ulong ray = first + get_global_id(0);
    if (ray >= last) return;
    const ulong stop = offsets[ray + 1];
    Ends ends = MAKE_ENDS(ray);
    int winding = 0;
    bool inside = false;
    for (ulong at = offsets[ray]; at < stop;) {
        const int depth = clamp(depths[at], low, high);
        uint entered = NOTHING;
        uint left = NOTHING;
        for (; at < stop && clamp(depths[at], low, high) == depth; ++at) {
            const uint side = sides[at];
            winding += step_of(side);
            /* A crossing at the upper face may have been rounded up to a unit beyond it. */
            if (depths[at] < low || depths[at] > high + 1) continue;
            if (side & 1) entered = min(entered, side);
            else left = min(left, side);
        }
        const bool now = is_inside(winding) && depth < high;
        if (now && !inside) put_end(&ends, depth, kept_triangle(entered, left), true);
        if (inside && !now) put_end(&ends, depth, kept_triangle(left, entered), false);
        inside = now;
    }
    if (inside) put_end(&ends, high, CAP, false);
    FINISH_ENDS(ends, ray);
}
