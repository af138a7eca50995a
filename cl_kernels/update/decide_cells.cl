/*
 * update/decide_cells.cl: the cells without a brick after an edit.
 *
 * A voxel is inside if the model before and the flips differ there.  The cells that need a brick
 * are known; in each of the others all voxels are alike, so that the first one tells, although the
 * model before or the flips may have a brick there.
 *
 * Host:       clvox/ops/update.py, _flip()
 * Reference:  clvox/reference/multilevel.py, build(), of the edited mesh
 * Tests:      tests/kernels/test_update.py
 * Defines:    LEVELS = 2, RULE = 0, BRICK_*  of the models (common/model.h)
 */
#include "common/model.h"

static inline uint first_voxel(
    const __global uint *boundary, const __global uint *rank, const __global uint *inside,
    const __global uint *bricks, const ulong word, const int lane)
{
    if (!(boundary[word] >> lane & 1)) return inside[word] >> lane & 1;
    return bricks[(ulong)rank_of(boundary, rank, word, lane) * BRICK_WORDS] & 1;
}

/* One work-item decides the 32 cells of one word.
 * boundary, rank, inside, bricks: of the model before (a) and of the flips (b).
 * needed: bits of cells with a brick.  inside: bits of cells inside, undefined on entry. */
__kernel void decide_cells(
    const ulong words,
    const __global uint *restrict boundary_a, const __global uint *restrict rank_a,
    const __global uint *restrict inside_a, const __global uint *restrict bricks_a,
    const __global uint *restrict boundary_b, const __global uint *restrict rank_b,
    const __global uint *restrict inside_b, const __global uint *restrict bricks_b,
    const __global uint *restrict needed, __global uint *restrict inside)
{
    const ulong word = get_global_id(0);
    if (word >= words) return;
    const uint open = (boundary_a[word] | boundary_b[word]) & ~needed[word];
    uint bits = (inside_a[word] ^ inside_b[word]) & ~needed[word] & ~open;
    for (uint left = open; left; left &= left - 1) {
        const int lane = popcount((left & -left) - 1);
        bits |= (first_voxel(boundary_a, rank_a, inside_a, bricks_a, word, lane)
                 ^ first_voxel(boundary_b, rank_b, inside_b, bricks_b, word, lane)) << lane;
    }
    inside[word] = bits;
}
