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
    const int last = size.x - 1;
    return (uchar16)(vload4(clamp(column, 0, last), line), vload4(clamp(column + 1, 0, last), line),
                     vload4(clamp(column + 2, 0, last), line),
                     vload4(clamp(column + 3, 0, last), line));
}

static inline bool differs(const uchar4 most, const uint least)
{
    return max(max(most.x, most.y), max(most.z, most.w)) >= least;
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
        for (int x = column - 1; x <= column + 1; ++x)
            most = max(most, abs_diff(own, four_pixels(size, pixels, y, x)));
    const uchar4 parts[4] = {most.s0123, most.s4567, most.s89ab, most.scdef};
    for (int i = 0; i < min(size.x - column, 4); ++i)
        if (differs(parts[i], least))
            list[atomic_inc(listed)] = (uint)row * size.x + column + i;
}
