/*
 * fill/flip_rule.cl: flipped bits where the winding number begins or ceases to mean "inside".
 *
 * Each ray is walked along its sorted crossings with its winding number, the sum of their signs.
 * Crossings of one slot act together: no sample lies between them, so that solids which touch or
 * overlap there merge, whatever their numbering.  What is flipped is what parity would flip for a
 * mesh without inner walls, into the same sinks.
 *
 * Host:       clvox/ops/fill.py
 * Reference:  clvox/reference/fill.py
 * Tests:      tests/kernels/test_fill.py
 * Defines:    RULE  0: NONZERO, 1: POSITIVE
 *             FRACTION_BITS  of the depths
 *             SINK  1: DENSE, 2: BRICKS (crossings/sinks.h)
 *             LEVELS, BRICK_*, MIDDLE_*  of the model, for the sink BRICKS (common/bricks.h)
 */
#include "common/index.h"
#include "crossings/sinks.h"

#define NONZERO 0
#define POSITIVE 1

static inline bool is_inside(const int winding)
{
#if RULE == NONZERO
    return winding != 0;
#else
    return winding > 0;
#endif
}

/* The slot of a crossing: its depth, rounded up to whole voxels. */
static inline int slot_of(const long crossing)
{
    return (int)(((crossing >> 32) + ((1 << FRACTION_BITS) - 1)) >> FRACTION_BITS);
}

/* One work-item walks one ray along y; (u, v) is (z, x).
 * window: the rays listed.  offsets: (rays + 1,) uint64.  rows: sorted crossings. */
__kernel void flip_rule(
    const int4 window, const __global ulong *restrict offsets, const __global long *restrict rows,
    SINK_PARAMETERS)
{
    const ulong ray = get_global_id(0);
    const int width = window.w - window.y + 1;
    if (ray >= (ulong)(window.z - window.x + 1) * width) return;
    ulong number = ray;
    const int v = window.y + take_place(&number, width);
    const int u = window.x + (int)number;
    const ulong stop = offsets[ray + 1];
    Sink sink = MAKE_SINK(window);
    int winding = 0;
    for (ulong at = offsets[ray]; at < stop;) {
        const int slot = slot_of(rows[at]);
        const bool before = is_inside(winding);
        for (; at < stop && slot_of(rows[at]) == slot; ++at) winding += rows[at] & 1 ? 1 : -1;
        if (is_inside(winding) != before) cross(&sink, u, v, slot);
    }
}
