/*
 * boundary/flat.h: does a triangle have no area on the lattice?
 */
#ifndef CLVOX_FLAT_H
#define CLVOX_FLAT_H

/* b, c: two edges from one corner.  They are below 2^24 steps, so products are exact. */
static inline bool is_flat(const int3 b, const int3 c)
{
    /* What differs in its low 32 bits differs, and few triangles agree there. */
    if ((uint)b.y * (uint)c.z != (uint)b.z * (uint)c.y) return false;
    return (long)b.y * c.z == (long)b.z * c.y && (long)b.z * c.x == (long)b.x * c.z
        && (long)b.x * c.y == (long)b.y * c.x;
}

#endif
