/*
 * crossings/patches.h: crossings/rasterise.h for the bricks of a model, PATCH rays at a time.
 *
 * A patch is PATCH_Z rows of BRICK_X rays through one column of bricks.  Whether they are covered,
 * and their slots, is found for all at once, without a branch.  What they flip within GROUP slots,
 * a group, are bits of two words of one brick: so a brick is looked up once for some crossings.
 * Most patches have one group or two, which are listed without a branch, and looked up later.
 *
 * Slots are as exact as in crossings/planes.h: where a ray of a patch leaves its slot in doubt, or
 * is before the first sample or past the last, the crossings of the patch are found one by one.
 *
 * Patches reach out of a triangle's box by less than a brick, and the edge functions are stepped
 * once beyond: by less than 16 voxels.  Those of a triangle done directly stay, there, below
 * 20 * DIRECT * STEP, and so below 2^31: rays out of the box, too, are told to be uncovered.  Rays
 * out of the window are none: it consists of whole columns of bricks.
 *
 * Defines:    BRICK_*  4 x 4 x 4 or 8 x 8 x 8, such that a group fills two words
 *             DIRECT   2^12 at most
 */
#include "crossings/planes.h"

#define PATCH 16
#define PATCH_Z (PATCH / BRICK_X)
#define GROUP 4

/* Lanes are ordered such that every other flips bits of the second word: which ray is a lane's, and
 * which bit of the word that of the group's first slot. */
#if BRICK_X == 4
#define LANE_X ((uint16)(0, 0, 1, 1, 2, 2, 3, 3, 0, 0, 1, 1, 2, 2, 3, 3))
#define LANE_Z ((uint16)(0, 2, 0, 2, 0, 2, 0, 2, 1, 3, 1, 3, 1, 3, 1, 3))
#define LANE_BIT (LANE_X + 16 * (LANE_Z & 1))
#else
#define LANE_X ((uint16)(0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5, 6, 6, 7, 7))
#define LANE_Z ((uint16)(0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1))
#define LANE_BIT LANE_X
#endif

/* From the word of a group to its second. */
#define SECOND (BRICK_Y / GROUP)

/* A patch of more groups is steep, and done one by one. */
#define MOST_GROUPS 16
#define MOST_FOUND 64

/* Flips that the sink has not been given yet: the first word of each group, and two words' bits. */
typedef struct {
    uint count;
    ulong id[MOST_FOUND], bits[MOST_FOUND];
} Found;

static inline void drain(Found *found, Sink *sink)
{
    for (uint i = 0; i < found->count; ++i) flip_pair(sink, found->id[i], SECOND, found->bits[i]);
    found->count = 0;
}

/* Vectors are halved by way of an array, which compilers do away with: what a swizzle to fewer
 * lanes gives Oclgrind takes for undefined. */
static inline uint largest(const uint16 lanes)
{
    uint each[PATCH];
    vstore16(lanes, 0, each);
    vstore8(max(vload8(0, each), vload8(1, each)), 0, each);
    const uint4 of_4 = max(vload4(0, each), vload4(1, each));
    return max(max(of_4.x, of_4.y), max(of_4.z, of_4.w));
}

/* The bits of all even lanes, and above them those of all odd ones. */
static inline ulong gather(const uint16 lanes)
{
    ulong each[PATCH / 2];
    vstore8(as_ulong8(lanes), 0, each);
    vstore4(vload4(0, each) | vload4(1, each), 0, each);
    const ulong2 of_2 = vload2(0, each) | vload2(1, each);
    return of_2.x | of_2.y;
}

/* e: the edge functions at the first ray of the patch.  The estimate is less than 1/2 off, so the
 * slot is the nearest centre or the next, as the residual decides. */
static inline void cross_singly(
    Sink *sink, const Planes *p, const Edges e, const int u, const int v)
{
    #pragma OPENCL FP_CONTRACT OFF
    for (int ray = 0; ray < PATCH; ++ray) {
        const int i = ray / BRICK_X, j = ray % BRICK_X;
        const Edges at = edges_at(p, e, i, j);
        if ((at.a | at.b | at.c) < 0) continue;
        const float estimate = (float)at.a * p->slope_a + (float)at.b * p->slope_b + p->base;
        const int m = as_int(estimate + ROUNDER) - as_int(ROUNDER);
        const bool after = (long)residual_at(p, at, m) > -p->tie;
        cross(sink, u + i, v + j, p->base_slot + m + after);
    }
}

/* Lists what a group of a patch flips, if anything.
 * column: the id of the first word of the patch in the cell y = 0. */
static inline void put(Found *found, const ulong column, const uint group, const ulong bits)
{
    const uint y = group / SECOND;
    found->id[found->count] = column + WORD_OF(0, y, 0, group - y * SECOND);
    found->bits[found->count] = bits;
    found->count += bits != 0;
}

/* What is the same for all patches of a triangle: by how much the edge functions differ from lane
 * to lane, and the last slot but one. */
typedef struct {
    uint16 a, b, c;
    uint inner;
} Patches;

static inline void cast_patch(
    Sink *sink, Found *found, const Planes *p, const Patches *lanes, const Edges e, const int u,
    const int v)
{
    #pragma OPENCL FP_CONTRACT OFF
    const uint16 a = lanes->a + (uint)e.a;
    const uint16 b = lanes->b + (uint)e.b;
    const uint16 c = lanes->c + (uint)e.c;
    const uint16 covered = as_uint16(~(as_int16(a | b | c) >> 31));
    const float16 estimate = convert_float16(as_int16(a)) * p->slope_a
                           + convert_float16(as_int16(b)) * p->slope_b + p->base;
    const float16 shifted = estimate + ROUNDER;
    const float16 beyond = estimate - (shifted - ROUNDER);
    /* Whether it is positive is -1 in a vector. */
    const uint16 slots = (uint16)(p->base_slot - as_int(ROUNDER)) + as_uint16(shifted)
                       - as_uint16(beyond > 0.0f);
    const uint16 apart = covered & (as_uint16(fabs(beyond) <= p->doubt)
                                    | as_uint16(slots - 1 >= lanes->inner));
    const uint16 groups = slots / GROUP;
    const uint last = largest(groups & covered), first = ~largest(~groups & covered);
    if (gather(apart) != 0 || last - first >= MOST_GROUPS) {
        cross_singly(sink, p, e, u, v);
        return;
    }
    const uint16 bits = covered & ((uint16)(1) << (slots % GROUP * BRICK_X + LANE_BIT));
    const uint x = (uint)v / BRICK_X, z = (uint)u / BRICK_Z;
    const ulong column = WORD_OF(x, 0, z, ((uint)u - z * BRICK_Z) * (BRICK_X * BRICK_Y) / 32);
    if (found->count > MOST_FOUND - MOST_GROUPS) drain(found, sink);
    put(found, column, first, gather(bits & as_uint16(groups == first)));
    put(found, column, last, gather(bits & as_uint16(groups == last) & as_uint16(groups != first)));
    for (uint group = first + 1; (int)(last - group) > 0; ++group)
        put(found, column, group, gather(bits & as_uint16(groups == group)));
}

/* Finds every crossing of the rays in `box`, the whole part of triangle f that is in the window,
 * and gives them to the sink, but those left to drain(). */
static inline void rasterise(Sink *sink, Found *found, const Facet f, const int4 box)
{
    const int first_u = (int)((uint)box.x / PATCH_Z * PATCH_Z);
    const int first_v = (int)((uint)box.y / BRICK_X * BRICK_X);
    Planes p;
    Edges row = make_planes(&p, f, (int2)(first_u, first_v));
    Patches lanes;
    lanes.a = LANE_X * (uint)p.bc.x - LANE_Z * (uint)p.bc.y;
    lanes.b = LANE_X * (uint)p.ca.x - LANE_Z * (uint)p.ca.y;
    lanes.c = LANE_X * (uint)p.ab.x - LANE_Z * (uint)p.ab.y;
    lanes.inner = (uint)(sink->columns.y * BRICK_Y) - 1;
    for (int u = first_u; u <= box.z; u += PATCH_Z) {
        Edges e = row;
        for (int v = first_v; v <= box.w; v += BRICK_X) {
            cast_patch(sink, found, &p, &lanes, e, u, v);
            e = edges_at(&p, e, 0, BRICK_X);
        }
        row = edges_at(&p, row, PATCH_Z, 0);
    }
}
