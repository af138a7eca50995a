/*
 * raymarch/choose.cl: the pixels of a picture that differ from those around them.
 *
 * They show an edge, so that more rays are worth their time; in all others one is as good.
 *
 * Host:       clvox/ops/shading.py, choose_pixels()
 * Reference:  clvox/reference/raymarch.py, uneven_pixels()
 * Tests:      tests/kernels/test_shade.py
 */

static inline uint difference(const uint one, const uint other)
{
    uint most = 0;
    for (int shift = 0; shift < 32; shift += 8)
        most = max(most, abs_diff(one >> shift & 255u, other >> shift & 255u));
    return most;
}

/* One work-item looks at one pixel and the eight around it.
 * size: columns and rows; least: difference of a byte that counts.  pixels: (size.y, size.x)
 * uint32, four bytes.  listed: (1,) uint32, 0 before; list: (pixels,) uint32, in no particular
 * order. */
__kernel void choose(
    const int2 size, const uint least, const __global uint *restrict pixels,
    __global uint *restrict listed, __global uint *restrict list)
{
    const ulong id = get_global_id(0);
    if (id >= (ulong)size.x * size.y) return;
    const int row = (int)(id / size.x), column = (int)(id - (ulong)row * size.x);
    const uint own = pixels[id];
    uint most = 0;
    for (int y = max(row - 1, 0); y <= min(row + 1, size.y - 1); ++y)
        for (int x = max(column - 1, 0); x <= min(column + 1, size.x - 1); ++x) {
            const uint other = pixels[(ulong)y * size.x + x];
            if (other != own) most = max(most, difference(own, other));
        }
    if (most >= least) list[atomic_inc(listed)] = (uint)id;
}
