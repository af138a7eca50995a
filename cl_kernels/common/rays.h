/*
 * common/rays.h: a triangle seen along the rays, and the rays that may meet it.
 *
 * Everything is on the lattice: a voxel is STEP steps wide and the centre of voxel k lies at
 * k * STEP.  u, v are the axes across the rays and w the one along them, in the cyclic order
 * (u, v, w) = (y, z, x), (z, x, y), (x, y, z) for rays along x, y, z.  A triangle spans at most
 * 2^24 steps along each axis, hence an edge function at a ray within its box at most 2^48: exact
 * in a long.
 *
 * Defines:    AXIS       axis of the rays: 0, 1 or 2
 *             STEP_BITS  log2 of the lattice steps in one voxel, 7 to 14
 */
#ifndef CLVOX_RAYS_H
#define CLVOX_RAYS_H

#include "common/corners.h"

#define STEP (1 << STEP_BITS)

/* Three corners (u, v, w), counter-clockwise in (u, v): twice the area `area` is positive, or zero
 * for a triangle that the rays cannot cross.  `flipped`: two corners had to change places. */
typedef struct {
    int3 a, b, c;
    long area;
    bool flipped;
} Facet;

static inline int3 load_along(const __global int *vertices, const int number)
{
    const int3 at = load_corner(vertices, number);
    return AXIS == 0 ? at.yzx : AXIS == 1 ? at.zxy : at;
}

static inline Facet load_facet(
    const __global int *faces, const __global int *vertices, ulong triangle)
{
    Facet f;
    f.a = load_along(vertices, faces[3 * triangle]);
    f.b = load_along(vertices, faces[3 * triangle + 1]);
    f.c = load_along(vertices, faces[3 * triangle + 2]);
    f.area = (long)(f.b.x - f.a.x) * (f.c.y - f.a.y) - (long)(f.b.y - f.a.y) * (f.c.x - f.a.x);
    f.flipped = f.area < 0;
    if (f.flipped) {
        const int3 swap = f.b;
        f.b = f.c;
        f.c = swap;
        f.area = -f.area;
    }
    return f;
}

/* A window without bounds. */
#define ALL_RAYS ((int4)(INT_MIN, INT_MIN, INT_MAX, INT_MAX))

/* The rays (first u, first v, last u, last v) that may meet the triangle, of those in `window`,
 * which is such a box too; a last before its first means none. */
static inline int4 ray_box(const Facet f, const int4 window)
{
    const int2 low = min(min(f.a.xy, f.b.xy), f.c.xy);
    const int2 high = max(max(f.a.xy, f.b.xy), f.c.xy);
    /* Shifts of negative numbers floor, in OpenCL C by definition. */
    const int2 first = max((low + (STEP - 1)) >> STEP_BITS, window.xy);
    const int2 last = min(high >> STEP_BITS, window.zw);
    return (int4)(first.x, first.y, last.x, last.y);
}

static inline bool box_is_empty(const int4 box)
{
    return box.z < box.x || box.w < box.y;
}

/* Does the edge (du, dv), its triangle to the left, own a ray that runs through it?  Every centre
 * stands for itself moved by (e, e^2, e^3) in (x, y, z), e -> 0+ (docs/algorithms): the edge
 * function du * pv - dv * pu grows when the centre moves. */
static inline bool edge_owns(const int2 d)
{
#if AXIS == 1
    return d.x > 0 || (d.x == 0 && d.y < 0);
#else
    return d.y < 0 || (d.y == 0 && d.x > 0);
#endif
}

/* 1 if a centre exactly on the triangle's plane lies, once moved, behind it, so that the plane
 * comes after the centre: the sign of the plane's slope against the infinitesimal. */
static inline int tie_bit(const Facet f)
{
    const long d0 = f.a.z - f.c.z;
    const long d1 = f.b.z - f.c.z;
#if AXIS == 0
    return 0;
#else
    /* Slope of the depth along u and v, times the area: below 2^50. */
    const long along_v = (f.c.x - f.b.x) * d0 + (f.a.x - f.c.x) * d1;
#if AXIS == 1
    return along_v > 0;
#else
    const long along_u = -((f.c.y - f.b.y) * d0 + (f.a.y - f.c.y) * d1);
    return along_u > 0 || (along_u == 0 && along_v > 0);
#endif
#endif
}

/* By how much a crossing lies behind a centre, times area * STEP, modulo 2^64: from the weights of
 * corners a and b, what those corners lie behind c, and what c lies behind the centre. */
static inline ulong residual_of(
    const long weight_a, const long weight_b, const int d0, const int d1, const long area,
    const long behind)
{
    return (ulong)weight_a * (ulong)(long)d0 + (ulong)weight_b * (ulong)(long)d1
         + (ulong)area * (ulong)behind;
}

#endif
