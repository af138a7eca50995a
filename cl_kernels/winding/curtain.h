/*
 * winding/curtain.h: how often a curtain on the rim of an open mesh winds around a point.
 *
 * The curtain runs from each edge of the rim along +y without end; with it the mesh is closed.  The
 * part over one edge (a, b) is a triangle with a corner at infinity in the direction d = +y, and
 * half its solid angle, seen from p, has the tangent (Van Oosterom and Strackee, 1983)
 *
 *     det(a, b, d) / (|a| |b| + a.b + a.y |b| + b.y |a|)
 *   = (a.z b.x - a.x b.z) / ((|a| + a.y) (|b| + b.y) + a.x b.x + a.z b.z),
 *
 * a and b from p.  The second form has no cancellation high above an edge, if |a| + a.y is taken as
 * (a.x^2 + a.z^2) / (|a| - a.y) there.  Its sign, which tells the sides of the curtain apart, is
 * that of an integer: products of differences below 2^25, so below 2^51.
 *
 * Source:     A. Jacobson, L. Kavan, O. Sorkine-Hornung, "Robust inside-outside segmentation using
 *             generalized winding numbers", ACM TOG 32(4), 2013; A. Van Oosterom, J. Strackee,
 *             "The solid angle of a plane triangle", IEEE Trans. Biomed. Eng. 30(2), 1983.
 */
#ifndef CLVOX_CURTAIN_H
#define CLVOX_CURTAIN_H

#include "winding/turn.h"

/* A corner of the rim seen from a point, in units of length; up: its length plus y. */
typedef struct {
    float x, y, z, length, up;
} Corner;

static inline Corner see_corner(const int3 from, const float4 scale)
{
    Corner c;
    c.x = (float)from.x * scale.x;
    c.y = (float)from.y * scale.y;
    c.z = (float)from.z * scale.z;
    const float across = c.x * c.x + c.z * c.z;
    c.length = sqrt(across + c.y * c.y);
    c.up = from.y < 0 ? across / (c.length - c.y) : c.length + c.y;
    /* Straight above the corner the sample's infinitesimal move (e, e^2, e^3) tells the way. */
    if (from.x == 0 && from.z == 0 && from.y < 0) c.x = -1.0f;
    return c;
}

/* On which side of the curtain over an edge a sample is: the edge seen from its centre, and the
 * infinitesimal move where that is on neither. */
static inline long side_of(const int3 a, const int3 b)
{
    const long side = (long)a.x * b.z - (long)a.z * b.x;
    if (side != 0) return side;
    return a.z != b.z ? a.z - b.z : b.x - a.x;
}

/* Half the solid angle of the curtain over an edge of the rim, seen from a sample, counted so that
 * the mesh and the curtain together wind around it as often as the crossings before it say.
 * a, b: the edge as its triangle runs along it, from the sample's centre.
 * scale: widths of a lattice step along x, y and z, in any unit. */
static inline float edge_angle(const int3 a, const int3 b, const float4 scale)
{
    #pragma OPENCL FP_CONTRACT OFF
    if (a.x == b.x && a.z == b.z) return 0.0f;
    const Corner from = see_corner(a, scale);
    const Corner to = see_corner(b, scale);
    const long exact = (long)a.x * b.z - (long)a.z * b.x;
    const float area = exact != 0 ? fabs((float)exact) * (scale.x * scale.z)
                                  : fabs(from.x * to.z - from.z * to.x);
    const float angle = atan2(area, from.up * to.up + from.x * to.x + from.z * to.z);
    return side_of(a, b) < 0 ? -angle : angle;
}

/* How often the curtain winds around the sample at p.  The sum is compensated (Neumaier, 1974), so
 * that it is as good as its terms, however many there are.
 * rim: (edges, 2, 3) int32, on the lattice. */
static inline float curtain_winding(
    const __global int *rim, const uint edges, const int3 p, const float4 scale)
{
    #pragma OPENCL FP_CONTRACT OFF
    float angles = 0.0f, lost = 0.0f;
    for (uint edge = 0; edge < edges; ++edge) {
        const float angle = edge_angle(
            vload3(2 * (ulong)edge, rim) - p, vload3(2 * (ulong)edge + 1, rim) - p, scale);
        const float sum = angles + angle;
        lost += fabs(angles) < fabs(angle) ? (angle - sum) + angles : (angles - sum) + angle;
        angles = sum;
    }
    return (angles + lost) / TURN;
}

#endif
