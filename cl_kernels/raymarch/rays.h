/*
 * raymarch/rays.h: the rays of a picture, in integers; clvox/picture_rays.py says what they are.
 *
 * Axes along which a ray runs backwards are mirrored about the padded grid, so that all planes
 * are met in rising order.  A ray meets plane p of axis j at the moment (p 2^bits - place) pace,
 * exactly; moments that are equal are in the order of their axes, x first.
 */
#ifndef CLVOX_RAYMARCH_RAYS_H
#define CLVOX_RAYMARCH_RAYS_H

#define RAY_PARAMETERS \
    const int bits, const int fraction, const int turn, const int begins, const long reach, \
    const long4 start, const long4 right, const long4 down, \
    const long4 direction, const long4 turn_right, const long4 turn_down

/* Part of the place, or of the direction, of the ray of a column and a row. */
#define PLACE_OF(axis, column, row) \
    ((start.axis + right.axis * (column) + down.axis * (row)) >> fraction)
#define DIRECTION_OF(axis, column, row) \
    ((direction.axis + turn_right.axis * (column) + turn_down.axis * (row)) >> turn)

#endif
