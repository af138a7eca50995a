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
static inline long ray_part(
    const long first, const long across, const long along, const int shift, const int column,
    const int row)
{
    return (first + across * column + along * row) >> shift;
}

#define PLACE_OF(axis, column, row) \
    ray_part(start.axis, right.axis, down.axis, fraction, column, row)
#define DIRECTION_OF(axis, column, row) \
    ray_part(direction.axis, turn_right.axis, turn_down.axis, turn, column, row)

static inline bool is_within(const long place, const long reach)
{
    return place < reach && place > -reach;
}

static inline long not_zero(const long part)
{
    return part == 0 ? 1 : (part < 0 ? -part : part);
}

/* One axis of a ray, mirrored so that the ray runs upwards along it. */
typedef struct {
    long zero;      /* moment at which plane 0 is met */
    long step;      /* moments from a plane between voxels to the next one; 0: it stands still */
    float pace;     /* one by that; 0 if it stands still */
    int turned;     /* is the axis mirrored? */
    int low, high;  /* voxels that are drawn */
    int standing;   /* if it stands still: the voxel in which it does */
} Along;

/* padded: voxels along the axis, those of the padding included; it is drawn from low to before
 * high.  pace: moments for each step of the place. */
static inline void begin_along(
    Along *along, const long place, const long part, const long pace, const int bits,
    const int padded, const int low, const int high)
{
    const long one = 1L << bits;
    along->turned = part < 0;
    along->zero = part < 0 ? (place - padded * one) * pace : -place * pace;
    along->step = part == 0 ? 0 : one * pace;
    along->pace = part == 0 ? 0.0f : 1.0f / (float)along->step;
    along->low = part < 0 ? padded - high : low;
    along->high = part < 0 ? padded - low : high;
    along->standing = (int)(place >> bits);
}

static inline long moment_in(const Along *along)
{
    return along->step == 0 ? LONG_MIN : along->zero + along->low * along->step;
}

static inline long moment_past(const Along *along)
{
    return along->step == 0 ? LONG_MAX : along->zero + along->high * along->step;
}

static inline bool stands_outside(const Along *along)
{
    return along->step == 0 && (along->standing < along->low || along->standing >= along->high);
}

/* Cells of `side` voxels passed after the moment `since` up to (t, axis), that one included, along
 * the axis `own`; if it stands still, where it does: `standing` voxels after `since`. */
static inline int cells_passed(
    const Along *along, const long since, const int side, const int standing, const long t,
    const int axis, const int own)
{
    const long apart = along->step * side;
    if (apart == 0) return standing / side;
    /* In float32 this is right but for one, since a grid is not that long. */
    const long ahead = t - since - (own > axis);
    const int count = (int)((float)ahead * (along->pace / side));
    const long rest = ahead - count * apart;
    return max(count + (rest >= apart) - (rest < 0), 0);
}

/* The moment at which the cell with number `cell` is left, counted from the moment `since`. */
static inline long moment_out(const Along *along, const long since, const int side, const int cell)
{
    return along->step == 0 ? LONG_MAX : since + (long)(cell + 1) * along->step * side;
}

/* Axis whose moment comes first. */
static inline int first_axis(const long x, const long y, const long z)
{
    return x <= y && x <= z ? 0 : (y <= z ? 1 : 2);
}

/* Axis whose moment comes last. */
static inline int last_axis(const long x, const long y, const long z)
{
    return z >= x && z >= y ? 2 : (y >= x ? 1 : 0);
}

static inline long one_of(const int axis, const long x, const long y, const long z)
{
    return axis == 0 ? x : (axis == 1 ? y : z);
}

/* Is the moment (t, axis) before (u, other)? */
static inline bool is_before(const long t, const int axis, const long u, const int other)
{
    return t < u || (t == u && axis < other);
}

#endif
