/*
 * multilevel/carry_columns.cl: from flipped bits to solid bricks and inside cells, a coarse cell
 * at a time.
 *
 * What carry.cl does for any model, for those of three levels whose middle one has bricks of
 * 8 x 8 x 8: a layer of cells there is one long, and its bricks of voxels, which follow each other,
 * are walked in one loop.  A row of 8 cells is so short that nobody could foresee where its loops
 * end; and what a coarse cell has of everything is read once, and in order.
 *
 * Host:       clvox/ops/multilevel.py, carry()
 * Reference:  clvox/reference/multilevel.py, build()
 * Tests:      tests/kernels/test_multilevel.py
 * Defines:    LEVELS     3
 *             BRICK_*    4 or 8, all alike (multilevel/pass.h)
 *             MIDDLE_*   8 (common/bricks.h)
 */
#include "multilevel/pass.h"

#define LANES 8
#define DEPTH MIDDLE_Z

/* The states of the rays of 8 neighbouring rows of cells of the middle level. */
typedef struct {
    ulong state[LANES];
    uint loose;          /* the lanes whose last cell is untouched: its rays must agree */
    uint disagreements;
} Lanes;

/* The state of a lane; behind untouched cells its rays follow the first, and any that do not are
 * counted as one disagreement. */
static inline ulong agreed(Lanes *lanes, const ulong state, const bool untouched)
{
    const ulong uniform = state & 1 ? WHOLE_FACE : 0;
    const bool disagree = untouched && state != uniform;
    lanes->disagreements += disagree;
    return disagree ? uniform : state;
}

/* A bit for each lane: the side on which the first of its rays is. */
static inline ulong sides_of(const Lanes *lanes)
{
    ulong sides = 0;
    for (int lane = 0; lane < LANES; ++lane) sides |= (lanes->state[lane] & 1) << lane;
    return sides;
}

/* Each of the 64 cells takes the bit of the cell before it along y, or of `first`, where it is not
 * `fixed` itself. */
static inline ulong follow(const ulong bits, const ulong fixed, const ulong first)
{
    ulong known = fixed, found = bits & fixed;
    for (int shift = 8; shift < 64; shift *= 2) {
        found |= found << shift & ~known;
        known |= known << shift;
    }
    return found | (first * 0x0101010101010101UL & ~known);
}

/* Past 64 cells (8 along x, 8 along y), of which `touched` have bricks, which follow each other;
 * returns which of the others are inside.
 * room: voxels from the lowest corner of the first cell to the end of the grid. */
static inline ulong pass_layer(
    Lanes *lanes, const ulong touched, __global uint *bricks, const __global uint *exits,
    const int3 room)
{
    const ulong first = sides_of(lanes);
    const bool clipped = room.x < 8 * BRICK_X || room.y < 8 * BRICK_Y || room.z < BRICK_Z;
    const ulong behind = touched & ~(touched << 8 | (~lanes->loose & 0xff));
    ulong after = 0;
    for (ulong left = touched; left; left &= left - 1) {
        const int cell = (int)popcount((left & -left) - 1);
        const int lane = cell % 8;
        const ulong state = agreed(lanes, lanes->state[lane], behind >> cell & 1);
        const ulong next = pass_brick(bricks, exits, state);
        if (clipped)
            clip_brick(bricks, room - (int3)(lane * BRICK_X, cell / 8 * BRICK_Y, 0));
        lanes->state[lane] = next;
        after |= (next & 1) << cell;
        bricks += BRICK_WORDS;
        exits += FACE_WORDS;
    }
    return follow(after, touched, first) & ~touched;
}

/* The layers of a coarse cell: their lanes start with what is in their faces, at `entry`.
 * count: of rows of cells along x; row: columns of cells in a row of them. */
static inline void start_lanes(
    Lanes *layers, const int depth, const int count, const int row, const __global uint *entry)
{
    for (int layer = 0; layer < depth; ++layer) {
        Lanes *lanes = layers + layer;
        for (int lane = 0; lane < LANES; ++lane)
            lanes->state[lane] = lane < count ? load_face(entry + lane * FACE_WORDS) : 0;
        lanes->loose = 0;
        lanes->disagreements = 0;
        entry += (ulong)row * FACE_WORDS;
    }
}

/* Tells of cells whose rays disagree, and of rays that end inside: those whose state is not that
 * of `beyond`. */
static inline void tell_doubts(
    Lanes *layers, const int depth, const int count, const int row, const __global uint *beyond,
    __global uint *doubts)
{
    uint disagreements = 0, odd = 0;
    for (int layer = 0; layer < depth; ++layer) {
        Lanes *lanes = layers + layer;
        for (int lane = 0; lane < count; ++lane) {
            const ulong state = agreed(lanes, lanes->state[lane], lanes->loose >> lane & 1);
            odd += (uint)popcount(state ^ load_face(beyond + lane * FACE_WORDS));
        }
        disagreements += lanes->disagreements;
        beyond += (ulong)row * FACE_WORDS;
    }
    if (disagreements) atomic_add(doubts, disagreements);
    if (odd) atomic_add(doubts + 1, odd);
}

/* One work-item walks along y one row of coarse cells.
 * columns: how many cells of the middle level along each axis; voxels: shape of the fine grid.
 * The tree above the bricks: common/bricks.h.
 * Walked is a slab: so many layers of cells along z from first_layer on, whose bricks begin with
 * first_brick.
 * beyond, entry: a face per column of them of the slab, (z, x): crossings past the last and before
 * the first sample; exits: a face per brick of the slab: crossings behind the last sample of its
 * cell.
 * bricks: flipped bits on entry, resolved ones on return; padding is cleared.
 * inside, middle_inside: bits of the coarse cells and of those in bricks, zero on entry.
 * doubts: (2,) uint32, added to: cells whose rays disagree, rays that end inside. */
__kernel void carry_columns(
    const int4 voxels, TREE_PARAMETERS, const int4 columns, const int first_layer,
    const int layers, const uint first_brick, const __global uint *restrict beyond,
    const __global uint *restrict exits,
    const __global uint *restrict entry, __global uint *restrict bricks,
    __global uint *restrict inside, __global uint *restrict middle_inside,
    __global uint *restrict doubts)
{
    const ulong id = get_global_id(0);
    if (id >= (ulong)cells.x * ((layers - 1) / DEPTH + 1)) return;
    ulong number = id;
    const int cell_x = take_place(&number, cells.x);
    const int x = cell_x * LANES;
    const int z = first_layer + (int)number * DEPTH;
    const int count = min(LANES, columns.x - x);
    const int depth = min(DEPTH, columns.z - z);
    const ulong column = (number * DEPTH * columns.x + x) * FACE_WORDS;
    const ulong lanes_there = ((1UL << count) - 1) * 0x0101010101010101UL;
    const uint bit = (uint)cell_x % 32;
    Lanes lanes[DEPTH];
    start_lanes(lanes, depth, count, columns.x, entry + column);

    for (int top = 0; top < cells.y; ++top) {
        const ulong word = cell_word(cells, cell_x, top, z / DEPTH);
        if (!(boundary[word] >> bit & 1)) {
            for (int layer = 0; layer < depth; ++layer) lanes[layer].loose = 0xff;
            if (lanes[0].state[0] & 1) atomic_or(inside + word, 1u << bit);
            continue;
        }
        const int rows = min(8, columns.y - top * 8);
        const ulong there = lanes_there & (~0UL >> (64 - 8 * rows));
        const ulong node = rank_of(boundary, rank, word, bit);
        ulong brick = rank_of(middle, middle_rank, node * MIDDLE_WORDS, 0);
        for (int layer = 0; layer < depth; ++layer) {
            const ulong at = node * MIDDLE_WORDS + 2 * layer;
            const ulong touched = upsample(middle[at + 1], middle[at]);
            const ulong found = there & pass_layer(
                lanes + layer, touched, bricks + brick * BRICK_WORDS,
                exits + (brick - first_brick) * FACE_WORDS,
                voxels.xyz - (int3)(x * BRICK_X, top * 8 * BRICK_Y, (z + layer) * BRICK_Z));
            middle_inside[at] = (uint)found;
            middle_inside[at + 1] = (uint)(found >> 32);
            lanes[layer].loose = ~(uint)(touched >> (8 * (rows - 1))) & 0xff;
            brick += popcount(touched);
        }
    }

    tell_doubts(lanes, depth, count, columns.x, beyond + column, doubts);
}
