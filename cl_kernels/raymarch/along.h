/*
 * raymarch/along.h: when rays meet the planes across one axis, for some rays side by side.
 *
 * Defines:    WIDTH  (raymarch/lanes.h)
 */
#ifndef CLVOX_ALONG_H
#define CLVOX_ALONG_H

#include "raymarch/lanes.h"

/* A moment after all others, whose difference from any of them fits into 64 bits. */
#define NEVER (3L << 61)

/* How large a part is; 1 if it is 0. */
static inline longs not_zero(const longs part)
{
    const longs turned = WHERE(part < 0);
    return ((part ^ turned) - turned) + (WHERE(part == 0) & 1);
}

/* One axis of rays, mirrored where they run downwards along it, so that they run upwards. */
typedef struct {
    longs zero;      /* moment at which plane 0 is met */
    longs step;      /* moments from a plane between voxels to the next one; 0: they stand still */
    floats pace;     /* one by that; 0 if they stand still */
    longs turned;    /* is the axis mirrored? */
    longs in, past;  /* moments at which what is drawn begins and ends */
    longs standing;  /* if they stand still: the voxel in which they do; else 0 */
    longs outside;   /* if they stand still: do they beside what is drawn? */
} Along;

/* padded: voxels along the axis, those of the padding included; it is drawn from low to before
 * high.  pace: moments for each step of the place. */
static inline void begin_along(
    Along *along, const longs place, const longs part, const longs pace, const int bits,
    const long padded, const long low, const long high)
{
    const longs turned = WHERE(part < 0), still = WHERE(part == 0);
    const longs away = place - (turned & (padded << bits));
    const longs step = (pace << bits) & ~still;
    const longs zero = ((away ^ ~turned) - ~turned) * pace;
    along->turned = turned;
    along->step = step;
    along->zero = EITHER(still, NEVER, zero);
    const floats whole = AS_FLOATS(EITHER(still, 1L, step));
    along->pace = AS_FLOATS(~still & 1L) / whole;
    const longs from = EITHER(turned, padded - high, low), to = EITHER(turned, padded - low, high);
    along->in = EITHER(still, -NEVER, zero + from * step);
    along->past = EITHER(still, NEVER, zero + to * step);
    const longs voxel = place >> bits;
    along->standing = voxel & still;
    along->outside = still & (WHERE(voxel < low) | WHERE(voxel >= high));
}

/* How many planes that are `apart` are met within `ahead` moments, one for each whole `apart`; at
 * least 0.  pace: one by `apart`. */
static inline longs planes_met(const longs ahead, const longs apart, const floats pace)
{
    /* In float32 this is right but for one, since a grid is not that long. */
    const longs count = AS_LONGS(AS_FLOATS(ahead) * pace);
    const longs rest = ahead - count * apart;
    const longs right = count - WHERE(rest >= apart) + WHERE(rest < 0);
    return right & WHERE(right >= 0);
}

#endif
