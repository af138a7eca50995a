/*
 * raymarch/choose.cl: the pixels of a picture that differ from those around them.
 *
 * They show an edge, so that more rays are worth their time; in all others one is as good.
 *
 * Host:       clvox/ops/shading.py, choose_pixels()
 * Reference:  clvox/reference/raymarch.py, uneven_pixels()
 * Tests:      tests/kernels/test_shade.py
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

/* One work-item looks at four pixels of a row, and at the eight around each of them.
 * size: columns and rows; least: difference of a byte that counts.  pixels: (size.y, size.x, 4)
 * uint8.  listed: (1,) uint32, 0 before; list: (pixels,) uint32, in no particular order. */
__kernel void choose(
    const int2 size, const uint least, const __global uchar *restrict pixels,
    __global uint *restrict listed, __global uint *restrict list)
{
    const uint fours = (uint)(size.x + 3) / 4, id = get_global_id(0);
    const int row = (int)(id / fours), column = 4 * ((int)id - row * (int)fours);
    if (row >= size.y) return;
    const uchar16 own = four_pixels(size, pixels, row, column);
    uchar16 most = (uchar16)(0);
    for (int y = row - 1; y <= row + 1; ++y)
        for (int x = column - 1; x <= column + 1; ++x) {
            const uchar16 other = four_pixels(size, pixels, y, x);
            most = max(most, max(own, other) - min(own, other));
        }
    uchar bytes[16];
    vstore16(most, 0, bytes);
    for (int i = 0; i < min(size.x - column, 4); ++i) {
        const uchar *pixel = bytes + 4 * i;
        if (max(max(pixel[0], pixel[1]), max(pixel[2], pixel[3])) >= least)
            list[atomic_inc(listed)] = (uint)row * size.x + column + i;
    }
}
