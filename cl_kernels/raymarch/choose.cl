/*
 * raymarch/choose.cl: the pixels of a picture that differ from those around them.
 *
 * They show an edge, so that more rays are worth their time; in all others one is as good.  What is
 * found so may go on beside them: a wire narrower than a pixel is met by some of the first rays
 * only, and is followed from there.
 *
 * Host:       clvox/ops/choosing.py
 * Reference:  clvox/reference/raymarch.py, uneven_pixels() and pixels_beside()
 * Tests:      tests/kernels/test_choose.py
 * Defines:    TILE   pixels along the side of a tile, a multiple of 4
 *             STARTS 1: it is known which tiles show nothing
 */

/* Four pixels of a row from a column on; those beside the picture are its outermost ones. */
static inline uchar16 four_pixels(
    const int2 size, const __global uchar *pixels, const int row, const int column)
{
    const __global uchar *line = pixels + 4 * (ulong)clamp(row, 0, size.y - 1) * size.x;
    if (column >= 0 && column + 4 <= size.x) return vload16(0, line + 4 * column);
    uchar bytes[16];
    for (int i = 0; i < 16; ++i) bytes[i] = line[4 * clamp(column + i / 4, 0, size.x - 1) + i % 4];
    return vload16(0, bytes);
}

/* Marks a pixel; was it not marked before? */
static inline bool mark(__global uint *marks, const uint number)
{
    const uint bit = 1u << number % 32;
    return (atomic_or(&marks[number / 32], bit) & bit) == 0;
}

/* Lists those of four pixels of a row, from number `first` on, one of whose bytes in `most` is
 * `least` or more. */
static inline void list_uneven(
    const uchar16 most, const uint least, const uint first, const int count,
    __global uint *marks, __global uint *listed, __global uint *list)
{
    uchar bytes[16];
    vstore16(most, 0, bytes);
    for (int i = 0; i < count; ++i) {
        const uchar *pixel = bytes + 4 * i;
        if (max(max(pixel[0], pixel[1]), max(pixel[2], pixel[3])) < least) continue;
        mark(marks, first + i);
        list[atomic_inc(listed)] = first + i;
    }
}

/* One work-item looks at one tile, four pixels at a time, and at the eight around each of them.
 * size: columns and rows; least: difference of a byte that counts.  starts: (tiles,) float32,
 * INFINITY where no ray meets anything, if STARTS.  pixels: (size.y, size.x, 4) uint8.
 * marks: a bit for each pixel, 0 before, set for those that are chosen.
 * listed: (1,) uint32, 0 before; list: (pixels,) uint32, in no particular order. */
__kernel void choose(
    const int2 size, const uint least, const __global float *restrict starts,
    const __global uchar *restrict pixels, __global uint *restrict marks,
    __global uint *restrict listed, __global uint *restrict list)
{
    const uint tiles = (uint)(size.x + TILE - 1) / TILE, id = get_global_id(0);
    const uint tile_row = id / tiles;
    const int top = TILE * (int)tile_row, left = TILE * (int)(id - tile_row * tiles);
    if (top >= size.y) return;
#if STARTS
    if (starts[id] == INFINITY) return;
#endif
    for (int column = left; column < min(left + TILE, size.x); column += 4) {
        /* Of three pixels beside one another, for the row above that, the row before and this. */
        uchar16 low_above, high_above, low_before, high_before, own = (uchar16)(0);
        low_above = high_above = low_before = high_before = own;
        for (int row = top - 1; row <= min(top + TILE, size.y); ++row) {
            const uchar16 one = four_pixels(size, pixels, row, column - 1);
            const uchar16 middle = four_pixels(size, pixels, row, column);
            const uchar16 other = four_pixels(size, pixels, row, column + 1);
            const uchar16 low = min(middle, min(one, other));
            const uchar16 high = max(middle, max(one, other));
            if (row > top) {
                const uchar16 most = max(own - min(low, min(low_before, low_above)),
                                         max(high, max(high_before, high_above)) - own);
                list_uneven(most, least, (uint)(row - 1) * size.x + column,
                            min(size.x - column, 4), marks, listed, list);
            }
            low_above = low_before;
            high_above = high_before;
            low_before = low;
            high_before = high;
            own = middle;
        }
    }
}

/* One work-item looks at the eight pixels around one of `count`, from entry `first` of the list on;
 * those that differ from it and are not marked are added.  Arguments as those of choose(). */
__kernel void choose_beside(
    const uint first, const uint count, const int2 size, const uint least,
    const __global uchar *restrict pixels, __global uint *restrict marks,
    __global uint *restrict listed, __global uint *list)
{
    const uint id = get_global_id(0);
    if (id >= count) return;
    const uint number = list[first + id];
    const int row = (int)(number / (uint)size.x), column = (int)(number - (uint)row * size.x);
    const uchar4 own = vload4(number, pixels);
    for (int y = max(row - 1, 0); y <= min(row + 1, size.y - 1); ++y)
        for (int x = max(column - 1, 0); x <= min(column + 1, size.x - 1); ++x) {
            const uint beside = (uint)y * size.x + x;
            const uchar4 other = vload4(beside, pixels);
            const uchar4 apart = max(own, other) - min(own, other);
            if (max(max(apart.x, apart.y), max(apart.z, apart.w)) < least) continue;
            if (mark(marks, beside)) list[atomic_inc(listed)] = beside;
        }
}
