/*
 * boundary/overlap.h: does a closed triangle touch a closed cell?  Exactly, in integers.
 *
 * Separating axes, touching counts: the sides of the box, the triangle's plane, and the three
 * edges in each of the three projections along an axis.  In a projection it suffices that the cell
 * is not wholly on the outer side of an edge.  Triangles without area pass the same tests: their
 * edges then bound the segment from both sides, and the plane test holds of itself.
 *
 * Coordinates are on the lattice, permuted so that w is the axis along which the triangle's
 * columns of cells are walked: that of the largest component of the normal, so that the plane
 * rises by at most one step per step.  Differences of coordinates stay below 2^24, those between a
 * triangle and a cell that meets its box below 2^24 plus a cell's side of at most 2^20; edge
 * functions below 2^50, components of the normal within 2^48 each.
 *
 * Defines:    STEP_BITS               log2 of the lattice steps in one voxel
 *             CELL_X, CELL_Y, CELL_Z  sides of a cell, in voxels
 */
#ifndef CLVOX_OVERLAP_H
#define CLVOX_OVERLAP_H

#include "common/corners.h"
#include "common/exact_sign.h"
#include "common/spans.h"

#define HALF_STEP (1 << (STEP_BITS - 1))
#define CELL_SIDES ((int3)(CELL_X, CELL_Y, CELL_Z) << STEP_BITS)

/* More than the error, in steps, of a depth computed in float32 from the slopes. */
#define DEPTH_MARGIN 32.0f

/* An edge in a projection (p, q): the cell with lowest corner (p, q) is not wholly outside of it
 * iff offset + along_q * q - along_p * p >= 0. */
typedef struct {
    long offset;
    int along_q, along_p;
} Side;

/* A triangle, ready to be tested against cells; u, v, w as above. */
typedef struct {
    int axis;            /* w, as 0, 1, 2 for x, y, z */
    int3 cell;           /* a cell's sides along u, v, w, in steps */
    int3 a;              /* a corner of the triangle */
    int3 first, last;    /* the cells that its box touches, clipped to the grid */
    int extent;          /* of the triangle along u */
    long nu, nv, nw;     /* its normal, not a unit vector */
    float slope_u, slope_v;
    Side uv[3], vw[3], wu[3];
} Solid;

/* Coordinates (x, y, z) in the order (u, v, w), the cyclic one that ends with `axis`. */
static inline int3 permute(const int3 p, const int axis)
{
    return axis == 0 ? p.yzx : axis == 1 ? p.zxy : p;
}

/* The cell (x, y, z) whose coordinates in the order (u, v, w) are given. */
static inline int3 restore(const int3 p, const int axis)
{
    return axis == 0 ? p.zxy : axis == 1 ? p.yzx : p;
}

/* Whether cells are cubes, so that their side is a constant however axes are permuted. */
#define CUBES (CELL_X == CELL_Y && CELL_Y == CELL_Z)

static inline int floor_div(const int a, const int b)
{
    /* A constant power of two shifts; shifts of negative numbers floor, by definition. */
    if ((b & (b - 1)) == 0) return a >> popcount(b - 1);
    const int quotient = a / b;
    return quotient - (a - quotient * b < 0);
}

/* First and last cell that the closed interval [low, high] touches. */
static inline int first_touched(const int low, const int side)
{
    return floor_div(low + HALF_STEP - 1, side);
}

static inline int last_touched(const int high, const int side)
{
    return floor_div(high + HALF_STEP, side);
}

/* First and last cell along each axis (x, y, z) that the closed box touches. */
static inline int3 first_cell_of(const int3 low)
{
    const int3 side = CELL_SIDES;
    return (int3)(first_touched(low.x, side.x), first_touched(low.y, side.y),
                  first_touched(low.z, side.z));
}

static inline int3 last_cell_of(const int3 high)
{
    const int3 side = CELL_SIDES;
    return (int3)(last_touched(high.x, side.x), last_touched(high.y, side.y),
                  last_touched(high.z, side.z));
}

static inline Side make_side(
    const int2 from, const int2 to, const long turn, const int2 cell)
{
    const int dp = turn < 0 ? from.x - to.x : to.x - from.x;
    const int dq = turn < 0 ? from.y - to.y : to.y - from.y;
    Side side;
    side.along_q = dp;
    side.along_p = dq;
    side.offset = (long)dq * from.x - (long)dp * from.y
                + (long)max(dp, 0) * cell.y + (long)max(-dq, 0) * cell.x;
    return side;
}

static inline long side_of(const Side side, const int p, const int q)
{
    return side.offset + (long)side.along_q * q - (long)side.along_p * p;
}

/* Is the cell not wholly outside of any of three edges?  Without a branch, since nobody could
 * foresee it. */
static inline bool all_meet(const Side *sides, const int p, const int q)
{
    return (side_of(sides[0], p, q) | side_of(sides[1], p, q) | side_of(sides[2], p, q)) >= 0;
}

static inline long cross2(const int2 a, const int2 b, const int2 c)
{
    return (long)(b.x - a.x) * (c.y - a.y) - (long)(b.y - a.y) * (c.x - a.x);
}

/* The columns of cells (first u, first v, last u, last v) below the triangle, and all that their
 * tests need.  cells: shape of the grid of cells (x, y, z). */
static inline int4 make_solid(
    Solid *s, const __global int *faces, const __global int *vertices, const ulong triangle,
    const int3 cells)
{
    int3 a = load_corner(vertices, faces[3 * triangle]);
    int3 b = load_corner(vertices, faces[3 * triangle + 1]);
    int3 c = load_corner(vertices, faces[3 * triangle + 2]);
    const int3 low = min(min(a, b), c);
    const int3 high = max(max(a, b), c);
    const long nx = cross2(a.yz, b.yz, c.yz);
    const long ny = cross2(a.zx, b.zx, c.zx);
    const long nz = cross2(a.xy, b.xy, c.xy);
    const ulong ax = abs(nx), ay = abs(ny), az = abs(nz);
    const bool flat = (ax | ay | az) == 0;
    if (flat) {
        /* A segment: u is to be its longest axis, and w, the last in cyclic order, follows v. */
        const int3 size = high - low;
        const int longest = size.x >= size.y ? (size.x >= size.z ? 0 : 2)
                                             : (size.y >= size.z ? 1 : 2);
        s->axis = (longest + 2) % 3;
    } else {
        s->axis = ax >= ay ? (ax >= az ? 0 : 2) : (ay >= az ? 1 : 2);
    }
    s->cell = permute(CELL_SIDES, s->axis);
    s->first = permute(max(first_cell_of(low), (int3)(0)), s->axis);
    s->last = permute(min(last_cell_of(high), cells - 1), s->axis);
    s->extent = permute(high - low, s->axis).x;
    a = permute(a, s->axis);
    b = permute(b, s->axis);
    c = permute(c, s->axis);
    s->a = a;
    s->nu = cross2(a.yz, b.yz, c.yz);
    s->nv = cross2(a.zx, b.zx, c.zx);
    s->nw = cross2(a.xy, b.xy, c.xy);
    if (flat) {
        /* Along the longest axis the segment rises by at most one step per step. */
        const int3 end = b.x - a.x != 0 && abs(b.x - a.x) >= abs(c.x - a.x) ? b : c;
        s->slope_u = end.x == a.x ? 0.0f : (float)(end.z - a.z) / (float)(end.x - a.x);
        s->slope_v = 0.0f;
    } else {
        s->slope_u = -(float)s->nu / (float)s->nw;
        s->slope_v = -(float)s->nv / (float)s->nw;
    }
    s->uv[0] = make_side(a.xy, b.xy, s->nw, s->cell.xy);
    s->uv[1] = make_side(b.xy, c.xy, s->nw, s->cell.xy);
    s->uv[2] = make_side(c.xy, a.xy, s->nw, s->cell.xy);
    s->vw[0] = make_side(a.yz, b.yz, s->nu, s->cell.yz);
    s->vw[1] = make_side(b.yz, c.yz, s->nu, s->cell.yz);
    s->vw[2] = make_side(c.yz, a.yz, s->nu, s->cell.yz);
    s->wu[0] = make_side(a.zx, b.zx, s->nv, s->cell.zx);
    s->wu[1] = make_side(b.zx, c.zx, s->nv, s->cell.zx);
    s->wu[2] = make_side(c.zx, a.zx, s->nv, s->cell.zx);
    return (int4)(s->first.x, s->first.y, s->last.x, s->last.y);
}

/* Does the column of cells whose lowest corner is (u, v) meet the triangle's shadow? */
static inline bool column_meets(const Solid *s, const int u, const int v)
{
    return all_meet(s->uv, u, v);
}

/* The cells (first, last) of that column between which the triangle's plane passes; more rather
 * than less. */
static inline int2 depths_in_column(const Solid *s, const int u, const int v)
{
    const float half_u = 0.5f * (float)s->cell.x;
    const float half_v = 0.5f * (float)s->cell.y;
    const float middle = (float)s->a.z + s->slope_u * ((float)(u - s->a.x) + half_u)
                                       + s->slope_v * ((float)(v - s->a.y) + half_v);
    const float reach = fabs(s->slope_u) * half_u + fabs(s->slope_v) * half_v + DEPTH_MARGIN;
    const int side = CUBES ? CELL_X << STEP_BITS : s->cell.z;
    return (int2)(max(s->first.z, first_touched((int)floor(middle - reach), side)),
                  min(s->last.z, last_touched((int)ceil(middle + reach), side)));
}

/* Do the remaining tests hold for the cell with lowest corner (u, v, w)? */
static inline bool cell_meets(const Solid *s, const int u, const int v, const int w)
{
    if (!(all_meet(s->vw, v, w) & all_meet(s->wu, w, u))) return false;
    /* The plane at the box's furthest and nearest corner: up to 2^74, so by exact_sign. */
    const int du = u - s->a.x, dv = v - s->a.y, dw = w - s->a.z;
    const int high_u = s->nu > 0 ? du + s->cell.x : du, low_u = s->nu > 0 ? du : du + s->cell.x;
    const int high_v = s->nv > 0 ? dv + s->cell.y : dv, low_v = s->nv > 0 ? dv : dv + s->cell.y;
    const int high_w = s->nw > 0 ? dw + s->cell.z : dw, low_w = s->nw > 0 ? dw : dw + s->cell.z;
    const float nu = (float)s->nu, nv = (float)s->nv, nw = (float)s->nw;
    const long above = exact_sign(
        nu * (float)high_u + nv * (float)high_v + nw * (float)high_w,
        (ulong)s->nu * (ulong)(long)high_u + (ulong)s->nv * (ulong)(long)high_v
            + (ulong)s->nw * (ulong)(long)high_w);
    const long below = exact_sign(
        nu * (float)low_u + nv * (float)low_v + nw * (float)low_w,
        (ulong)s->nu * (ulong)(long)low_u + (ulong)s->nv * (ulong)(long)low_v
            + (ulong)s->nw * (ulong)(long)low_w);
    return above >= 0 && below <= 0;
}

#endif
