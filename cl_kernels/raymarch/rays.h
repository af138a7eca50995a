/*
 * raymarch/rays.h: the rays of a picture, in integers; clvox/camera.py says what they are.
 *
 * Axes along which a ray runs backwards are mirrored about the padded grid, so that all planes
 * are met in rising order.  A ray meets plane p of axis j at the moment (p 2^bits - place) pace,
 * exactly; moments that are equal are in the order of their axes, x first.
 */
#ifndef CLVOX_RAYMARCH_RAYS_H
#define CLVOX_RAYMARCH_RAYS_H

/* Oclgrind crashes where vectors are handed to a function that is not inlined, or go round a loop
 * (as in Walk, below), and where one bit chooses between two of them. */
#define INLINE static inline __attribute__((always_inline))

#define RAY_PARAMETERS \
    const int bits, const int fraction, const long reach, const long4 direction, \
    const long4 start, const long4 right, const long4 down

/* The place of a ray, in steps. */
INLINE long3 place_of(
    const int fraction, const long4 start, const long4 right, const long4 down,
    const int column, const int row)
{
    return ((start + right * (long)column + down * (long)row) >> (long)fraction).xyz;
}

INLINE bool is_within(const long3 place, const long reach)
{
    return place.x < reach && place.y < reach && place.z < reach
        && place.x > -reach && place.y > -reach && place.z > -reach;
}

INLINE long not_zero(const long part)
{
    return part == 0 ? 1 : (long)abs(part);
}

/* Moments per step along each axis. */
INLINE long3 paces(const long4 direction)
{
    const long x = not_zero(direction.x), y = not_zero(direction.y), z = not_zero(direction.z);
    return (long3)(y * z, x * z, x * y);
}

/* Axis whose moment comes first, and last. */
INLINE int first_axis(const long3 t)
{
    return t.x <= t.y && t.x <= t.z ? 0 : (t.y <= t.z ? 1 : 2);
}

INLINE int last_axis(const long3 t)
{
    return t.z >= t.x && t.z >= t.y ? 2 : (t.y >= t.x ? 1 : 0);
}

INLINE long part_of(const long3 t, const int axis)
{
    return axis == 0 ? t.x : (axis == 1 ? t.y : t.z);
}

/* Is the moment (t, axis) before (u, other)? */
INLINE bool is_before(const long t, const int axis, const long u, const int other)
{
    return t < u || (t == u && axis < other);
}

/* Planes met after the moments `since` up to (t, axis), that one included; they lie `apart`.
 * Means nothing along axes on which the ray stands still. */
INLINE int3 planes_met(const long3 since, const long3 apart, const long t, const int axis)
{
    return (int3)(
        (int)((t - since.x) / apart.x),
        (int)((t - since.y - (1 > axis)) / apart.y),
        (int)((t - since.z - (2 > axis)) / apart.z));
}

/* Where a ray is: in which cell, and the moments at which it leaves it. */
typedef struct {
    int x, y, z;
    long leaves_x, leaves_y, leaves_z;
} Walk;

INLINE Walk begin_walk(const int3 cell, const long3 leaves)
{
    return (Walk){cell.x, cell.y, cell.z, leaves.x, leaves.y, leaves.z};
}

/* Axis along which the cell is left. */
INLINE int way_out(const Walk *walk)
{
    return first_axis((long3)(walk->leaves_x, walk->leaves_y, walk->leaves_z));
}

INLINE long moment_out(const Walk *walk, const int axis)
{
    return part_of((long3)(walk->leaves_x, walk->leaves_y, walk->leaves_z), axis);
}

/* Go on to the next cell along an axis; planes lie `apart`. */
INLINE void step_along(Walk *walk, const int axis, const long3 apart)
{
    if (axis == 0) {
        walk->x += 1;
        walk->leaves_x += apart.x;
    } else if (axis == 1) {
        walk->y += 1;
        walk->leaves_y += apart.y;
    } else {
        walk->z += 1;
        walk->leaves_z += apart.z;
    }
}

#endif
