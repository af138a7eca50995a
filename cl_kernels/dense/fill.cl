/*
 * dense/fill.cl: from flipped bits to a solid, in a dense grid of bits.
 *
 * A flipped bit says "from here on, the other side": a running xor along y resolves them, 32 rays
 * a word.  A work-item takes SPAN words side by side, as many as share a line of memory.
 *
 * Host:       clvox/ops/dense.py, fill()
 * Reference:  clvox/reference/crossings.py, fill_parity()
 * Tests:      tests/kernels/test_dense.py
 * Defines:    SPAN  words per work-item: 16
 */

/* One work-item walks SPAN words of the rows (z, y = 0 ..) along y.
 * shape: row words, rows along y, planes along z.
 * voxels: bits, flipped on entry, resolved on return.
 * beyond: (planes, row words) bits: crossings past the last sample.
 * odd: (1,) uint32, added to: rays that end inside. */
__kernel void fill(
    const int4 shape, __global uint *restrict voxels, const __global uint *restrict beyond,
    __global uint *restrict odd)
{
    const int spans = (shape.x + SPAN - 1) / SPAN;
    const ulong id = get_global_id(0);
    if (id >= (ulong)spans * shape.z) return;
    const ulong z = id / spans;
    const int first = (int)(id - z * spans) * SPAN;
    const int width = min(shape.x - first, SPAN);
    __global uint *row = voxels + z * shape.y * shape.x + first;
    uint count = 0;
    if (width == SPAN) {
        uint16 state = 0;
        for (int y = 0; y < shape.y; ++y, row += shape.x) {
            state ^= vload16(0, row);
            vstore16(state, 0, row);
        }
        uint ends[SPAN];
        vstore16(state ^ vload16(0, beyond + z * shape.x + first), 0, ends);
        for (int w = 0; w < SPAN; ++w) count += popcount(ends[w]);
    } else {
        uint state[SPAN];
        for (int w = 0; w < width; ++w) state[w] = 0;
        for (int y = 0; y < shape.y; ++y, row += shape.x)
            for (int w = 0; w < width; ++w) row[w] = state[w] ^= row[w];
        for (int w = 0; w < width; ++w)
            count += popcount(state[w] ^ beyond[z * shape.x + first + w]);
    }
    if (count) atomic_add(odd, count);
}
