/*
 * winding/caps.h: how often the caps over the holes of a mesh wind around a point, within bounds.
 *
 * The caps are triangles, and what they wind is the sum of their solid angles.  They hang in a
 * binary tree, laid out in preorder, in which what is far is seen as one dipole.  With N the sum of
 * the vector areas of a node, A that of its areas, rho the radius of a ball about its centre c that
 * holds it, and F(r) = r / |r|^3, whose derivative is at most 2 / |r|^3,
 *
 *     |sum over its triangles of (1 / 4 pi) F(x - q) dS  -  N . F(c - p) / 4 pi|
 *         <= A (rho + R) / (2 pi (|c - p| - rho - R)^3)
 *
 * for every point q within R of p.  So one visit bounds what the caps wind around all samples of a
 * box; a single sample is a box with R = 0.  Every bound here holds for the rounded numbers, too:
 * each term brings a bound of its own rounding, and the sum one that grows with its terms.
 *
 * Source:     G. Barill, N. Dickson, R. Schmidt, D. Levin, A. Jacobson, "Fast winding numbers for
 *             soups and clouds", ACM TOG 37(4), 2018, for the tree and its dipoles; the bounds are
 *             our own; A. Van Oosterom, J. Strackee, "The solid angle of a plane triangle", IEEE
 *             Trans. Biomed. Eng. 30(2), 1983.
 */
#ifndef CLVOX_CAPS_H
#define CLVOX_CAPS_H

#include "common/exact_sign.h"
#include "winding/turn.h"

/* More than what is rounded when terms are added up, each of at most half a unit in the last
 * place; and what is rounded beside. */
#define UNIT 0x1p-23f
#define MARGIN 0x1p-16f

/* Relative errors of a distance, and of the sides of a spherical triangle: units in the last place
 * of conversions, products, square roots and quotients, and some to spare. */
#define SHORTER (1.0f - 0x1p-19f)
#define SIDES_ROUNDED 0x1p-17f
#define VOLUME_ROUNDED 0x1p-19f

/* The tree, as functions take it.
 * places: (nodes, 5) int32, the centre of a node on the lattice, the number of the node after all
 * that are below it, and its triangle, if it is a leaf, or -1.
 * moments: (nodes, 5) float32: N, A and rho, in units of scale.
 * corners: (triangles, 3, 3) int32, on the lattice.
 * scale: widths of a lattice step along x, y and z, in any unit. */
#define CAPS_PARAMETERS \
    const int nodes, const float4 scale, const __global int *places, \
    const __global float *moments, const __global int *corners
#define CAPS nodes, scale, places, moments, corners

/* Nodes that the surroundings of some samples hold, and how many times as far as they are wide all
 * others are. */
#define MOST_NEAR 64
#define AROUND_CARE 2.0f

/* What is wound, and how far off that may be; size: the sum of the terms without their signs;
 * terms: how many there are.  The error lacks that of adding them up until it is settled. */
typedef struct {
    float winding, error, size;
    int terms;
} Estimate;

static inline Estimate nothing_yet(void)
{
    Estimate sum;
    sum.winding = 0.0f;
    sum.error = MARGIN;
    sum.size = 0.0f;
    sum.terms = 1;
    return sum;
}

static inline Estimate settled(Estimate sum)
{
    sum.error += UNIT * (float)sum.terms * sum.size;
    return sum;
}

static inline long3 cross_exact(const int3 a, const int3 b)
{
    return (long3)((long)a.y * b.z - (long)a.z * b.y, (long)a.z * b.x - (long)a.x * b.z,
                   (long)a.x * b.y - (long)a.y * b.x);
}

/* On which side of a triangle a sample is: corners from its centre, and the infinitesimal move
 * (e, e^2, e^3) where that lies in the plane; 0 for a triangle without area.
 * Differences are below 2^25, so the volume is below 2^77, and in float32 off by less than 2^57. */
static inline int side_of_cap(const int3 a, const int3 b, const int3 c, const long3 normal)
{
    const long3 spread = cross_exact(b, c);
    const float3 one = convert_float3(a), other = convert_float3(spread);
    const ulong wrapped = (ulong)a.x * (ulong)spread.x + (ulong)a.y * (ulong)spread.y
                        + (ulong)a.z * (ulong)spread.z;
    const long volume
        = exact_sign(one.x * other.x + one.y * other.y + one.z * other.z, wrapped);
    if (volume != 0) return volume > 0 ? 1 : -1;
    const long tie = normal.x != 0 ? normal.x : normal.y != 0 ? normal.y : normal.z;
    return tie == 0 ? 0 : tie > 0 ? -1 : 1;
}

/* How far the segment from a to b stays from the origin, at least. */
static inline float gap_to_edge(const float3 a, const float3 b)
{
    const float3 along = b - a;
    const float length = dot(along, along);
    const float at = length > 0.0f ? clamp(-dot(a, along) / length, 0.0f, 1.0f) : 0.0f;
    const float3 off = a + at * along;
    /* Its parts are rounded like the longer of the two ends. */
    return sqrt(dot(off, off)) * SHORTER - 0x1p-20f * (fabs(a.x) + fabs(a.y) + fabs(a.z)
                                                     + fabs(b.x) + fabs(b.y) + fabs(b.z));
}

/* The gradient of a solid angle is an integral along the rim (Biot and Savart), of dl / r^2 at
 * most: for an edge that stays at least `gap` away, over 4 pi. */
static inline float steepness(const float3 a, const float3 b, const float gap)
{
    const float3 along = b - a;
    return min(sqrt(dot(along, along)) / gap, 0.5f * TURN) / (gap * (1.99f * TURN));
}

static inline float3 scaled_cross(const int3 a, const int3 b, const float4 scale)
{
    return convert_float3(cross_exact(a, b)) * scale.yzx * scale.zxy;
}

/* Does a ball about the origin, which none of its edges meets, meet a triangle?
 * height: how far its plane is away, at least; normal: of that plane. */
static inline bool ball_meets(
    const int3 a, const int3 b, const int3 c, const float3 normal, const float height,
    const float reach, const float4 scale)
{
    if (height > reach) return false;
    const float u = dot(normal, scaled_cross(a, b, scale));
    const float v = dot(normal, scaled_cross(b, c, scale));
    const float w = dot(normal, scaled_cross(c, a, scale));
    return (u >= 0.0f && v >= 0.0f && w >= 0.0f) || (u <= 0.0f && v <= 0.0f && w <= 0.0f);
}

/* Adds one triangle, seen from p and all samples within `reach`; returns how far off that may be,
 * infinitely if nothing is known. */
static inline float add_cap(
    Estimate *sum, const int3 p, const float reach, const int triangle, const float4 scale,
    const __global int *corners)
{
    #pragma OPENCL FP_CONTRACT OFF
    const int3 from_a = vload3(3 * (ulong)triangle, corners) - p;
    const int3 from_b = vload3(3 * (ulong)triangle + 1, corners) - p;
    const int3 from_c = vload3(3 * (ulong)triangle + 2, corners) - p;
    const int side = side_of_cap(
        from_a, from_b, from_c, cross_exact(from_b - from_a, from_c - from_a));
    const float3 normal = scaled_cross(from_b - from_a, from_c - from_a, scale);
    const float3 a = convert_float3(from_a) * scale.xyz;
    const float3 b = convert_float3(from_b) * scale.xyz;
    const float3 c = convert_float3(from_c) * scale.xyz;
    const float la = sqrt(dot(a, a)), lb = sqrt(dot(b, b)), lc = sqrt(dot(c, c));
    if (min(la, min(lb, lc)) == 0.0f) return INFINITY;
    float change = 0.0f;
    if (reach > 0.0f) {
        const float ab = gap_to_edge(a, b) - reach;
        const float bc = gap_to_edge(b, c) - reach;
        const float ca = gap_to_edge(c, a) - reach;
        if (!(min(ab, min(bc, ca)) > 0.0f)) return INFINITY;
        const float height = fabs(dot(a, normal)) / sqrt(dot(normal, normal)) * SHORTER
            - 0x1p-19f * (la + lb + lc);
        if (ball_meets(from_a, from_b, from_c, normal, height, reach, scale)) return INFINITY;
        change = reach * (steepness(a, b, ab) + steepness(b, c, bc) + steepness(c, a, ca));
    }
    const float3 na = a / la, nb = b / lb, nc = c / lc;
    const float below = 1.0f + dot(na, nb) + dot(nb, nc) + dot(nc, na);
    /* The volume between unit vectors, by the normal: it is near what it should be for a small
     * triangle far away, too. */
    const float volume = fabs(dot(na, normal / lb / lc));
    const float doubt = VOLUME_ROUNDED
        * (volume + sqrt(dot(b - a, b - a)) / lb * (sqrt(dot(c - a, c - a)) / lc));
    const float norm = volume * volume + below * below;
    const float least = doubt + SIDES_ROUNDED;
    if (!(2.0f * least * least < norm)) return INFINITY;
    const float term = atan2(volume, below) / TURN;
    sum->winding += side < 0 ? -term : term;
    sum->size += term;
    /* The sine of an angle between two arrows that are a little off, one from the other. */
    return change + (fabs(below) * doubt + (volume + doubt) * SIDES_ROUNDED) / norm;
}

/* Adds node `at` as a dipole, seen from p and all samples within `reach`, if it is `care` times as
 * far as it is wide; returns whether it is. */
static inline bool add_dipole(
    Estimate *sum, const int at, const int3 p, const float reach, const float care,
    CAPS_PARAMETERS)
{
    #pragma OPENCL FP_CONTRACT OFF
    const int3 to = (int3)(places[5 * at], places[5 * at + 1], places[5 * at + 2]) - p;
    const __global float *moment = moments + 5 * (ulong)at;
    const float3 off = convert_float3(to) * scale.xyz;
    const float distance = sqrt(dot(off, off));
    const float spread = moment[4] + reach;
    const float gap = distance * SHORTER - spread;
    if (!(gap > 0.0f && gap > care * spread)) return false;
    const float cube = 2.0f * TURN * gap * gap;
    const float term = dot((float3)(moment[0], moment[1], moment[2]), off / distance)
        / (2.0f * TURN * distance * distance);
    sum->error += moment[3] / cube * (2.001f * spread / gap + 0x1p-19f);
    sum->winding += term;
    sum->size += fabs(term);
    ++sum->terms;
    return true;
}

/* Adds the nodes from `at` to before `end`, seen from p and all samples within `reach`.  Where the
 * sum may be off by a half it gives up: of a part of the nodes nothing is known, however far from a
 * half the sum of these is.
 * care: how many times as far as it is wide a node must be, at least, to be seen as a dipole. */
static inline void add_nodes(
    Estimate *sum, int at, const int end, const int3 p, const float reach, const float care,
    CAPS_PARAMETERS)
{
    #pragma OPENCL FP_CONTRACT OFF
    while (at < end && sum->error < 0.5f) {
        const int after = places[5 * at + 3], triangle = places[5 * at + 4];
        if (add_dipole(sum, at, p, reach, care, CAPS)) {
            at = after;
        } else if (triangle < 0) {
            ++at;
        } else {
            sum->error += add_cap(sum, p, reach, triangle, scale, corners);
            ++sum->terms;
            at = after;
        }
    }
    if (at < end) sum->error = INFINITY;
}

/* What the caps wind around every sample within `reach` of p. */
static inline Estimate wind_caps(
    const int3 p, const float reach, const float care, CAPS_PARAMETERS)
{
    Estimate sum = nothing_yet();
    add_nodes(&sum, 0, nodes, p, reach, care, CAPS);
    return settled(sum);
}

/* What samples that are near each other share: the dipoles of what is far, added up, and the nodes
 * that each has to look at itself. */
typedef struct {
    Estimate far;
    int count;
    int near[MOST_NEAR];
} Surroundings;

/* The surroundings of all samples within `reach` of p; nothing is known if too many nodes are near,
 * or if dipoles were left out because those before may be off by a half. */
static inline void look_around(
    Surroundings *around, const int3 p, const float reach, CAPS_PARAMETERS)
{
    around->far = nothing_yet();
    around->count = 0;
    int at = 0;
    while (at < nodes && around->far.error < 0.5f) {
        const int after = places[5 * at + 3], triangle = places[5 * at + 4];
        if (add_dipole(&around->far, at, p, reach, AROUND_CARE, CAPS)) {
            at = after;
        } else if (triangle < 0 && moments[5 * at + 4] > 0.5f * reach) {
            ++at;
        } else if (around->count < MOST_NEAR) {
            around->near[around->count++] = at;
            at = after;
        } else {
            around->far.error = INFINITY;
        }
    }
    if (at < nodes) around->far.error = INFINITY;
}

/* What the caps wind around the sample at p, given its surroundings; nothing is known if any node
 * near it was given up. */
static inline Estimate wind_near(const Surroundings *around, const int3 p, CAPS_PARAMETERS)
{
    Estimate sum = around->far;
    for (int i = 0; i < around->count; ++i) {
        const int node = around->near[i];
        add_nodes(&sum, node, places[5 * node + 3], p, 0.0f, AROUND_CARE, CAPS);
    }
    return settled(sum);
}

#endif
