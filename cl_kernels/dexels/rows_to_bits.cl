/*
 * dexels/rows_to_bits.cl: which samples are inside, as bits, from pieces of rays.
 *
 * The slot of an end, its depth rounded up to whole voxels, is the first sample behind it.
 *
 * Host:       clvox/ops/dexel_voxels.py, to_dense()
 * Reference:  clvox/reference/dexels.py, to_voxels()
 * Tests:      tests/kernels/test_dexel_voxels.py
 * Defines:    FRACTION_BITS  of the depths
 */
#include "common/index.h"

static inline int slot_of(const int depth)
{
    return (int)(((long)depth + ((1 << FRACTION_BITS) - 1)) >> FRACTION_BITS);
}

/* One work-item flips the bit of the first sample behind each end of one ray along y or z.
 * along: rays in a row, along x.  slots: samples of a ray.
 * row_stride, slot_stride: words between rows of rays, and between samples of a ray.
 * voxels: bits along x, zero on entry; what lies past the last sample is dropped: every piece that
 * ends there ends there. */
__kernel void flip_ends(
    const ulong first, const ulong last, const int along, const int slots,
    const ulong row_stride, const ulong slot_stride, const __global ulong *restrict offsets,
    const __global int *restrict depths, __global uint *voxels)
{
    const ulong ray = first + get_global_id(0);
    if (ray >= last) return;
    ulong row = ray;
    const int x = take_place(&row, along);
    __global uint *word = voxels + row * row_stride + x / 32;
    const ulong stop = offsets[ray + 1];
    for (ulong at = offsets[ray]; at < stop; ++at) {
        const int slot = slot_of(depths[at]);
        if (slot < slots) atomic_xor(word + slot * slot_stride, 1u << (x % 32));
    }
}

/* One work-item writes the bits of one ray along x.
 * words: of a ray.  voxels: undefined on entry. */
__kernel void fill_rows(
    const ulong first, const ulong last, const int slots, const int words,
    const __global ulong *restrict offsets, const __global int *restrict depths,
    __global uint *restrict voxels)
{
    const ulong ray = first + get_global_id(0);
    if (ray >= last) return;
    __global uint *row = voxels + ray * words;
    for (int word = 0; word < words; ++word) row[word] = 0;
    const ulong stop = offsets[ray + 1];
    for (ulong at = offsets[ray]; at < stop; ++at) {
        const int slot = slot_of(depths[at]);
        if (slot < slots) row[slot / 32] ^= 1u << (slot % 32);
    }
    uint carry = 0;
    for (int word = 0; word < words; ++word) {
        uint bits = row[word];
        for (int shift = 1; shift < 32; shift *= 2) bits ^= bits << shift;
        bits ^= carry;
        carry = bits >> 31 ? 0xffffffffu : 0u;
        row[word] = bits;
    }
    /* A piece that ends past the last sample leaves bits in the padding. */
    if (slots % 32) row[words - 1] &= (1u << (slots % 32)) - 1u;
}
