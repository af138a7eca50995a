/*
 * boundary/block.h: the cells that a small triangle touches, row by row.
 */
#ifndef CLVOX_BLOCK_H
#define CLVOX_BLOCK_H

#include "common/corners.h"
#include "boundary/overlap.h"

#define LARGEST_CELL max(CELL_X, max(CELL_Y, CELL_Z))
#define BLOCK 8
#define EVERY_BYTE 0x0101010101010101UL
#define PLACES ((int8)(0, 1, 2, 3, 4, 5, 6, 7))

typedef struct {
    int3 first, from, to;
    ulong faces[BLOCK];
} Block;

typedef struct { int start, step_p, step_q; } Edge;

static inline Edge make_edge(const long cross, const int dp, const int dq, const long turn, const int cp, const int cq)
{
    const bool back = turn < 0;
    const int p = back ? dq * cp : -dq * cp;
    const int q = back ? -dp * cq : dp * cq;
    Edge e;
    e.step_p = p;
    e.step_q = q;
    e.start = (int)((back ? -cross : cross) >> STEP_BITS) + max(p, 0) + max(q, 0);
    return e;
}

/* A byte for each lane, with a bit for each of count steps. */
static inline ulong shadow(const Edge a, const Edge b, const Edge c, const int count, const bool by_q)
{
    int8 ea = a.start + PLACES * (by_q ? a.step_q : a.step_p);
    int8 eb = b.start + PLACES * (by_q ? b.step_q : b.step_p);
    int8 ec = c.start + PLACES * (by_q ? c.step_q : c.step_p);
    const int sa = by_q ? a.step_p : a.step_q, sb = by_q ? b.step_p : b.step_q, sc = by_q ? c.step_p : c.step_q;
    int8 out = 0;
    for (int i = 0; i < count; ++i) {
        out |= ((ea | eb | ec) >> 31) & (1 << i);
        ea += sa;
        eb += sb;
        ec += sc;
    }
    return ~as_ulong(convert_uchar8(out));
}

static inline int8 places_before(const long8 x, const long d, const float inverse)
{
    const float8 t = clamp(convert_float8(x) * inverse, 0.0f, 8.0f);
    const int8 m = convert_int8(t + 0.5f);
    return m - convert_int8(convert_long8(m) * d < x);
}

/* from, to: the cells of its box in the grid, relative to first; */
static inline void fill_block(Block *block, const int3 a0, const int3 b0, const int3 c0)
{
    const int3 first = block->first, from = block->from, to = block->to;
    const int3 origin = first * CELL_SIDES - HALF_STEP;
    const int3 a = a0 - origin, b = b0 - origin, c = c0 - origin;
    const int3 ab = b - a, bc = c - b, ca = a - c;
    const long abx = (long)a.y * b.z - (long)a.z * b.y;
    const long aby = (long)a.z * b.x - (long)a.x * b.z;
    const long abz = (long)a.x * b.y - (long)a.y * b.x;
    const long bcx = (long)b.y * c.z - (long)b.z * c.y;
    const long bcy = (long)b.z * c.x - (long)b.x * c.z;
    const long bcz = (long)b.x * c.y - (long)b.y * c.x;
    const long cax = (long)c.y * a.z - (long)c.z * a.y;
    const long cay = (long)c.z * a.x - (long)c.x * a.z;
    const long caz = (long)c.x * a.y - (long)c.y * a.x;
    long nx = abx + bcx + cax, ny = aby + bcy + cay, nz = abz + bcz + caz;
    const int3 low = from - first, high = to - first;
    /* xy: p = x, q = y */
    const ulong xy = shadow(make_edge(abz, ab.x, ab.y, nz, CELL_X, CELL_Y),
                            make_edge(bcz, bc.x, bc.y, nz, CELL_X, CELL_Y),
                            make_edge(caz, ca.x, ca.y, nz, CELL_X, CELL_Y), high.x + 1, true)
                   & (((2u << high.x) - (1u << low.x)) * EVERY_BYTE)
                   & (~0UL << 8 * low.y) & (~0UL >> (56 - 8 * high.y));
    /* zx: p = z, q = x */
    const ulong zx = shadow(make_edge(aby, ab.z, ab.x, ny, CELL_Z, CELL_X),
                            make_edge(bcy, bc.z, bc.x, ny, CELL_Z, CELL_X),
                            make_edge(cay, ca.z, ca.x, ny, CELL_Z, CELL_X), high.x + 1, false);
    /* yz: p = y, q = z */
    const Edge ea = make_edge(abx, ab.y, ab.z, nx, CELL_Y, CELL_Z);
    const Edge eb = make_edge(bcx, bc.y, bc.z, nx, CELL_Y, CELL_Z);
    const Edge ec = make_edge(cax, ca.y, ca.z, nx, CELL_Y, CELL_Z);
    if (nx < 0) {
        nx = -nx;
        ny = -ny;
        nz = -nz;
    }
    const long side_x = CELL_X << STEP_BITS, side_y = CELL_Y << STEP_BITS, side_z = CELL_Z << STEP_BITS;
    const long d = nx * side_x;
    const float inverse = nx ? 1.0f / (float)d : 1e18f;
    const long thick = 1 + (long)abs(ny) * side_y + (long)abs(nz) * side_z;
    const long x0 = nx * a.x + ny * a.y + nz * a.z - max(ny, 0L) * side_y - max(nz, 0L) * side_z - nz * side_z * low.z;
    long8 x = x0 - convert_long8(PLACES) * (ny * side_y);
    int8 va = ea.start + low.z * ea.step_q + PLACES * ea.step_p;
    int8 vb = eb.start + low.z * eb.step_q + PLACES * eb.step_p;
    int8 vc = ec.start + low.z * ec.step_q + PLACES * ec.step_p;
    for (int k = low.z; k <= high.z; ++k) {
        const int8 before = places_before(x, d, inverse);
        const int8 to_last = places_before(x + thick, d, inverse);
        const int8 out = ((va | vb | vc) >> 31) | ((((int8)(1) << before) - 1) >> 1);
        const int8 in = (((int8)(1) << to_last) - 1) & ~out & (int)(zx >> 8 * k & 255);
        const ulong row = as_ulong(convert_uchar8(in)) & xy;
        block->faces[k] = row;
        va += ea.step_q;
        vb += eb.step_q;
        vc += ec.step_q;
        x -= nz * side_z;
    }
}
#endif
