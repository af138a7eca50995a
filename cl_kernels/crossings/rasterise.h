/*
 * crossings/rasterise.h: every crossing of the rays in a box with one triangle.
 *
 * Edge functions are stepped in 32 bits, for triangles of few candidate rays, or in 64; the
 * answers are the same.  A sink is defined before (crossings/sinks.h): a type Sink and a function
 * cross(Sink *, int u, int v, int at), `at` being the slot, or for the sink EMIT the depth.
 *
 * Whether a ray is covered, nobody foresees: crossings are found without a branch, and handed to
 * the sink some dozens at a time, by drain().
 *
 * Rays are STEP apart, so an edge function W changes by whole multiples of STEP from ray to ray:
 * E = (W - t) >> STEP_BITS is stepped, with t = 0 if the edge owns its rays and 1 if not, and
 * W = (E << STEP_BITS) + rest for a `rest` that is constant along the edge.  W - t >= 0 is E >= 0.
 *
 * The slot is the number of moved centres before the crossing.  On a covered ray the weights are
 * not negative and sum to the area, so the float estimate of the depth is within 14 * 2^-24 *
 * (Z + 1) voxels of the truth, Z being the triangle's extent in depth; `doubt` is larger than
 * that.  Where it leaves the side of the nearest centre open, the sign of the exact residual
 * decides: |residual| <= area * STEP <= 2^62, so arithmetic modulo 2^64 keeps its sign.
 *
 * The depth, rounded up, is the slot that the crossing had if centres were 2^-FRACTION_BITS voxels
 * apart: the residual gives one digit more, of 18 bits and so within 1/8 of the truth in float32,
 * and what is left then is again at most area * STEP.
 *
 * Defines:    EDGE_BITS  32 or 64
 */
#include "common/spans.h"

#if EDGE_BITS == 32
typedef int edge_t;
#else
typedef long edge_t;
#endif

#define ROUNDER 12582912.0f

#define MOST_FOUND 32

/* Crossings that the sink has not been given yet. */
typedef struct {
    uint count;
    int u[MOST_FOUND], v[MOST_FOUND], slot[MOST_FOUND];
} Found;

static inline void drain(Found *found, Sink *sink)
{
    for (uint i = 0; i < found->count; ++i)
        cross(sink, found->u[i], found->v[i], found->slot[i]);
    found->count = 0;
}

/* Finds every crossing of the rays in `box` with triangle f; some may be left to drain(). */
static inline void rasterise(Sink *sink, Found *found, const Facet f, const int4 box)
{
    #pragma OPENCL FP_CONTRACT OFF
    const int2 ab = f.b.xy - f.a.xy;
    const int2 bc = f.c.xy - f.b.xy;
    const int2 ca = f.a.xy - f.c.xy;
    const int2 p = box.xy << STEP_BITS;
    const long ta = edge_owns(bc) ? 0 : 1;
    const long tb = edge_owns(ca) ? 0 : 1;
    const long tc = edge_owns(ab) ? 0 : 1;
    const long wa = (long)bc.x * (p.y - f.b.y) - (long)bc.y * (p.x - f.b.x) - ta;
    const long wb = (long)ca.x * (p.y - f.c.y) - (long)ca.y * (p.x - f.c.x) - tb;
    const long wc = (long)ab.x * (p.y - f.a.y) - (long)ab.y * (p.x - f.a.x) - tc;
    edge_t row_a = (edge_t)(wa >> STEP_BITS);
    edge_t row_b = (edge_t)(wb >> STEP_BITS);
    edge_t row_c = (edge_t)(wc >> STEP_BITS);

    const long rest_a = (wa & (STEP - 1)) + ta;
    const long rest_b = (wb & (STEP - 1)) + tb;
    const int d0 = f.a.z - f.c.z;
    const int d1 = f.b.z - f.c.z;
    const int base_slot = f.c.z >> STEP_BITS;
    const int base_rest = f.c.z & (STEP - 1);
    const float scale = 1.0f / ((float)f.area * (float)STEP);
    const float scale_0 = (float)d0 * scale;
    const float scale_1 = (float)d1 * scale;
    const float slope_a = scale_0 * (float)STEP;
    const float slope_b = scale_1 * (float)STEP;
    const float base = (float)base_rest / (float)STEP
                     + (float)rest_a * scale_0 + (float)rest_b * scale_1;
    const float doubt
        = ((float)max(abs(d0), abs(d1)) / (float)STEP + 1.0f) * (1.0f / (float)(1 << 19));
    const long tie = tie_bit(f);
#if SINK == EMIT
    const float digit_scale = scale * (float)(1 << FRACTION_BITS);
#endif

    const int width = box.w - box.y;
#if EDGE_BITS == 64
    const bool wide = width >= WIDE;
    const float inverse_a = inverse_of(bc.x);
    const float inverse_b = inverse_of(ca.x);
    const float inverse_c = inverse_of(ab.x);
#endif
    for (int u = box.x; u <= box.z; ++u) {
        Span span = {0, width};
#if EDGE_BITS == 64
        if (wide) {
            narrow(&span, row_a, bc.x, inverse_a);
            narrow(&span, row_b, ca.x, inverse_b);
            narrow(&span, row_c, ab.x, inverse_c);
        }
#endif
        edge_t ea = row_a + (edge_t)span.first * bc.x;
        edge_t eb = row_b + (edge_t)span.first * ca.x;
        edge_t ec = row_c + (edge_t)span.first * ab.x;
        const int last = box.y + span.last;
        for (int v = box.y + span.first; v <= last; ++v) {
            const bool covered = (ea | eb | ec) >= 0;
            const float estimate = (float)ea * slope_a + (float)eb * slope_b + base;
            /* Rounded to the nearest integer by its place in the significand: exact for
             * |estimate| < 2^22, and quicker than rint() on some devices. */
            const float shifted = estimate + ROUNDER;
            const int m = as_int(shifted) - as_int(ROUNDER);
#if SINK == EMIT
            if (covered) {
                const ulong residual = residual_of(
                    (long)ea * STEP + rest_a, (long)eb * STEP + rest_b, d0, d1, f.area,
                    base_rest - (long)m * STEP);
                const int digit = (int)rint((float)(long)residual * digit_scale);
                const long left = (long)((residual << FRACTION_BITS)
                                         - (ulong)(long)digit * ((ulong)f.area << STEP_BITS));
                const uint whole = (uint)(base_slot + m) << FRACTION_BITS;
                cross(sink, u, v, (int)(whole + (uint)digit + (left > -tie)));
            }
#else
            const float beyond = estimate - (shifted - ROUNDER);
            bool after = beyond > 0.0f;
            if (covered & (fabs(beyond) <= doubt)) {
                const ulong residual = residual_of(
                    (long)ea * STEP + rest_a, (long)eb * STEP + rest_b, d0, d1, f.area,
                    base_rest - (long)m * STEP);
                after = (long)residual > -tie;
            }
            found->u[found->count] = u;
            found->v[found->count] = v;
            /* Unsigned: m says nothing where the ray is not covered. */
            found->slot[found->count] = (int)((uint)base_slot + (uint)m + after);
            found->count += covered;
            if (found->count == MOST_FOUND) drain(found, sink);
#endif
            ea += bc.x;
            eb += ca.x;
            ec += ab.x;
        }
        row_a -= bc.y;
        row_b -= ca.y;
        row_c -= ab.y;
    }
}
