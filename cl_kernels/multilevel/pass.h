/*
 * multilevel/pass.h: the state of a cell's rays as one long, carried through its brick.
 *
 * Of bricks of 8 x 8 x 8 voxels the state is the face itself, a byte for each z; of bricks of
 * 4 x 4 x 4 each z has 16 bits, the lowest four of which are its rays: so it meets the bits of the
 * brick, which have 16 for each z.
 *
 * Defines:    BRICK_X, BRICK_Y, BRICK_Z  voxels along the sides of a brick: 4 or 8, all alike
 */
#ifndef CLVOX_PASS_H
#define CLVOX_PASS_H

#include "common/bricks.h"

#if BRICK_X == 8 && BRICK_Y == 8 && BRICK_Z == 8

#define WHOLE_FACE 0xffffffffffffffffUL

static inline ulong load_face(const __global uint *face)
{
    return upsample(face[1], face[0]);
}

static inline void store_face(__global uint *face, const ulong state)
{
    face[0] = (uint)state;
    face[1] = (uint)(state >> 32);
}

/* Turns flipped bits into solid ones; returns the state behind the cell.  Eight z-planes of eight
 * bytes along y: three shifts are the running xor, and a byte times 0x0101... the state of its
 * eight rays at all y. */
static inline ulong pass_brick(
    __global uint *brick, const __global uint *exits, const ulong state)
{
    __global ulong *planes = (__global ulong *)brick;
    ulong after = load_face(exits);
    for (int z = 0; z < 8; ++z) {
        ulong plane = planes[z];
        plane ^= plane << 8;
        plane ^= plane << 16;
        plane ^= plane << 32;
        plane ^= ((state >> (8 * z)) & 0xff) * 0x0101010101010101UL;
        after ^= (plane >> 56) << (8 * z);
        planes[z] = plane;
    }
    return after;
}

/* Clears what is not in the first `kept` voxels along each axis. */
static inline void clip_brick(__global uint *brick, const int3 kept)
{
    __global ulong *planes = (__global ulong *)brick;
    const ulong mask = ((1UL << min(kept.x, 8)) - 1) * 0x0101010101010101UL
                     & (~0UL >> (64 - 8 * min(kept.y, 8)));
    for (int z = 0; z < 8; ++z) planes[z] &= z < kept.z ? mask : 0;
}

#else

#define WHOLE_FACE 0x000f000f000f000fUL

static inline ulong load_face(const __global uint *face)
{
    const ulong rays = *face;
    return (rays & 0xf) | (rays & 0xf0) << 12 | (rays & 0xf00) << 24 | (rays & 0xf000) << 36;
}

static inline void store_face(__global uint *face, const ulong state)
{
    face[0] = (uint)((state & 0xf) | (state >> 12 & 0xf0) | (state >> 24 & 0xf00)
                     | (state >> 36 & 0xf000));
}

/* The same: two shifts are the running xor. */
static inline ulong pass_brick(
    __global uint *brick, const __global uint *exits, const ulong state)
{
    __global ulong *voxels = (__global ulong *)brick;
    ulong bits = *voxels;
    bits ^= (bits & 0x0fff0fff0fff0fffUL) << 4;
    bits ^= (bits & 0x00ff00ff00ff00ffUL) << 8;
    bits ^= state * 0x1111;
    *voxels = bits;
    return (bits >> 12 & WHOLE_FACE) ^ load_face(exits);
}

static inline void clip_brick(__global uint *brick, const int3 kept)
{
    const ulong row = (1UL << min(kept.x, 4)) - 1;
    const ulong plane = row * 0x1111 & ((1UL << 4 * min(kept.y, 4)) - 1);
    *(__global ulong *)brick
        &= plane * 0x0001000100010001UL & (~0UL >> (64 - 16 * min(kept.z, 4)));
}

#endif

#endif
