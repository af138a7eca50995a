/*
 * boundary/block.h: the cells that a small triangle touches, as bits.
 *
 * A block is 8 x 8 x 8 cells; a triangle's box lies within one, or within a few.  A cell is touched
 * iff it lies in the three shadows, along x, y and z, and the plane passes through it: the tests of
 * boundary/overlap.h.  Of a row along x each of these keeps the cells from a first to a last, or
 * all, or none: so a row is a byte, eight rows lie in lanes, and no branch depends on what is
 * touched.
 *
 * Coordinates are steps from the lowest corner of a block.  Those of a triangle and of the cells
 * lie within 2^20 of each other: components of the normal are then within 2^40, terms of the plane
 * below 2^62.  From cell to cell what tells on which side of a shadow's edge they lie changes by
 * multiples of 2^STEP_BITS: the bits below are cut off, downwards, so that no sign changes.  Of a
 * triangle within one block, of cells of at most 64 voxels, at most 2^29 + 2^27 + 2^30 is left; of
 * a larger one, within WIDEST_STEPS, at most 2^30 + 2^26 + 2^29: less than 2^31.
 *
 * Defines:    STEP_BITS, CELL_*  (boundary/overlap.h)
 */
#ifndef CLVOX_BLOCK_H
#define CLVOX_BLOCK_H

#include "boundary/overlap.h"

#define BLOCK 8
#define LARGEST_SIDE max(CELL_X, max(CELL_Y, CELL_Z))
#define BLOCKS_FIT (LARGEST_SIDE <= 64 && LARGEST_SIDE << STEP_BITS <= 1 << 17)

/* So many cells further along an axis than its first one the last may be of a triangle that has
 * more than one block: they reach 7 cells beyond its box on either side. */
#define WIDEST_STEPS (1 << min(20, 15 + (STEP_BITS - 1) / 2))
#define WIDEST min(64, WIDEST_STEPS / (LARGEST_SIDE << STEP_BITS) - 16)

/* So many blocks take about as long as 64 columns of cells. */
#define MOST_BLOCKS 64

#define LANE ((int8)(0, 1, 2, 3, 4, 5, 6, 7))
#define EACH_BYTE 0x0101010101010101UL

/* first: the cell in the corner of the block, which may lie outside of the grid; from, to: the
 * cells of it that lie in the triangle's box and the grid; faces: for each z of the block from
 * from.z to to.z, a byte for each y, and in it a bit for each x. */
typedef struct {
    int3 first, from, to;
    ulong faces[BLOCK];
} Block;

/* A side of a shadow in the projection (p, q): the cell (p, q) of the block is not wholly outside
 * of it iff start + p * step_p + q * step_q >= 0. */
typedef struct {
    int start, step_p, step_q;
} Line;

static inline long cross_of(const int2 a, const int2 b)
{
    return (long)a.x * b.y - (long)a.y * b.x;
}

/* cross: that of the corner before the side, and of the one `d` further; turn: twice the shadow's
 * area, negative if it lies to the right of its sides. */
static inline Line make_line(const long cross, const int2 d, const long turn, const int2 cell)
{
    const bool right = turn < 0;
    Line line;
    line.step_p = (right ? d.y : -d.y) * cell.x;
    line.step_q = (right ? -d.x : d.x) * cell.y;
    line.start = (int)((right ? -cross : cross) >> STEP_BITS)
               + max(line.step_p, 0) + max(line.step_q, 0);
    return line;
}

/* The sides of the shadow of a, b, c; cell: the sides of one, in voxels.  Returns twice its
 * area. */
static inline long make_lines(
    Line *lines, const int2 a, const int2 b, const int2 c, const int2 cell)
{
    const long ab = cross_of(a, b), bc = cross_of(b, c), ca = cross_of(c, a);
    const long turn = ab + bc + ca;
    lines[0] = make_line(ab, b - a, turn, cell);
    lines[1] = make_line(bc, c - b, turn, cell);
    lines[2] = make_line(ca, a - c, turn, cell);
    return turn;
}

/* A byte for each q, and in it a bit for each p up to `last`: the cells that a shadow touches. */
static inline ulong shadow_of(const Line *lines, const int last)
{
    int8 a = lines[0].start + lines[0].step_q * LANE;
    int8 b = lines[1].start + lines[1].step_q * LANE;
    int8 c = lines[2].start + lines[2].step_q * LANE;
    int8 outside = 0;
    for (int p = 0; p <= last; ++p) {
        outside |= ((a | b | c) >> 31) & (1 << p);
        a += lines[0].step_p;
        b += lines[1].step_p;
        c += lines[2].step_p;
    }
    return ~as_ulong(convert_uchar8(outside));
}

/* Are all cells of a block wholly outside of one side of a shadow? */
static inline bool misses(const Line *lines)
{
    int inside = 0;
    for (int i = 0; i < 3; ++i)
        inside |= lines[i].start
                + (BLOCK - 1) * (max(lines[i].step_p, 0) + max(lines[i].step_q, 0));
    return inside < 0;
}

/* How many of the multiples 0, d, 2 d, ... 8 d are less than x, for d >= 0; `inverse` is that of d,
 * or large if d is 0.
 * The quotient in float32 is within 2^-17 of the true one, if that lies between -1 and 9, so the
 * multiple nearest to it is off by less than d: one exact look at it tells. */
static inline int8 multiples_below(const long8 x, const long d, const float inverse)
{
    const int8 nearest = convert_int8(clamp(convert_float8(x) * inverse, 0.0f, 8.0f) + 0.5f);
    return nearest - convert_int8(convert_long8(nearest) * d < x);
}

/* The first so many bits. */
static inline int8 low_bits(const int8 count)
{
    return ((int8)(1) << count) - 1;
}

/* Is the box of a triangle within one block?  more: by how many cells it is longer than one. */
static inline bool fits_block(const int3 more)
{
    return max(more.x, max(more.y, more.z)) < BLOCK;
}

/* Is the triangle done soonest in blocks?  If there is one; or if there are few, and its widest
 * shadow has as many cells as its box has blocks: most of those are then looked at for
 * something. */
static inline bool suits_blocks(const int3 a, const int3 b, const int3 c, const int3 more)
{
    if (fits_block(more)) return true;
    if (max(more.x, max(more.y, more.z)) > WIDEST) return false;
    const int3 blocks = more / BLOCK + 2;
    const int count = blocks.x * blocks.y * blocks.z;
    if (count > MOST_BLOCKS) return false;
    const float x = fabs((float)cross2(a.yz, b.yz, c.yz)) * (1.0f / (CELL_Y * CELL_Z));
    const float y = fabs((float)cross2(a.zx, b.zx, c.zx)) * (1.0f / (CELL_Z * CELL_X));
    const float z = fabs((float)cross2(a.xy, b.xy, c.xy)) * (1.0f / (CELL_X * CELL_Y));
    return max(x, max(y, z)) * (0.5f / (1 << STEP_BITS) / (1 << STEP_BITS)) > (float)count;
}

/* The cells of a block, where BLOCKS_FIT, that the triangle touches whose corners are given.
 * Returns false, having looked at none, if the block is not `alone` and lies wholly beyond a side
 * of a shadow or the plane. */
static inline bool fill_block(
    Block *block, const int3 corner_a, const int3 corner_b, const int3 corner_c, const bool alone)
{
    const int3 corner = block->first * CELL_SIDES - HALF_STEP;
    const int3 a = corner_a - corner, b = corner_b - corner, c = corner_c - corner;
    const int3 from = block->from - block->first, to = block->to - block->first;
    Line xy[3], xz[3], yz[3];
    const long turn_xy = make_lines(xy, a.xy, b.xy, c.xy, (int2)(CELL_X, CELL_Y));
    const long turn_xz = make_lines(xz, a.xz, b.xz, c.xz, (int2)(CELL_X, CELL_Z));
    const long turn_yz = make_lines(yz, a.yz, b.yz, c.yz, (int2)(CELL_Y, CELL_Z));
    if (!alone && (misses(xy) | misses(xz) | misses(yz))) return false;
    /* Of the block, the box in the grid has the bytes from.y to to.y, and of these the bits from.x
     * to to.x. */
    const ulong box = ((2u << to.x) - (1u << from.x)) * EACH_BYTE
                    & ~0UL << 8 * from.y & ~0UL >> (56 - 8 * to.y);
    const ulong rows_xy = shadow_of(xy, to.x) & box;
    const ulong rows_xz = shadow_of(xz, to.x);
    int8 side_a = yz[0].start + from.z * yz[0].step_q + yz[0].step_p * LANE;
    int8 side_b = yz[1].start + from.z * yz[1].step_q + yz[1].step_p * LANE;
    int8 side_c = yz[2].start + from.z * yz[2].step_q + yz[2].step_p * LANE;

    /* With a normal that does not point down x, the plane passes through the cell x of a row iff
     * (x + 1) * across >= near, for the corner furthest along it, and x * across < near + thick,
     * for the one opposite. */
    const long nx = turn_yz < 0 ? -turn_yz : turn_yz;
    const long ny = turn_yz < 0 ? turn_xz : -turn_xz;
    const long nz = turn_yz < 0 ? -turn_xy : turn_xy;
    const long across = nx * (CELL_X << STEP_BITS);
    const long along_y = ny * (CELL_Y << STEP_BITS);
    const long along_z = nz * (CELL_Z << STEP_BITS);
    const float inverse = across == 0 ? 1e18f : 1.0f / (float)across;
    const long thick = (long)(abs(along_y) + abs(along_z)) + 1;
    const long level = nx * a.x + ny * a.y + nz * a.z;
    const long nearest = level - BLOCK * (max(along_y, 0L) + max(along_z, 0L));
    if (!alone && (nearest > BLOCK * across || nearest + BLOCK * (thick - 1) < 0)) return false;
    long8 near = level - max(along_y, 0L) - max(along_z, 0L) - from.z * along_z
               - along_y * convert_long8(LANE);
    for (int z = from.z; z <= to.z; ++z) {
        const int8 before = low_bits(multiples_below(near, across, inverse)) >> 1;
        const int8 up_to = low_bits(multiples_below(near + thick, across, inverse));
        const int8 outside = (side_a | side_b | side_c) >> 31;
        const int8 row = up_to & ~before & ~outside & (int)(rows_xz >> 8 * z & 255);
        block->faces[z] = as_ulong(convert_uchar8(row)) & rows_xy;
        side_a += yz[0].step_q;
        side_b += yz[1].step_q;
        side_c += yz[2].step_q;
        near -= along_z;
    }
    return true;
}

#endif
