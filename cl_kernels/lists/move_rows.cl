/*
 * lists/move_rows.cl: long rows of crossings, out of the lists to be merged, and back.
 *
 * Host:       clvox/ops/lists.py, list_crossings()
 * Reference:  clvox/reference/lists.py, list_crossings()
 * Tests:      tests/kernels/test_lists.py
 * Defines:    BACK  0: out of the lists, 1: into them
 */
#include "common/entries.h"

/* One work-item moves one crossing of a listed row.
 * offsets: (rays + 1,) uint64.  list: rays with long rows; starts: (entries + 1,) uint64, where
 * they begin in `rows`, which holds depth * 2^32 + side. */
__kernel void move_rows(
    const ulong first, const ulong last, const uint entries,
    const __global ulong *restrict offsets, const __global ulong *restrict list,
    const __global ulong *restrict starts, __global int *depths, __global uint *sides,
    __global long *rows)
{
    const ulong id = first + get_global_id(0);
    if (id >= last) return;
    const uint entry = entry_of(starts, entries, id);
    const ulong at = offsets[list[entry]] + (id - starts[entry]);
#if BACK
    depths[at] = (int)(rows[id] >> 32);
    sides[at] = (uint)rows[id];
#else
    rows[id] = (long)((ulong)(uint)depths[at] << 32 | sides[at]);
#endif
}
