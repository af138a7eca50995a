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
 * Defines:    LEVELS, BRICK_*, MIDDLE_*  of the model (common/bricks.h)
 */
#include "multilevel/walk.h"

#if LEVELS == 2

/* One work-item walks along y the 32 rows of cells that share a word of bits along x.
 * voxels: shape of the fine grid.  The tree above the bricks: common/bricks.h.
 * Walked is a slab: so many layers of cells along z from first_layer on, whose bricks begin with
 * first_brick.
 * beyond: a face per column of cells of the slab, (z, x): crossings past the last sample.
 * exits: a face per brick of the slab: crossings behind the last sample of its cell.
 * states: a face per column of cells; on entry the crossings before the first sample, overwritten.
 * bricks: flipped bits on entry, resolved ones on return; padding is cleared.
 * inside: one bit per cell, undefined on entry.
 * doubts: (2,) uint32, added to: cells whose rays disagree, rays that end inside. */
__kernel void carry(
    const int4 voxels, TREE_PARAMETERS, const int first_layer, const int layers,
    const uint first_brick, const __global uint *restrict beyond,
    const __global uint *restrict exits,
    __global uint *restrict states, __global uint *restrict bricks,
    __global uint *restrict inside, __global uint *restrict doubts)
{
    const int row_words = (int)words_in_row(cells.x);
    const ulong id = get_global_id(0);
    if (id >= (ulong)row_words * layers) return;
    ulong number = id;
    const int word_x = take_place(&number, row_words);
    const int z = first_layer + (int)number;
    const int lanes = min(cells.x - 32 * word_x, 32);
    const ulong column = number * cells.x + 32 * word_x;
    __global uint *faces = states + column * FACE_WORDS;
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
                           exits + (ulong)(brick - first_brick) * FACE_WORDS, kept);
            }
        }
        faced = touched;
    }

    uint odd = 0;
    for (int lane = 0; lane < lanes; ++lane) {
        __global uint *face = faces + lane * FACE_WORDS;
        const __global uint *ends = beyond + (column + lane) * FACE_WORDS;
        if (!(faced >> lane & 1)) fill_face(face, uniform >> lane & 1);
        for (uint w = 0; w < FACE_WORDS; ++w) odd += popcount(face[w] ^ ends[w]);
    }
    if (disagreements) atomic_add(doubts, disagreements);
    if (odd) atomic_add(doubts + 1, odd);
}

#else

/* One work-item walks along y one row of cells of the middle level.
 * columns: how many of those along each axis; voxels: shape of the fine grid.
 * beyond, states: a face per column of them, (z, x); exits: a face per brick; as above.
 * bricks: flipped bits on entry, resolved ones on return; padding is cleared.
 * inside, middle_inside: bits of the coarse cells and of those in bricks, zero on entry.
 * doubts: (2,) uint32, added to: cells whose rays disagree, rays that end inside. */
__kernel void carry(
    const int4 voxels, TREE_PARAMETERS, const int4 columns, const int first_layer,
    const int layers, const uint first_brick, const __global uint *restrict beyond,
    const __global uint *restrict exits,
    __global uint *restrict states, __global uint *restrict bricks,
    __global uint *restrict inside, __global uint *restrict middle_inside,
    __global uint *restrict doubts)
{
    const ulong id = get_global_id(0);
    if (id >= (ulong)columns.x * layers) return;
    ulong number = id;
    const int x = take_place(&number, columns.x);
    const int z = first_layer + (int)number;
    const bool first_column = place_in(x, MIDDLE_X) == 0 && place_in(z, MIDDLE_Z) == 0;
    __global uint *face = states + id * FACE_WORDS;
    uint disagreements = 0;
    /* The state is in the face after a brick (`faced`), else in `uniform`. */
    bool faced = true;
    bool uniform = false;

    for (int top = 0; top < cells.y; ++top) {
        const ulong word = cell_word(cells, x / MIDDLE_X, top, z / MIDDLE_Z);
        const uint bit = x / MIDDLE_X % 32;
        if (!(boundary[word] >> bit & 1)) {
            if (faced) {
                uniform = face[0] & 1;
                disagreements += !is_uniform(face);
                faced = false;
            }
            if (uniform && first_column) atomic_or(inside + word, 1u << bit);
            continue;
        }
        const uint node = rank_of(boundary, rank, word, bit);
        for (int y = top * MIDDLE_Y; y < min((top + 1) * MIDDLE_Y, columns.y); ++y) {
            const ulong at = middle_bit(node, x, y, z);
            const ulong middle_word = at / 32;
            if (!(middle[middle_word] >> (at % 32) & 1)) {
                if (faced) {
                    uniform = face[0] & 1;
                    disagreements += !is_uniform(face);
                    faced = false;
                }
                if (uniform) atomic_or(middle_inside + middle_word, 1u << (at % 32));
                continue;
            }
            const ulong brick = rank_of(middle, middle_rank, middle_word, at % 32);
            if (!faced) fill_face(face, uniform);
            faced = true;
            const int3 sides = (int3)(BRICK_X, BRICK_Y, BRICK_Z);
            walk_brick(bricks + brick * BRICK_WORDS, face,
                       exits + (brick - first_brick) * FACE_WORDS,
                       min(voxels.xyz - (int3)(x, y, z) * sides, sides));
        }
    }

    uint odd = 0;
    if (!faced) fill_face(face, uniform);
    for (uint w = 0; w < FACE_WORDS; ++w) odd += popcount(face[w] ^ beyond[id * FACE_WORDS + w]);
    if (disagreements) atomic_add(doubts, disagreements);
    if (odd) atomic_add(doubts + 1, odd);
}

#endif
