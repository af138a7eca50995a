/*
 * attributes/octahedral.h: a direction in 32 bits.
 *
 * The sphere is pressed onto the octahedron |x| + |y| + |z| = 1, its lower half folded over the
 * upper one, and x and y are kept, 16 bits each in 32767ths: x in the lower half of the word.
 *
 * Source:     Z. H. Cigolle et al., "A survey of efficient representations for independent unit
 *             vectors", Journal of Computer Graphics Techniques 3(2), 2014.
 */
#ifndef CLVOX_OCTAHEDRAL_H
#define CLVOX_OCTAHEDRAL_H

#define NO_NORMAL 0x80008000u

/* part / whole in 32767ths, rounded to the nearest, halves up; |part| <= whole < 2^47. */
static inline int in_parts(const long part, const long whole)
{
    const long numerator = 2 * part * 32767 + whole, denominator = 2 * whole;
    const long quotient = numerator / denominator;
    return (int)(quotient - (numerator - quotient * denominator < 0));
}

/* Of a vector of any length; (0, 0, 1) for none. */
static inline uint pack_normal(const long x, const long y, const long z)
{
    const long whole = (long)(abs(x) + abs(y) + abs(z));
    if (whole == 0) return 0;
    const int u = in_parts(x, whole), v = in_parts(y, whole);
    const int across = z < 0 ? (32767 - (int)abs(v)) * (u < 0 ? -1 : 1) : u;
    const int along = z < 0 ? (32767 - (int)abs(u)) * (v < 0 ? -1 : 1) : v;
    return ((uint)across & 0xffffu) | (uint)along << 16;
}

/* One part of a packed direction, from -1 to 1. */
static inline float packed_part(const uint bits)
{
    return (float)(short)(bits & 0xffffu) * (1.0f / 32767.0f);
}

/* A vector along a packed direction, not of length 1; the last part is 0. */
static inline float4 unpack_normal(const uint packed)
{
    const float u = packed_part(packed), v = packed_part(packed >> 16);
    const float z = 1.0f - fabs(u) - fabs(v);
    const float x = z < 0.0f ? (1.0f - fabs(v)) * (u < 0.0f ? -1.0f : 1.0f) : u;
    const float y = z < 0.0f ? (1.0f - fabs(u)) * (v < 0.0f ? -1.0f : 1.0f) : v;
    return (float4)(x, y, z, 0.0f);
}

#endif
