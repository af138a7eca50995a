/*
 * raymarch/plane.h: when a ray meets a plane at any angle; for planes see clvox/picture_rays.py.
 *
 * Defines:    PLANE_BITS  bits behind the point of a moment, in directions
 *             TIME_BITS   bits of a moment
 */
#ifndef CLVOX_PLANE_H
#define CLVOX_PLANE_H

/* The moment at which a ray meets a plane: whole * rest / slope, to PLANE_BITS bits of one
 * direction, as clvox/picture_rays.py has it.  slope: how fast it nears the plane, above 0; whole:
 * the moments of one direction. */
static inline long moment_at_plane(const long rest, const long slope, const long whole)
{
    const long never = 1L << TIME_BITS, limit = never / whole;
    long turns = rest / slope;
    turns -= turns * slope > rest;
    if (turns >= limit) return never;
    if (turns <= -limit) return -never;
    const long parts = ((rest - turns * slope) << PLANE_BITS) / slope;
    const long low = whole & ((1L << PLANE_BITS) - 1);
    return whole * turns + (whole >> PLANE_BITS) * parts + (low * parts >> PLANE_BITS);
}

#endif
