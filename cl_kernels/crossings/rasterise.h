/*
 * crossings/rasterise.h: every crossing of the rays in a box with one triangle.
 *
 * Edge functions are stepped in 32 bits, for triangles of few candidate rays, or in 64; the
 * answers are the same.  A sink is defined before (crossings/sinks.h): a type Sink and a function
 * cross(Sink *, int u, int v, int at), `at` being the slot, or for the sink EMIT the depth.
 *
 * A triangle of few candidate rays tries them all; of others the rays of each row that may be
 * covered are solved for, and where slots are asked for these are found LANES at a time.
 *
 * Whether a ray is covered, nobody foresees: crossings are found without a branch, and handed to
 * the sink some dozens at a time, by drain(): one by one, or all to cross_all(sink, count, us, vs,
 * slots) of a sink that defines GATHERS.
 *
 * The depth, rounded up, is the slot that the crossing had if centres were 2^-FRACTION_BITS voxels
 * apart: the residual gives one digit more, of 18 bits and so within 1/8 of the truth in float32,
 * and what is left then is again at most area * STEP.
 *
 * Defines:    EDGE_BITS  32 or 64
 *             WIDE       1 if triangles may have many candidate rays, although EDGE_BITS is 32
 */
#include "common/spans.h"
#include "crossings/planes.h"

#if EDGE_BITS == 32
typedef uint8 lanes_t;
#define LANES_OF(places) as_uint8(places)
#define FLOATS_OF(lanes) convert_float8(as_int8(lanes))
#else
typedef ulong8 lanes_t;
#define LANES_OF(places) convert_ulong8(places)
#define FLOATS_OF(lanes) convert_float8(as_long8(lanes))
#endif

#define LANES 8

/* Of so few candidate rays each is tried, and of fewer than SHORT_SPAN in a span; of more, those
 * that are covered are solved for. */
#define MOST_TRIED 32
#define SHORT_SPAN 3

#define MOST_FOUND 32

/* Crossings that the sink has not been given yet, less than MOST_FOUND. */
typedef struct {
    uint count;
    int u[MOST_FOUND], v[MOST_FOUND], slot[MOST_FOUND];
} Found;

#ifndef GATHERS
static inline void cross_all(
    Sink *sink, const uint count, const int *u, const int *v, const int *slot)
{
    for (uint i = 0; i < count; ++i) cross(sink, u[i], v[i], slot[i]);
}
#endif

static inline void drain(Found *found, Sink *sink)
{
    cross_all(sink, found->count, found->u, found->v, found->slot);
    found->count = 0;
}

/* The rays u, first to last: e are the edge functions at the first. */
static inline void scan_row(
    Sink *sink, Found *found, const Planes *p, Edges e, const int u, const int first,
    const int last)
{
    #pragma OPENCL FP_CONTRACT OFF
    for (int v = first; v <= last; ++v) {
        const bool covered = (e.a | e.b | e.c) >= 0;
        const float estimate = (float)e.a * p->slope_a + (float)e.b * p->slope_b + p->base;
        /* Rounded to the nearest integer by its place in the significand: exact for
         * |estimate| < 2^22, and quicker than rint() on some devices. */
        const float shifted = estimate + ROUNDER;
        const int m = as_int(shifted) - as_int(ROUNDER);
#if SINK == EMIT
        if (covered) {
            const ulong residual = residual_at(p, e, m);
            const int digit = (int)rint((float)(long)residual * p->digit_scale);
            const long left = (long)((residual << FRACTION_BITS)
                                     - (ulong)(long)digit * ((ulong)p->f.area << STEP_BITS));
            const uint whole = (uint)(p->base_slot + m) << FRACTION_BITS;
            cross(sink, u, v, (int)(whole + (uint)digit + (left > -p->tie)));
        }
#else
        const float beyond = estimate - (shifted - ROUNDER);
        bool after = beyond > 0.0f;
        if (covered & (fabs(beyond) <= p->doubt))
            after = (long)residual_at(p, e, m) > -p->tie;
        found->u[found->count] = u;
        found->v[found->count] = v;
        /* Unsigned: m says nothing where the ray is not covered. */
        found->slot[found->count] = (int)((uint)p->base_slot + (uint)m + after);
        found->count += covered;
        if (found->count == MOST_FOUND) drain(found, sink);
#endif
        e.a += p->bc.x;
        e.b += p->ca.x;
        e.c += p->ab.x;
    }
}

#if EDGE_BITS == 64 || WIDE

/* Who counts needs no slots, and depths are found one by one. */
#define SOLVES (SINK != COUNT && SINK != EMIT)

#if SOLVES

/* The same of rays that are all covered, LANES at a time. */
static inline void solve_run(
    Sink *sink, Found *found, const Planes *p, const Edges e, const int u, const int first,
    const int last)
{
    #pragma OPENCL FP_CONTRACT OFF
    const int8 place = (int8)(0, 1, 2, 3, 4, 5, 6, 7);
    /* Unsigned: what the lanes behind the last ray hold says nothing. */
    lanes_t a = (lanes_t)(e.a) + LANES_OF(place) * (lanes_t)(p->bc.x);
    lanes_t b = (lanes_t)(e.b) + LANES_OF(place) * (lanes_t)(p->ca.x);
    for (int v = first; v <= last; v += LANES) {
        const int count = min(last - v + 1, LANES);
        const float8 estimate = FLOATS_OF(a) * p->slope_a + FLOATS_OF(b) * p->slope_b + p->base;
        const float8 shifted = estimate + ROUNDER;
        const float8 beyond = estimate - (shifted - ROUNDER);
        if (any(fabs(beyond) <= p->doubt)) {
            scan_row(sink, found, p, edges_at(p, e, 0, v - first), u, v, v + count - 1);
        } else {
            if (found->count >= MOST_FOUND - LANES) drain(found, sink);
            const uint at = found->count;
            vstore8((int8)(u), 0, found->u + at);
            vstore8((int8)(v) + place, 0, found->v + at);
            /* Whether it is positive is -1 in a vector. */
            const uint8 slots = (uint8)(p->base_slot - as_int(ROUNDER)) + as_uint8(shifted)
                              - as_uint8(beyond > 0.0f);
            vstore8(as_int8(slots), 0, found->slot + at);
            found->count = at + count;
        }
        a += (lanes_t)(LANES) * (lanes_t)(p->bc.x);
        b += (lanes_t)(LANES) * (lanes_t)(p->ca.x);
    }
}

static inline bool covers(const Edges e)
{
    return (e.a | e.b | e.c) >= 0;
}

#endif

/* In rows from box.x + start on, a block of them, only the rays that may be covered are. */
static inline void solve_rows(
    Sink *sink, Found *found, const Planes *p, const Edges origin, const int4 box, const int start)
{
    Spans spans;
    int list[ROWS];
    const int width = box.w - box.y;
    const Edges row = edges_at(p, origin, start, 0);
    spans_of(&spans, bounds_of(row.a, p->bc.x, -p->bc.y, width),
             bounds_of(row.b, p->ca.x, -p->ca.y, width),
             bounds_of(row.c, p->ab.x, -p->ab.y, width), width);
    const int count = list_rows(&spans, box.z - box.x - start + 1, list);
    for (int n = 0; n < count; ++n) {
        const int i = list[n];
        int first = spans.first[i], last = spans.last[i];
#if SOLVES
        if (last - first + 1 >= SHORT_SPAN) {
            /* Spans are rarely too wide, and those between two covered rays are covered. */
            while (first <= last && !covers(edges_at(p, row, i, first))) ++first;
            while (first < last && !covers(edges_at(p, row, i, last))) --last;
            solve_run(sink, found, p, edges_at(p, row, i, first), box.x + start + i,
                      box.y + first, box.y + last);
            continue;
        }
#endif
        scan_row(sink, found, p, edges_at(p, row, i, first), box.x + start + i, box.y + first,
                 box.y + last);
    }
}

#endif

/* Finds every crossing of the rays in `box` with triangle f; some may be left to drain(). */
static inline void rasterise(Sink *sink, Found *found, const Facet f, const int4 box)
{
    Planes p;
    Edges row = make_planes(&p, f, box.xy);
#if EDGE_BITS == 64 || WIDE
    if (EDGE_BITS == 64 || (box.z - box.x + 1) * (box.w - box.y + 1) > MOST_TRIED) {
        for (int start = 0; start <= box.z - box.x; start += ROWS)
            solve_rows(sink, found, &p, row, box, start);
        return;
    }
#endif
#if EDGE_BITS == 32
    for (int u = box.x; u <= box.z; ++u) {
        scan_row(sink, found, &p, row, u, box.y, box.w);
        row.a -= p.bc.y;
        row.b -= p.ca.y;
        row.c -= p.ab.y;
    }
#endif
}
