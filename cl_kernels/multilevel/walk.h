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

#if BRICK_X == BRICK_Y && BRICK_Y == BRICK_Z && (BRICK_X == 4 || BRICK_X == 8)

#include "multilevel/pass.h"

static inline void walk_brick(
    __global uint *brick, __global uint *face, const __global uint *exits, const int3 kept)
{
    store_face(face, pass_brick(brick, exits, load_face(face)));
    if (kept.x < BRICK_X || kept.y < BRICK_Y || kept.z < BRICK_Z) clip_brick(brick, kept);
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
