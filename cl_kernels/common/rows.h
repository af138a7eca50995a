/*
 * common/rows.h: rows of up to 64 voxels or cells along x, as bits, and sums over them.
 */
#ifndef CLVOX_ROWS_H
#define CLVOX_ROWS_H

/* How many positions of a row are set, the sum of their indices and that of the squares. */
typedef struct {
    ulong count, first, second;
} Line;

__constant ulong place_masks[6] = {
    0xaaaaaaaaaaaaaaaaUL, 0xccccccccccccccccUL, 0xf0f0f0f0f0f0f0f0UL,
    0xff00ff00ff00ff00UL, 0xffff0000ffff0000UL, 0xffffffff00000000UL,
};

/* Sums over the set bits of a row below bit 2^places.  The index of a bit is a number of `places`
 * binary places: bits whose place b is set are counted together, and by pairs of places for the
 * squares.  All sums stay below 2^17. */
static inline Line sum_bits(const ulong bits, const int places)
{
    uint first = 0, second = 0;
    for (int b = 0; b < places; ++b) {
        const ulong with = bits & place_masks[b];
        const uint found = (uint)popcount(with);
        first += found << b;
        second += found << 2 * b;
        for (int c = 0; c < b; ++c) second += (uint)popcount(with & place_masks[c]) << (b + c + 1);
    }
    Line line = {(ulong)popcount(bits), first, second};
    return line;
}

/* Sums over `count` neighbours from `start`: below 2^17 * 2^34. */
static inline Line sum_range(const int start, const int count)
{
    const ulong n = count, s = start, below = n * (n - 1) / 2;
    Line line = {n, n * s + below, n * s * s + 2 * s * below + below * (2 * n - 1) / 3};
    return line;
}

/* The same positions, `shift` further on. */
static inline Line shifted(const Line line, const int shift)
{
    const ulong s = shift;
    Line moved = {
        line.count, line.first + s * line.count,
        line.second + 2 * s * line.first + s * s * line.count,
    };
    return moved;
}

/* Every position becomes `side` of them. */
static inline Line widened(const Line line, const int side)
{
    const ulong n = side;
    const Line within = sum_range(0, side);
    Line wide = {
        line.count * n,
        line.first * n * n + line.count * within.first,
        line.second * n * n * n + 2 * line.first * n * within.first + line.count * within.second,
    };
    return wide;
}

/* Binary places of a number below `count`, at most 64. */
static inline int places_of(const int count)
{
    return count > 32 ? 6 : count > 16 ? 5 : count > 8 ? 4 : count > 4 ? 3 : 2;
}

/* Row (y, z) of a brick of `width` by `height` by any number, as bits. */
static inline ulong brick_row(
    const __global uint *brick, const int width, const int height, const int y, const int z)
{
    const uint start = (z * height + y) * width;
    const uint low = start % 32;
    const __global uint *words = brick + start / 32;
    ulong bits = words[0] >> low;
    if (low + width > 32) bits |= (ulong)words[1] << (32 - low);
    if (low + width > 64) bits |= (ulong)words[2] << (64 - low);
    return bits & (~0UL >> (64 - width));
}

#endif
