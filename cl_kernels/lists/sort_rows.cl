/*
 * lists/sort_rows.cl: the crossings of each ray, in order.
 *
 * A crossing is a long that is ordered as it should be: depth, triangle, sign.  A short row is
 * sorted by one work-item.  Long rows are put on a list and merged, runs of 1, 2, 4 ... crossings
 * at a time, one work-item for each crossing: it looks up its place in the other run.  So no
 * work-item does more than a few steps, however long a row is.
 *
 * Host:       clvox/ops/sorting.py, sort_rows()
 * Reference:  clvox/reference/lists.py, list_crossings()
 * Tests:      tests/kernels/test_lists.py
 * Defines:    SHORT  longest row that one work-item sorts
 */
#include "common/entries.h"

/* One work-item sorts one row, or puts it on the list.
 * offsets: (rays + 1,) uint64.  rows: crossings.
 * found: (2,) uint32, zero on entry: how many rows are on the list, and the longest of them.
 * list: their numbers; lengths: their lengths, in the same order, which is none in particular. */
__kernel void sort_short(
    const ulong rays, const __global ulong *restrict offsets, __global long *restrict rows,
    __global uint *found, __global ulong *restrict list, __global uint *restrict lengths)
{
    const ulong ray = get_global_id(0);
    if (ray >= rays) return;
    const uint length = (uint)(offsets[ray + 1] - offsets[ray]);
    if (length > SHORT) {
        const uint entry = atomic_inc(found);
        atomic_max(found + 1, length);
        list[entry] = ray;
        lengths[entry] = length;
        return;
    }
    __global long *row = rows + offsets[ray];
    for (uint i = 1; i < length; ++i) {
        const long moved = row[i];
        uint at = i;
        for (; at > 0 && row[at - 1] > moved; --at) row[at] = row[at - 1];
        row[at] = moved;
    }
}

/* Crossings before `key` in a sorted run; those equal to it counted if `with_equal`. */
static inline uint count_before(
    const __global long *run, const uint length, const long key, const bool with_equal)
{
    uint low = 0, high = length;
    while (low < high) {
        const uint middle = low + (high - low) / 2;
        if (run[middle] < key || (with_equal && run[middle] == key)) low = middle + 1;
        else high = middle;
    }
    return low;
}

/* One work-item moves one crossing of a listed row to its place in the merged run.
 * starts: (entries,) uint64, exclusive prefix sum of the lengths of the listed rows, whose copies
 * in `scratch` lie there, close together.
 * width: crossings in a sorted run; the last run of a row may be shorter.
 * forth: from rows to scratch if not zero, else back. */
__kernel void merge_runs(
    const ulong first, const ulong last, const uint entries, const int forth, const uint width,
    const __global ulong *restrict offsets, const __global ulong *restrict list,
    const __global ulong *restrict starts, __global long *rows, __global long *scratch)
{
    const ulong id = first + get_global_id(0);
    if (id >= last) return;
    const uint entry = entry_of(starts, entries, id);
    const ulong start = starts[entry];
    const ulong offset = offsets[list[entry]];
    const uint length = (uint)(offsets[list[entry] + 1] - offset);
    const __global long *from = forth ? rows + offset : scratch + start;
    __global long *to = forth ? scratch + start : rows + offset;
    const uint at = (uint)(id - start);
    const uint left = at / width / 2 * 2 * width;
    /* No sum here is above four times the longest row, which has at most 2^30 crossings. */
    const uint middle = min(left + width, length);
    const uint right = min(middle + width, length);
    const long key = from[at];
    if (at < middle) to[at + count_before(from + middle, right - middle, key, false)] = key;
    else to[at - (middle - left) + count_before(from + left, middle - left, key, true)] = key;
}
