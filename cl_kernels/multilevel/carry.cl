/*
 * multilevel/carry.cl: from flipped bits to solid bricks and inside cells.
 *
 * A flipped bit says "from here on, the other side".  Each row of cells is walked along y with the
 * state of its fine rays, one bit per ray: through a brick by a running xor, past a cell without
 * one unchanged.  A cell without a brick is touched by no triangle, so all its rays agree on a
 * closed mesh; where they do not, the cell is counted as a disagreement.
 *
 * Host:       clvox/ops/multilevel.py, carry()
 * Reference:  clvox/reference/multilevel.py, build()
 * Tests:      tests/kernels/test_multilevel.py
 * Defines:    BRICK_X, BRICK_Y, BRICK_Z  voxels along the sides of a brick
 */
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

/* One work-item walks along y the 32 rows of cells that share a word of bits along x.
 * cells: shape of the coarse grid; voxels: shape of the fine one.
 * boundary, rank: as in docs/layouts.
 * beyond: a face per column of cells, (z, x): crossings past the last sample.
 * exits: a face per brick: crossings behind the last sample of its cell.
 * states: a face per column of cells; on entry the crossings before the first sample, overwritten.
 * bricks: flipped bits on entry, resolved ones on return; padding is cleared.
 * inside: one bit per cell, undefined on entry.
 * doubts: (2,) uint32, added to: cells whose rays disagree, rays that end inside. */
__kernel void carry(
    const int4 cells, const int4 voxels,
    const __global uint *restrict boundary, const __global uint *restrict rank,
    const __global uint *restrict beyond, const __global uint *restrict exits,
    __global uint *restrict states, __global uint *restrict bricks,
    __global uint *restrict inside, __global uint *restrict doubts)
{
    const int row_words = (int)words_in_row(cells.x);
    const ulong id = get_global_id(0);
    if (id >= (ulong)row_words * cells.z) return;
    const int word_x = (int)(id % row_words);
    const int z = (int)(id / row_words);
    const int lanes = min(cells.x - 32 * word_x, 32);
    __global uint *faces = states + ((ulong)z * cells.x + 32 * word_x) * FACE_WORDS;
    uint disagreements = 0;
    /* A lane's state is in its face after a brick (`faced`), else one bit of `uniform`. */
    uint faced = (uint)((1UL << lanes) - 1);
    uint uniform = 0;

    for (int y = 0; y < cells.y; ++y) {
        const ulong word = cell_word(cells, 32 * word_x, y, z);
        const uint touched = boundary[word];
        for (uint left = faced & ~touched; left; left &= left - 1) {
            const int lane = popcount((left & -left) - 1);
            const __global uint *face = faces + lane * FACE_WORDS;
            uniform = (uniform & ~(1u << lane)) | (face[0] & 1) << lane;
            if (!is_uniform(face)) ++disagreements;
        }
        inside[word] = uniform & ~touched & (uint)((1UL << lanes) - 1);
        if (touched) {
            uint brick = rank_of(boundary, rank, word, 0);
            for (uint left = touched; left; left &= left - 1, ++brick) {
                const int lane = popcount((left & -left) - 1);
                __global uint *face = faces + lane * FACE_WORDS;
                if (!(faced >> lane & 1)) fill_face(face, uniform >> lane & 1);
                const int3 kept = min(
                    voxels.xyz - (int3)(32 * word_x + lane, y, z)
                        * (int3)(BRICK_X, BRICK_Y, BRICK_Z),
                    (int3)(BRICK_X, BRICK_Y, BRICK_Z));
                walk_brick(bricks + (ulong)brick * BRICK_WORDS, face,
                           exits + (ulong)brick * FACE_WORDS, kept);
            }
        }
        faced = touched;
    }

    uint odd = 0;
    for (int lane = 0; lane < lanes; ++lane) {
        __global uint *face = faces + lane * FACE_WORDS;
        const __global uint *ends
            = beyond + ((ulong)z * cells.x + 32 * word_x + lane) * FACE_WORDS;
        if (!(faced >> lane & 1)) fill_face(face, uniform >> lane & 1);
        for (uint w = 0; w < FACE_WORDS; ++w) odd += popcount(face[w] ^ ends[w]);
    }
    if (disagreements) atomic_add(doubts, disagreements);
    if (odd) atomic_add(doubts + 1, odd);
}
