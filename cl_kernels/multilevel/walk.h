/*
 * multilevel/walk.h: the state of a cell's rays, carried through its brick.
 *
 * A face holds one bit per fine ray along y through a cell: on which side the ray is.
 *
 * Defines:    BRICK_X, BRICK_Y, BRICK_Z  voxels along the sides of a brick
 */
#ifndef CLVOX_WALK_H
#define CLVOX_WALK_H

#include "common/bricks.h"

#define FACE_BITS (BRICK_X * BRICK_Z)

/* Up to 32 bits of a run of words, and back. */
static inline uint get_bits(const __global uint *words, const uint at, const uint count)
{
    const uint word = at / 32, shift = at % 32;
    ulong pair = words[word];
    if (shift + count > 32) pair |= (ulong)words[word + 1] << 32;
    return (uint)(pair >> shift) & (uint)((1UL << count) - 1);
}

static inline void put_bits(__global uint *words, const uint at, const uint count, const uint bits)
{
    const uint word = at / 32, shift = at % 32;
    const ulong mask = ((1UL << count) - 1) << shift;
    const ulong pair = (ulong)bits << shift;
    words[word] = (words[word] & ~(uint)mask) | (uint)pair;
    if (shift + count > 32)
        words[word + 1] = (words[word + 1] & ~(uint)(mask >> 32)) | (uint)(pair >> 32);
}

static inline void fill_face(__global uint *face, const bool value)
{
    for (uint w = 0; w < FACE_WORDS; ++w) {
        const uint bits = min(FACE_BITS - 32 * w, 32u);
        face[w] = value ? (uint)((1UL << bits) - 1) : 0;
    }
}

/* Do all rays of the face agree? */
static inline bool is_uniform(const __global uint *face)
{
    const bool first = face[0] & 1;
    uint differing = 0;
    for (uint w = 0; w < FACE_WORDS; ++w) {
        const uint bits = min(FACE_BITS - 32 * w, 32u);
        differing |= face[w] ^ (first ? (uint)((1UL << bits) - 1) : 0);
    }
    return differing == 0;
}

#if BRICK_X == 8 && BRICK_Y == 8 && BRICK_Z == 8

/* Eight z-planes of eight bytes along y: three shifts are the running xor, and a byte times
 * 0x0101... the state of its eight rays at all y. */
static inline void walk_brick(
    __global uint *brick, __global uint *face, const __global uint *exits, const int3 kept)
{
    __global ulong *planes = (__global ulong *)brick;
    const ulong state = upsample(face[1], face[0]);
    const ulong flips = upsample(exits[1], exits[0]);
    ulong after = 0;
    for (int z = 0; z < 8; ++z) {
        ulong plane = planes[z];
        plane ^= plane << 8;
        plane ^= plane << 16;
        plane ^= plane << 32;
        plane ^= ((state >> (8 * z)) & 0xff) * 0x0101010101010101UL;
        after |= (plane >> 56) << (8 * z);
        if (kept.x < 8) plane &= ((1UL << kept.x) - 1) * 0x0101010101010101UL;
        if (kept.y < 8) plane &= (1UL << (8 * kept.y)) - 1;
        planes[z] = z < kept.z ? plane : 0;
    }
    face[0] = (uint)(after ^ flips);
    face[1] = (uint)((after ^ flips) >> 32);
}

#elif BRICK_X == 4 && BRICK_Y == 4 && BRICK_Z == 4

/* Sixteen bits for each z, four of them for each y: two shifts are the running xor. */
static inline void walk_brick(
    __global uint *brick, __global uint *face, const __global uint *exits, const int3 kept)
{
    __global ulong *voxels = (__global ulong *)brick;
    const ulong rays = face[0];
    const ulong state = (rays & 0xf) | (rays & 0xf0) << 12 | (rays & 0xf00) << 24
                      | (rays & 0xf000) << 36;
    ulong bits = *voxels;
    bits ^= (bits & 0x0fff0fff0fff0fffUL) << 4;
    bits ^= (bits & 0x00ff00ff00ff00ffUL) << 8;
    bits ^= state * 0x1111;
    const ulong last = bits >> 12;
    face[0] = exits[0] ^ (uint)((last & 0xf) | (last >> 12 & 0xf0) | (last >> 24 & 0xf00)
                                | (last >> 36 & 0xf000));
    if (kept.x < 4) bits &= ((1UL << kept.x) - 1) * 0x1111111111111111UL;
    if (kept.y < 4) bits &= ((1UL << 4 * kept.y) - 1) * 0x0001000100010001UL;
    if (kept.z < 4) bits &= (1UL << 16 * kept.z) - 1;
    *voxels = bits;
}

#else

static inline void walk_brick(
    __global uint *brick, __global uint *face, const __global uint *exits, const int3 kept)
{
    for (int z = 0; z < BRICK_Z; ++z) {
        for (int x = 0; x < BRICK_X; x += 32) {
            const uint count = min(BRICK_X - x, 32);
            const int ray = z * BRICK_X + x;
            const int real = z < kept.z ? clamp(kept.x - x, 0, (int)count) : 0;
            const uint mask = (uint)((1UL << real) - 1);
            uint state = get_bits(face, ray, count);
            for (int y = 0; y < BRICK_Y; ++y) {
                const uint at = (z * BRICK_Y + y) * BRICK_X + x;
                state ^= get_bits(brick, at, count);
                put_bits(brick, at, count, y < kept.y ? state & mask : 0);
            }
            put_bits(face, ray, count, state ^ get_bits(exits, ray, count));
        }
    }
}

#endif

#endif
