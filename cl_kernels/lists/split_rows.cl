/*
 * lists/split_rows.cl: crossings as they were sorted, into the arrays that are kept.
 *
 * Host:       clvox/ops/lists.py, list_crossings()
 * Reference:  clvox/reference/lists.py, list_crossings()
 * Tests:      tests/kernels/test_lists.py
 */

/* One work-item splits one crossing.
 * rows: depth * 2^32 + side.  depths: int32.  sides: int32, triangle * 2 + (1 if the ray goes
 * in). */
__kernel void split_rows(
    const ulong first, const ulong last, const __global long *restrict rows,
    __global int *restrict depths, __global int *restrict sides)
{
    const ulong at = first + get_global_id(0);
    if (at >= last) return;
    depths[at] = (int)(rows[at] >> 32);
    sides[at] = (int)(uint)rows[at];
}
