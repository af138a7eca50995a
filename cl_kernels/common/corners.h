/*
 * common/corners.h: a corner of a triangle.
 */
#ifndef CLVOX_CORNERS_H
#define CLVOX_CORNERS_H

/* vertices: (3 n + 1,) int32, on the lattice: a number follows the last, for four are loaded, which
 * is quicker than three. */
static inline int3 load_corner(const __global int *vertices, const int number)
{
    return vload4(0, vertices + 3 * (ulong)number).xyz;
}

#endif
