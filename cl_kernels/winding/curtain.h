/*
 * winding/curtain.h: how far a curtain below nothing and above the rim of an open mesh winds around
 * a point.
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

#define TURN 6.28318530718f

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

/* How often the curtain winds around the sample at p, counted so that the mesh and the curtain
 * together wind around it as often as crossings before it say.
 * rim: (edges, 2, 3) int32, on the lattice, each edge as its triangle runs along it.
 * scale: widths of a lattice step along x, y and z, in any unit. */
static inline float curtain_winding(
    const __global int *rim, const uint edges, const int3 p, const float4 scale)
{
    #pragma OPENCL FP_CONTRACT OFF
    float turns = 0.0f;
    for (uint edge = 0; edge < edges; ++edge) {
        const int3 a = vload3(2 * (ulong)edge, rim) - p;
        const int3 b = vload3(2 * (ulong)edge + 1, rim) - p;
        if (a.x == b.x && a.z == b.z) continue;
        const long side = (long)a.x * b.z - (long)a.z * b.x;
        const long tie = a.z != b.z ? a.z - b.z : b.x - a.x;
        const Corner from = see_corner(a, scale);
        const Corner to = see_corner(b, scale);
        const float area = side != 0 ? fabs((float)side) * (scale.x * scale.z)
                                     : fabs(from.x * to.z - from.z * to.x);
        const float angle
            = atan2(area, from.up * to.up + from.x * to.x + from.z * to.z);
        turns += (side != 0 ? side : tie) < 0 ? -angle : angle;
    }
    return turns / TURN;
}

#endif
