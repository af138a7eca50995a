/*
 * multilevel/carry.cl: from flipped bits to solid bricks and inside cells.
 *
 * A flipped bit says "from here on, the other side".  Each row of cells is walked along y with the
 * state of its fine rays, one bit per ray: through a brick by a running xor, past a cell without
 * one unchanged.
 *
 * Host:       clvox/ops/multilevel.py, carry()
 * Reference:  clvox/reference/multilevel.py, build()
 * Tests:      tests/kernels/test_multilevel.py
 * Defines:    LEVELS, BRICK_*, MIDDLE_*  of the model (common/bricks.h)
 */
#include "multilevel/lanes.h"

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
    const ulong column = number * cells.x + 32 * word_x;
    Lanes lanes = start_lanes(states + column * FACE_WORDS, min(cells.x - 32 * word_x, 32));

    for (int y = 0; y < cells.y; ++y) {
        const ulong word = cell_word(cells, 32 * word_x, y, z);
        const uint touched = boundary[word];
        inside[word] = pass_cells(&lanes, touched);
        if (!touched) continue;
        const uint brick = rank_of(boundary, rank, word, 0);
        pass_bricks(&lanes, touched, bricks + (ulong)brick * BRICK_WORDS,
                    exits + (ulong)(brick - first_brick) * FACE_WORDS,
                    voxels.xyz - (int3)(32 * word_x * BRICK_X, y * BRICK_Y, z * BRICK_Z));
    }

    const uint odd = count_odd(&lanes, beyond + column * FACE_WORDS);
    if (lanes.disagreements) atomic_add(doubts, lanes.disagreements);
    if (odd) atomic_add(doubts + 1, odd);
}

#else

/* One work-item walks along y the rows of cells of the middle level that lie in one row of bricks
 * of them: side by side along x, 32 at the most.
 * columns: how many cells of the middle level along each axis; voxels: shape of the fine grid.
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
    const int parts = (int)words_in_row(MIDDLE_X);
    const ulong id = get_global_id(0);
    if (id >= (ulong)cells.x * parts * layers) return;
    ulong number = id;
    const int part = take_place(&number, parts);
    const int cell_x = take_place(&number, cells.x);
    const int z = first_layer + (int)number;
    const int x = cell_x * MIDDLE_X + 32 * part;
    const int count = min(min(MIDDLE_X - 32 * part, 32), columns.x - x);
    if (count <= 0) return;
    const bool first_row = part == 0 && place_in(z, MIDDLE_Z) == 0;
    const ulong column = number * columns.x + x;
    Lanes lanes = start_lanes(states + column * FACE_WORDS, count);

    for (int top = 0; top < cells.y; ++top) {
        const ulong word = cell_word(cells, cell_x, top, z / MIDDLE_Z);
        const uint bit = (uint)cell_x % 32;
        if (!(boundary[word] >> bit & 1)) {
            const uint found = pass_cells(&lanes, 0);
            if (first_row && (found & 1)) atomic_or(inside + word, 1u << bit);
            continue;
        }
        const uint node = rank_of(boundary, rank, word, bit);
        for (int y = top * MIDDLE_Y; y < min((top + 1) * MIDDLE_Y, columns.y); ++y) {
            const ulong at = middle_bit(node, x, y, z);
            const uint shift = at % 32;
            const uint touched = get_bits(middle + at / 32, shift, count);
            const ulong found = (ulong)pass_cells(&lanes, touched) << shift;
            if ((uint)found) atomic_or(middle_inside + at / 32, (uint)found);
            if (found >> 32) atomic_or(middle_inside + at / 32 + 1, (uint)(found >> 32));
            if (!touched) continue;
            const uint brick = rank_of(middle, middle_rank, at / 32, shift);
            pass_bricks(&lanes, touched, bricks + (ulong)brick * BRICK_WORDS,
                        exits + (ulong)(brick - first_brick) * FACE_WORDS,
                        voxels.xyz - (int3)(x * BRICK_X, y * BRICK_Y, z * BRICK_Z));
        }
    }

    const uint odd = count_odd(&lanes, beyond + column * FACE_WORDS);
    if (lanes.disagreements) atomic_add(doubts, lanes.disagreements);
    if (odd) atomic_add(doubts + 1, odd);
}

#endif
