/*
 * dexels/measure_rows.cl: how much of each ray, and of each cell of a ray, is inside.
 *
 * Host:       clvox/ops/dexel_measure.py, sum_lengths(), sum_cells()
 * Reference:  clvox/reference/dexels.py, lengths_in_cells()
 * Tests:      tests/kernels/test_dexel_measure.py
 */
#include "common/index.h"

/* One work-item adds the pieces of one ray.
 * offsets: (rays + 1,) uint64; depths: ends, resolved.  lengths: (rays,) uint32, below 2^31. */
__kernel void sum_lengths(
    const ulong first, const ulong last, const __global ulong *restrict offsets,
    const __global int *restrict depths, __global uint *restrict lengths)
{
    const ulong ray = first + get_global_id(0);
    if (ray >= last) return;
    const ulong stop = offsets[ray + 1];
    uint length = 0;
    for (ulong at = offsets[ray]; at < stop; at += 2)
        length += (uint)depths[at + 1] - (uint)depths[at];
    lengths[ray] = length;
}

/* One work-item does the cells of one ray, of some rows of rays.
 * first, last: rays; along: rays in a row.  low, high: depths of the box's faces; width: of a cell.
 * cells: along a ray; strides: between the lengths of neighbouring rays in a row, of rows, and of
 * cells.  lengths: uint32, undefined on entry, starting with ray `first`. */
__kernel void sum_cells(
    const ulong first, const ulong last, const int along, const int low, const int high,
    const uint width, const int cells, const ulong ray_stride, const ulong row_stride,
    const ulong cell_stride, const __global ulong *restrict offsets,
    const __global int *restrict depths, __global uint *restrict lengths)
{
    const ulong ray = first + get_global_id(0);
    if (ray >= last) return;
    ulong row = ray - first;
    const ulong place = take_place(&row, along);
    __global uint *at = lengths + row * row_stride + place * ray_stride;
    const ulong stop = offsets[ray + 1];
    ulong piece = offsets[ray];
    for (int cell = 0; cell < cells; ++cell) {
        const long start = low + (long)cell * width;
        const long end = min(start + (long)width, (long)high);
        long length = 0;
        while (piece < stop && depths[piece] < end) {
            length += min((long)depths[piece + 1], end) - max((long)depths[piece], start);
            if (depths[piece + 1] > end) break;
            piece += 2;
        }
        at[cell * cell_stride] = (uint)length;
    }
}
