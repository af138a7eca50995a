/*
 * raymarch/plane.h: when a ray meets a plane at any angle; for planes see clvox/picture_rays.py.
 *
 * Defines:    PLANE_BITS  bits behind the point of a moment, in directions
 *             TIME_BITS   bits of a moment
 *             WIDTH       (raymarch/lanes.h)
 */
#ifndef CLVOX_PLANE_H
#define CLVOX_PLANE_H

#include "raymarch/lanes.h"

/* The moment at which a ray meets a plane: whole * rest / slope, to PLANE_BITS bits of one
 * direction, as clvox/picture_rays.py has it.  slope: how fast it nears the plane, above 0; whole:
 * the moments of one direction. */
static inline longs moments_at_plane(const longs rest, const longs slope, const longs whole)
{
    const long never = 1L << TIME_BITS;
    const longs limit = never / whole;
    const longs quotient = rest / slope, turns = quotient + WHERE(quotient * slope > rest);
    const longs beyond = WHERE(turns >= limit), before = WHERE(turns <= -limit);
    const longs some = turns & ~(beyond | before);
    const longs parts = ((rest - turns * slope) << PLANE_BITS) / slope;
    const longs low = whole & ((1L << PLANE_BITS) - 1);
    const longs moment = whole * some + (whole >> PLANE_BITS) * parts + (low * parts >> PLANE_BITS);
    return EITHER(beyond, never, EITHER(before, -never, moment));
}

#endif
