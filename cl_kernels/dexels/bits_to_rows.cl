/*
 * dexels/bits_to_rows.cl: pieces of rays that end half-way between samples, from bits.
 *
 * Host:       clvox/ops/dexel_voxels.py, from_dense()
 * Reference:  clvox/reference/dexels.py, from_voxels()
 * Tests:      tests/kernels/test_dexel_voxels.py
 * Defines:    FRACTION_BITS  of the depths
 *             PASS           0: COUNT, 1: WRITE (dexels/ends.h)
 */
#include "common/index.h"
#include "dexels/ends.h"

/* One work-item follows one ray.
 * along: rays in a row.  slots: samples of a ray.
 * ray_stride, row_stride, slot_stride: bits between neighbours in a row, rows, and samples; rows of
 * voxels are padded to whole words.  voxels: bits along x. */
__kernel void bits_to_rows(
    const ulong first, const ulong last, const int along, const int slots,
    const ulong ray_stride, const ulong row_stride, const ulong slot_stride,
    const __global uint *restrict voxels, ENDS_PARAMETERS)
{
    const ulong ray = first + get_global_id(0);
    if (ray >= last) return;
    ulong row = ray;
    const ulong place = take_place(&row, along);
    ulong bit = row * row_stride + place * ray_stride;
    Ends ends = MAKE_ENDS(ray);
    const int half_voxel = 1 << (FRACTION_BITS - 1);
    uint inside = 0;
    for (int slot = 0; slot <= slots; ++slot, bit += slot_stride) {
        const uint now = slot < slots ? voxels[bit / 32] >> (bit % 32) & 1 : 0;
        if (now != inside)
            put_end(&ends, (int)((uint)slot << FRACTION_BITS) - half_voxel, CAP, now);
        inside = now;
    }
    FINISH_ENDS(ends, ray);
}
