/*
 * raymarch/rays.h: the rays of a picture, in integers; clvox/camera.py says what they are.
 *
 * Axes along which a ray runs backwards are mirrored about the padded grid, so that all planes
 * are met in rising order.  A ray meets plane p of axis j at the moment (p 2^bits - place) pace,
 * exactly; moments that are equal are in the order of their axes, x first.
 */
#ifndef CLVOX_RAYMARCH_RAYS_H
#define CLVOX_RAYMARCH_RAYS_H

#define RAY_PARAMETERS \
    const int bits, const int fraction, const long reach, const long4 direction, \
    const long4 start, const long4 right, const long4 down

/* The place of a ray, in steps. */
static inline long3 place_of(
    const int fraction, const long4 start, const long4 right, const long4 down,
    const int column, const int row)
{
    return ((start + right * (long)column + down * (long)row) >> (long)fraction).xyz;
}

static inline long not_zero(const long part)
{
    return part == 0 ? 1 : (long)abs(part);
}

/* Moments per step along each axis. */
static inline long3 paces(const long4 direction)
{
    const long x = not_zero(direction.x), y = not_zero(direction.y), z = not_zero(direction.z);
    return (long3)(y * z, x * z, x * y);
}

/* Axis whose moment comes first, and last. */
static inline int first_axis(const long3 t)
{
    return t.x <= t.y && t.x <= t.z ? 0 : (t.y <= t.z ? 1 : 2);
}

static inline int last_axis(const long3 t)
{
    return t.z >= t.x && t.z >= t.y ? 2 : (t.y >= t.x ? 1 : 0);
}

static inline long part_of(const long3 t, const int axis)
{
    return axis == 0 ? t.x : (axis == 1 ? t.y : t.z);
}

/* Is the moment (t, axis) before (u, other)? */
static inline bool is_before(const long t, const int axis, const long u, const int other)
{
    return t < u || (t == u && axis < other);
}

/* A mask of one axis. */
static inline int3 along(const int axis)
{
    return (int3)(-(axis == 0), -(axis == 1), -(axis == 2));
}

/* Planes met after the moments `since` up to (t, axis), that one included; they lie `apart`.
 * Means nothing along axes on which the ray stands still. */
static inline int3 planes_met(const long3 since, const long3 apart, const long t, const int axis)
{
    return (int3)(
        (int)((t - since.x) / apart.x),
        (int)((t - since.y - (1 > axis)) / apart.y),
        (int)((t - since.z - (2 > axis)) / apart.z));
}

#endif
