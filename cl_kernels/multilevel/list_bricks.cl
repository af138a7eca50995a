/*
 * multilevel/list_bricks.cl: the cell of each brick, the inverse of the rank.
 *
 * Host:       clvox/ops/multilevel.py, list_bricks()
 * Reference:  numpy.nonzero of the boundary bits
 * Tests:      tests/kernels/test_multilevel.py
 * Defines:    BRICK_X, BRICK_Y, BRICK_Z  cells along the sides of a brick of cells, for
 *                                        list_below; 1 for list_coarse
 */
#include "common/bricks.h"
#include "common/index.h"

/* One work-item lists the boundary cells of one word of the coarse grid.
 * cells: shape of the grid.  owners: (bricks, 3) int32, (x, y, z) of each brick's cell. */
__kernel void list_coarse(
    const int4 cells, const __global uint *restrict boundary, const __global uint *restrict rank,
    __global int *restrict owners)
{
    const int row_words = (cells.x + 31) / 32;
    const ulong id = get_global_id(0);
    if (id >= (ulong)row_words * cells.y * cells.z) return;
    ulong rest = id;
    const int first_x = 32 * take_place(&rest, row_words);
    const int y = take_place(&rest, cells.y);
    const int z = (int)rest;
    ulong brick = rank[id / 8];
    for (ulong w = id & ~7UL; w < id; ++w) brick += popcount(boundary[w]);
    for (uint left = boundary[id]; left; left &= left - 1, ++brick) {
        const int x = first_x + popcount((left & -left) - 1);
        vstore3((int3)(x, y, z), brick, owners);
    }
}

/* One work-item lists the boundary cells of one word of the bricks of cells.
 * above: (bricks above, 3) int32, the cell of each brick above.
 * owners: (bricks, 3) int32, in cells of this level. */
__kernel void list_below(
    const ulong words, const __global int *restrict above,
    const __global uint *restrict boundary, const __global uint *restrict rank,
    __global int *restrict owners)
{
    const ulong id = get_global_id(0);
    if (id >= words) return;
    const int3 sides = (int3)(BRICK_X, BRICK_Y, BRICK_Z);
    ulong owner = id;
    const int first = 32 * take_place(&owner, BRICK_WORDS);
    const int3 corner = vload3(owner, above) * sides;
    ulong brick = rank[id / 8];
    for (ulong w = id & ~7UL; w < id; ++w) brick += popcount(boundary[w]);
    for (uint left = boundary[id]; left; left &= left - 1, ++brick) {
        ulong rest = first + popcount((left & -left) - 1);
        const int x = take_place(&rest, BRICK_X);
        const int y = take_place(&rest, BRICK_Y);
        vstore3(corner + (int3)(x, y, (int)rest), brick, owners);
    }
}
