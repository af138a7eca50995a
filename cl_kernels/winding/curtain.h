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

#define TURN 6.28318530718f

/* More than the error of a winding summed in float32. */
#define MARGIN 1e-3f

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

/* How often the curtain winds around the sample at p.
 * rim: (edges, 2, 3) int32, on the lattice. */
static inline float curtain_winding(
    const __global int *rim, const uint edges, const int3 p, const float4 scale)
{
    #pragma OPENCL FP_CONTRACT OFF
    float angles = 0.0f;
    for (uint edge = 0; edge < edges; ++edge)
        angles += edge_angle(
            vload3(2 * (ulong)edge, rim) - p, vload3(2 * (ulong)edge + 1, rim) - p, scale);
    return angles / TURN;
}

/* A box of samples, its corners among them, and its centre and radius. */
typedef struct {
    int3 low, high, centre;
    float radius;
} Box;

static inline Box make_box(const int3 low, const int3 high, const float4 scale)
{
    Box box;
    box.low = low;
    box.high = high;
    box.centre = low + ((high - low) >> 1);
    /* A step more, since the centre was rounded. */
    const float3 reach = (convert_float3(high - low) * 0.5f + 1.0f) * scale.xyz;
    box.radius = sqrt(dot(reach, reach));
    return box;
}

/* How far the edge (a, b) stays from the box, at least; negative if perhaps not at all. */
static inline float gap_to(const Box box, const int3 a, const int3 b, const float4 scale)
{
    const float3 p = convert_float3(a - box.centre) * scale.xyz;
    const float3 along = convert_float3(b - a) * scale.xyz;
    const float length = dot(along, along);
    const float at = length > 0.0f ? clamp(-dot(p, along) / length, 0.0f, 1.0f) : 0.0f;
    const float3 off = p + at * along;
    return sqrt(dot(off, off)) - box.radius;
}

/* By how much the edge may change what the curtain winds, from the centre of the box to any sample,
 * apart from jumps by whole numbers across the curtain: the gradient of a solid angle is an
 * integral along its rim, of dl / r^2 at most (Biot and Savart).  Only the sum over the whole rim
 * means something. */
static inline float change_of(
    const Box box, const float gap, const int3 a, const int3 b, const float4 scale)
{
    const float3 along = convert_float3(b - a) * scale.xyz;
    return sqrt(dot(along, along)) / (gap * gap) * (box.radius / (2.0f * TURN));
}

/* By how much what the curtain winds jumps at the curtain over an edge, on the way from one sample
 * to another, which is along x or along z, above the edge. */
static inline int jump_along(const int3 a, const int3 b, const int3 from, const int3 to)
{
    const bool passes = from.z == to.z ? (a.z > from.z) != (b.z > from.z)
                                       : (a.x > from.x) != (b.x > from.x);
    if (!passes) return 0;
    return (side_of(a - to, b - to) > 0) - (side_of(a - from, b - from) > 0);
}

static inline long turn_of(const int3 a, const int3 b, const int x, const int z)
{
    return (long)(b.x - a.x) * (z - a.z) - (long)(b.z - a.z) * (x - a.x);
}

/* May the curtain over the edge (a, b) pass through the box? */
static inline bool curtain_meets(const Box box, const int3 a, const int3 b)
{
    const int3 low = box.low, high = box.high;
    if (high.y < min(a.y, b.y)) return false;
    if (max(a.x, b.x) < low.x || min(a.x, b.x) > high.x) return false;
    if (max(a.z, b.z) < low.z || min(a.z, b.z) > high.z) return false;
    const long p = turn_of(a, b, low.x, low.z), q = turn_of(a, b, high.x, low.z);
    const long r = turn_of(a, b, low.x, high.z), s = turn_of(a, b, high.x, high.z);
    return !((p > 0 && q > 0 && r > 0 && s > 0) || (p < 0 && q < 0 && r < 0 && s < 0));
}

#endif
