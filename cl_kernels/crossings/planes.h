/*
 * crossings/planes.h: what a triangle is to the rays: which does it cover, and in which slot?
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
 * Defines:    EDGE_BITS  32 or 64, the width of the edge functions E
 */
#ifndef CLVOX_PLANES_H
#define CLVOX_PLANES_H

#if EDGE_BITS == 32
typedef int edge_t;
#else
typedef long edge_t;
#endif

#define ROUNDER 12582912.0f

/* What is the same for all rays of a triangle. */
typedef struct {
    Facet f;
    int2 bc, ca, ab;         /* its edges, seen along the rays */
    long rest_a, rest_b;
    int d0, d1, base_slot, base_rest;
    float slope_a, slope_b, base, doubt;
    long tie;
#if SINK == EMIT
    float digit_scale;
#endif
} Planes;

/* The edge functions E at a ray. */
typedef struct {
    edge_t a, b, c;
} Edges;

/* Those at the first ray of a box. */
static inline Edges make_planes(Planes *p, const Facet f, const int2 first)
{
    #pragma OPENCL FP_CONTRACT OFF
    const int2 at = first << STEP_BITS;
    p->f = f;
    p->ab = f.b.xy - f.a.xy;
    p->bc = f.c.xy - f.b.xy;
    p->ca = f.a.xy - f.c.xy;
    const long ta = edge_owns(p->bc) ? 0 : 1;
    const long tb = edge_owns(p->ca) ? 0 : 1;
    const long tc = edge_owns(p->ab) ? 0 : 1;
    const long wa = (long)p->bc.x * (at.y - f.b.y) - (long)p->bc.y * (at.x - f.b.x) - ta;
    const long wb = (long)p->ca.x * (at.y - f.c.y) - (long)p->ca.y * (at.x - f.c.x) - tb;
    const long wc = (long)p->ab.x * (at.y - f.a.y) - (long)p->ab.y * (at.x - f.a.x) - tc;
    p->rest_a = (wa & (STEP - 1)) + ta;
    p->rest_b = (wb & (STEP - 1)) + tb;
    p->d0 = f.a.z - f.c.z;
    p->d1 = f.b.z - f.c.z;
    p->base_slot = f.c.z >> STEP_BITS;
    p->base_rest = f.c.z & (STEP - 1);
    const float scale = 1.0f / ((float)f.area * (float)STEP);
    const float scale_0 = (float)p->d0 * scale;
    const float scale_1 = (float)p->d1 * scale;
    p->slope_a = scale_0 * (float)STEP;
    p->slope_b = scale_1 * (float)STEP;
    p->base = (float)p->base_rest / (float)STEP
            + (float)p->rest_a * scale_0 + (float)p->rest_b * scale_1;
    p->doubt
        = ((float)max(abs(p->d0), abs(p->d1)) / (float)STEP + 1.0f) * (1.0f / (float)(1 << 19));
    p->tie = tie_bit(f);
#if SINK == EMIT
    p->digit_scale = scale * (float)(1 << FRACTION_BITS);
#endif
    const Edges edges = {
        (edge_t)(wa >> STEP_BITS), (edge_t)(wb >> STEP_BITS), (edge_t)(wc >> STEP_BITS)};
    return edges;
}

static inline ulong residual_at(const Planes *p, const Edges e, const int m)
{
    return residual_of((long)e.a * STEP + p->rest_a, (long)e.b * STEP + p->rest_b, p->d0, p->d1,
                       p->f.area, p->base_rest - (long)m * STEP);
}

/* The edge functions i rows and j rays on. */
static inline Edges edges_at(const Planes *p, const Edges e, const edge_t i, const edge_t j)
{
    const Edges there = {e.a + j * p->bc.x - i * p->bc.y,
                         e.b + j * p->ca.x - i * p->ca.y,
                         e.c + j * p->ab.x - i * p->ab.y};
    return there;
}

#endif
