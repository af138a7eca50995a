/*
 * update/decide_cells.cl: the cells without a brick after an edit.
 *
 * A voxel is inside if the model before and the flips differ there.  The cells that need a brick
 * are known.  A cell that loses its brick was touched by triangles that changed and by no others,
 * so that the flips have a brick there, too; as it is touched no more, any of its voxels tells.
 *
 * Host:       clvox/ops/update.py, _flip()
 * Reference:  clvox/reference/multilevel.py, build(), of the edited mesh
 * Tests:      tests/kernels/test_update.py
 * Defines:    LEVELS = 2, BRICK_*  of the models (common/bricks.h)
 */
#include "common/bricks.h"

static inline uint first_voxel(
    const __global uint *boundary, const __global uint *rank, const __global uint *bricks,
    const ulong word, const int lane)
{
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
    uint bits = (inside_a[word] ^ inside_b[word]) & ~needed[word];
    for (uint lost = boundary_a[word] & ~needed[word]; lost; lost &= lost - 1) {
        const int lane = popcount((lost & -lost) - 1);
        bits |= (first_voxel(boundary_a, rank_a, bricks_a, word, lane)
                 ^ first_voxel(boundary_b, rank_b, bricks_b, word, lane)) << lane;
    }
    inside[word] = bits;
}
