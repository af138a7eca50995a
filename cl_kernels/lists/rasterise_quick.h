/*
 * lists/rasterise_quick.h: depths of the crossings with a triangle that is not too large.
 *
 * What crossings/rasterise.h computes with a float estimate and an exact residual, for triangles of
 * few bits by one division.  Which of 8 x 8 rays are covered is found first, row by row and without
 * a branch; then those are done one after the other.  So one branch to a block is not foreseen,
 * instead of two to a row.
 *
 * The depth of a crossing behind the nearest corner is N / area, where N is the sum of the three
 * weights times the corners' depths.  It changes by a constant from ray to ray, and on a covered
 * ray it is at most area * Z, Z being the triangle's extent in depth; where it is not covered N may
 * be anything, and nobody looks.
 */
#include "lists/divide.h"

#define DIGITS (FRACTION_BITS - STEP_BITS)

/* Does lists/divide.h do, with N * 2^DIGITS for n? */
static inline bool is_quick(const Facet f)
{
    const int low = min(min(f.a.z, f.b.z), f.c.z);
    const int high = max(max(f.a.z, f.b.z), f.c.z);
    /* One bit is left for the rounding of the floats. */
    return high - low < 1 << (28 - DIGITS)
        && (float)f.area * (float)(high - low) < (float)(1L << (62 - DIGITS));
}

/* Those lanes of 0 and 1 as bits; lane 0 is bit 0. */
static inline ulong bits_of(const uint8 lanes)
{
    return as_ulong(convert_uchar8(lanes)) * 0x0102040810204080UL >> 56;
}

/* The triangle is narrow and quick. */
static inline void rasterise_quick(Sink *sink, const Facet f, const int4 box)
{
    const int2 ab = f.b.xy - f.a.xy;
    const int2 bc = f.c.xy - f.b.xy;
    const int2 ca = f.a.xy - f.c.xy;
    const int2 p = box.xy << STEP_BITS;
    const long wa = (long)bc.x * (p.y - f.b.y) - (long)bc.y * (p.x - f.b.x);
    const long wb = (long)ca.x * (p.y - f.c.y) - (long)ca.y * (p.x - f.c.x);
    const long wc = (long)ab.x * (p.y - f.a.y) - (long)ab.y * (p.x - f.a.x);
    Lanes first = lanes_at(f, wa, wb, wc);

    const int low = min(min(f.a.z, f.b.z), f.c.z);
    const int high = max(max(f.a.z, f.b.z), f.c.z);
    const ulong za = (ulong)(long)(f.a.z - low) << DIGITS;
    const ulong zb = (ulong)(long)(f.b.z - low) << DIGITS;
    const ulong zc = (ulong)(long)(f.c.z - low) << DIGITS;
    ulong first_n = (ulong)wa * za + (ulong)wb * zb + (ulong)wc * zc;
    const ulong along_v
        = ((ulong)(long)bc.x * za + (ulong)(long)ca.x * zb + (ulong)(long)ab.x * zc) << STEP_BITS;
    const ulong along_u
        = ((ulong)(long)bc.y * za + (ulong)(long)ca.y * zb + (ulong)(long)ab.y * zc) << STEP_BITS;
    const ulong fast_n = FAST_OF(-along_u, along_v), slow_n = SLOW_OF(-along_u, along_v);
    const ulong area = (ulong)f.area;
    const Divisor divisor = divisor_of(area, area * (((ulong)(high - low) << DIGITS) + 2));
    const uint base = (uint)low << DIGITS;
    const uint tie = (uint)tie_bit(f);

    const int width = FAST_OF(box.z - box.x, box.w - box.y);
    const int height = SLOW_OF(box.z - box.x, box.w - box.y);
    const int first_row = SLOW_OF(box.x, box.y) - sink->slow;
    const int first_ray = FAST_OF(box.x, box.y) - sink->fast;
    for (int right = 0; right <= width; right += RAY_LANES) {
        const ulong within = (2UL << min(width - right, RAY_LANES - 1)) - 1;
        Lanes at = first;
        ulong block_n = first_n;
        for (int down = 0; down <= height; down += RAY_LANES) {
            ulong covered = 0;
            for (int row = 0; row <= min(height - down, RAY_LANES - 1); ++row) {
                covered |= (bits_of(covered_lanes(at)) & within) << (RAY_LANES * row);
                step_slow(&at);
            }
            __local uint *next = sink->next + (first_row + down) * TILE_WIDE + (first_ray + right);
            const __local ulong *bases = sink->bases + (first_row + down);
            while (covered != 0) {
                const uint bit = 63 - (uint)clz(covered);
                covered ^= 1UL << bit;
                const uint row = bit / RAY_LANES, ray = bit % RAY_LANES;
                const ulong n = block_n + row * slow_n + ray * fast_n;
                put(sink, next + row * TILE_WIDE + ray, bases[row],
                    (int)(base + quotient_up(divisor, n, tie)));
            }
            block_n += RAY_LANES * slow_n;
        }
        step_fast(&first);
        first_n += RAY_LANES * fast_n;
    }
}
