/*
 * lists/divide.h: n / area for many n, by one division in all, and exactly.
 *
 * n is below 2^63 and n / area at most 2^28.  It is estimated from 32 bits of each:
 *
 *     m = floor(n / 2^shift), inverse <= 2^(scale + shift) / area, q = floor(m * inverse / 2^scale)
 *
 * Neither factor is too large, so q is not.  Where n is cut, the largest m has 32 bits, and each
 * misses less than 1; where the area is cut, it has 31 bits and is less than 1 too large; and the
 * inverse has 32 bits and misses less than 2.  That is less than three times 2^-30 of at most 2^28,
 * and less than 1: so q is n / area rounded down, or one less.  What is left of n tells which.
 *
 * Tests:      tests/kernels/test_lists.py
 */

typedef struct {
    ulong area;
    uint inverse;
    int shift, scale;
} Divisor;

/* most: n at most, or more, and twice the area at least, so that `scale` is below 64. */
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
