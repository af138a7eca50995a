/*
 * lists/rasterise_quick.h: depths of the crossings with a triangle that is not too large.
 *
 * What crossings/rasterise.h computes with a float estimate and an exact residual, for triangles of
 * few bits by one division.  Which of 8 x 8 rays are covered is found first, row by row and without
 * a branch; then they are done one after the other, so that one branch to a block is not foreseen,
 * where two to a row were.
 *
 * The depth of a crossing behind the nearest corner is N / area, where N is the sum of the three
 * weights times the corners' depths.  It changes by a constant from ray to ray, and on a covered
 * ray it is at most area * Z, Z being the triangle's extent in depth.  With n = N * 2^DIGITS below
 * 2^63, the quotient q = n / area is estimated from 32 bits of each: m = floor(n / 2^shift), and
 * inverse <= 2^(32 + scale) / area; none is too large, so the estimate is not.  q is below 2^28,
 * and m is at most 1 too small and of 32 bits if it is cut, the inverse at most 2^-29 of itself: so
 * the estimate, rounded down, is q rounded down, or one less.  What is left of n tells.
 */
#define DIGITS (FRACTION_BITS - STEP_BITS)

/* Is the quotient below 2^28, and n below 2^63? */
static inline bool is_quick(const Facet f)
{
    const int low = min(min(f.a.z, f.b.z), f.c.z);
    const int high = max(max(f.a.z, f.b.z), f.c.z);
    /* One bit is left for the rounding of the floats. */
    return high - low < 1 << (28 - DIGITS)
        && (float)f.area * (float)(high - low) < (float)(1L << (62 - DIGITS));
}

/* How quotients of n by the area are estimated: see above. */
typedef struct {
    ulong area;
    uint inverse;
    int shift, scale;
} Divisor;

/* most: n at most, and not below the area, so that no shift is as wide as what is shifted. */
static inline Divisor divisor_of(const ulong area, const ulong most)
{
    Divisor d;
    d.area = area;
    d.shift = max(32 - (int)clz(most), 0);
    const int cut = max(33 - (int)clz(area), 0);
    const ulong rounded = (area >> cut) + (cut > 0);
    const int bits = 64 - (int)clz(rounded);
    d.inverse = (uint)(((1UL << (31 + bits)) - 1) / rounded);
    d.scale = 31 + bits + cut - d.shift;
    return d;
}

/* n / area, rounded up, and one more if it is whole and `tie` is 1. */
static inline uint quotient_up(const Divisor d, const ulong n, const uint tie)
{
    const uint estimate = (uint)((n >> d.shift) * d.inverse >> d.scale);
    ulong left = n - estimate * d.area;
    const bool less = left >= d.area;
    left -= less ? d.area : 0;
    return estimate + less + (left != 0 ? 1u : tie);
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
    const Divisor divisor = divisor_of(area, area * (((ulong)(high - low) << DIGITS) + 1));
    const uint base = (uint)low << DIGITS;
    const uint tie = (uint)tie_bit(f);

    const int width = FAST_OF(box.z - box.x, box.w - box.y);
    const int height = SLOW_OF(box.z - box.x, box.w - box.y);
    const int first_row = SLOW_OF(box.x, box.y) - sink->slow;
    const int first_ray = FAST_OF(box.x, box.y) - sink->fast;
    for (int right = 0; right <= width; right += LANES) {
        const ulong within = (2UL << min(width - right, LANES - 1)) - 1;
        Lanes at = first;
        ulong block_n = first_n;
        for (int down = 0; down <= height; down += LANES) {
            ulong covered = 0;
            for (int row = 0; row <= min(height - down, LANES - 1); ++row) {
                covered |= (bits_of(covered_lanes(at)) & within) << (LANES * row);
                step_slow(&at);
            }
            __local uint *next = sink->next + (first_row + down) * WIDE + (first_ray + right);
            const __local ulong *bases = sink->bases + (first_row + down);
            while (covered != 0) {
                const uint bit = 63 - (uint)clz(covered);
                covered ^= 1UL << bit;
                const uint row = bit / LANES, ray = bit % LANES;
                const ulong n = block_n + row * slow_n + ray * fast_n;
                put(sink, next + row * WIDE + ray, bases[row],
                    (int)(base + quotient_up(divisor, n, tie)));
            }
            block_n += LANES * slow_n;
        }
        step_fast(&first);
        first_n += LANES * fast_n;
    }
}
