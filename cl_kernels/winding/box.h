/*
 * winding/box.h: boxes of samples, and which samples of one are inside.
 */
#ifndef CLVOX_BOX_H
#define CLVOX_BOX_H

#include "winding/caps.h"

/* How closely a box looks at the caps: what they wind is mostly near a whole number, half a turn
 * away from doubt. */
#define BOX_CARE 1.0f

/* About the middle of the samples of the voxels from `low` to `high`, on the lattice. */
static inline int3 centre_of(const int3 low, const int3 high)
{
    const int3 first = low << STEP_BITS, last = high << STEP_BITS;
    return first + ((last - first) >> 1);
}

/* How far those samples are from it, at most. */
static inline float reach_of(const int3 low, const int3 high, const float4 scale)
{
    #pragma OPENCL FP_CONTRACT OFF
    /* A step more, since the centre was rounded. */
    const float3 sides
        = (convert_float3((high << STEP_BITS) - (low << STEP_BITS)) * 0.5f + 1.0f) * scale.xyz;
    return sqrt(dot(sides, sides)) * (1.0f + 0x1p-20f);
}

/* The least sum of signs of crossings, before a sample and with those of the caps, that is inside,
 * for all samples of the voxels from `low` to `high`; MIXED if there may be none. */
static inline short threshold_of(const int3 low, const int3 high, CAPS_PARAMETERS)
{
    #pragma OPENCL FP_CONTRACT OFF
    const float reach = reach_of(low, high, scale);
    const Estimate caps = wind_caps(centre_of(low, high), reach, BOX_CARE, CAPS);
    const float least = caps.winding + 0.5f, below = floor(least);
    const bool sure = min(least - below, below + 1.0f - least) > caps.error;
    return sure && fabs(below) < 32000.0f ? (short)((int)below + 1) : (short)MIXED;
}

#endif
