/*
 * lists/rasterise_quick.h: depths of the crossings with a triangle that is not too large.
 *
 * What crossings/rasterise.h computes with a float estimate and an exact residual, for triangles of
 * few bits by one division.  The depth of a crossing behind the nearest corner is N / area, where N
 * is the sum of the three weights times the corners' depths.  It changes by a constant from ray to
 * ray, and on a covered ray it is at most area * Z, Z being the triangle's extent in depth.  With
 * n = N * 2^DIGITS below 2^63 and r = floor((2^64 - 1) / area), the high word of n * r is n / area
 * rounded down, or one less: what is left of n tells.
 *
 * Where a ray is not covered N may be anything, modulo 2^64, and nobody looks at it.
 */
#define DIGITS (FRACTION_BITS - STEP_BITS)

static inline bool is_quick(const Facet f)
{
    const int low = min(min(f.a.z, f.b.z), f.c.z);
    const int high = max(max(f.a.z, f.b.z), f.c.z);
    /* One bit is left for the rounding of the floats. */
    return (float)f.area * (float)(high - low) < (float)(1L << (62 - DIGITS));
}

/* The triangle is narrow and quick. */
static inline void rasterise_quick(Sink *sink, const Facet f, const int4 box)
{
    const int2 ab = f.b.xy - f.a.xy;
    const int2 bc = f.c.xy - f.b.xy;
    const int2 ca = f.a.xy - f.c.xy;
    const int2 p = box.xy << STEP_BITS;
    const long ta = edge_owns(bc) ? 0 : 1;
    const long tb = edge_owns(ca) ? 0 : 1;
    const long tc = edge_owns(ab) ? 0 : 1;
    const long wa = (long)bc.x * (p.y - f.b.y) - (long)bc.y * (p.x - f.b.x);
    const long wb = (long)ca.x * (p.y - f.c.y) - (long)ca.y * (p.x - f.c.x);
    const long wc = (long)ab.x * (p.y - f.a.y) - (long)ab.y * (p.x - f.a.x);
    int row_a = (int)((wa - ta) >> STEP_BITS);
    int row_b = (int)((wb - tb) >> STEP_BITS);
    int row_c = (int)((wc - tc) >> STEP_BITS);

    const int low = min(min(f.a.z, f.b.z), f.c.z);
    const ulong za = (ulong)(long)(f.a.z - low) << DIGITS;
    const ulong zb = (ulong)(long)(f.b.z - low) << DIGITS;
    const ulong zc = (ulong)(long)(f.c.z - low) << DIGITS;
    ulong row_n = (ulong)wa * za + (ulong)wb * zb + (ulong)wc * zc;
    const ulong along_v
        = ((ulong)(long)bc.x * za + (ulong)(long)ca.x * zb + (ulong)(long)ab.x * zc) << STEP_BITS;
    const ulong along_u
        = ((ulong)(long)bc.y * za + (ulong)(long)ca.y * zb + (ulong)(long)ab.y * zc) << STEP_BITS;
    const ulong area = (ulong)f.area;
    const ulong reciprocal = ~0UL / area;
    const uint base = (uint)low << DIGITS;
    const uint tie = (uint)tie_bit(f);

    for (int u = box.x; u <= box.z; ++u) {
        int ea = row_a;
        int eb = row_b;
        int ec = row_c;
        ulong n = row_n;
        for (int v = box.y; v <= box.w; ++v) {
            if ((ea | eb | ec) >= 0) {
                uint depth = (uint)mul_hi(n, reciprocal);
                ulong left = n - depth * area;
                if (left >= area) {
                    left -= area;
                    ++depth;
                }
                cross(sink, u, v, (int)(base + depth + (left != 0 ? 1u : tie)));
            }
            ea += bc.x;
            eb += ca.x;
            ec += ab.x;
            n += along_v;
        }
        row_a -= bc.y;
        row_b -= ca.y;
        row_c -= ab.y;
        row_n -= along_u;
    }
}
