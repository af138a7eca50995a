/*
 * scan/prefix_sum.cl: exclusive prefix sum of 32-bit counts.
 *
 * Three launches: the sum of each chunk; the exclusive prefix sum of those sums, by one group; and
 * the prefix sums within each chunk, from its offset.  A chunk is RUN counts for each work-item of
 * a group: runs are summed one after the other, so that only one number per run meets a barrier.
 *
 * Host:       clvox/ops/scan.py
 * Reference:  clvox/reference/multilevel.py, prefix_sum()
 * Tests:      tests/kernels/test_scan.py
 * Defines:    GROUP   work-group size, a power of two
 *             RUN     counts per work-item
 *             RESULT  type of the prefix sums: 32 (uint) or 64 (ulong)
 * Source:     G. Blelloch, "Prefix sums and their applications", 1990.
 */
#include "common/group_scan.h"

#if RESULT == 64
typedef ulong result_t;
#else
typedef uint result_t;
#endif

/* One group sums one chunk; its number is not get_group_id(), which starts anew in each launch.
 * counts: (n,) uint32.  sums: one uint64 per chunk. */
__kernel void sum_chunks(
    const ulong n, const __global uint *restrict counts, __global ulong *restrict sums)
{
    __local ulong scratch[GROUP];
    const ulong start = get_global_id(0) * RUN;
    ulong sum = 0;
    for (ulong at = start; at < min(start + RUN, n); ++at) sum += counts[at];
    ulong total;
    group_scan(scratch, sum, &total);
    if (get_local_id(0) == 0) sums[get_global_id(0) / GROUP] = total;
}

/* One group, all alone, turns the sums into their exclusive prefix sums, in place.
 * sums: (chunks + 1,) uint64; the last entry takes the total of all counts. */
__kernel void scan_sums(const ulong chunks, __global ulong *sums)
{
    __local ulong scratch[GROUP];
    const ulong run = (chunks + GROUP - 1) / GROUP;
    const ulong start = min(get_local_id(0) * run, chunks);
    const ulong stop = min(start + run, chunks);
    ulong sum = 0;
    for (ulong at = start; at < stop; ++at) sum += sums[at];
    ulong total;
    ulong before = group_scan(scratch, sum, &total);
    for (ulong at = start; at < stop; ++at) {
        const ulong value = sums[at];
        sums[at] = before;
        before += value;
    }
    if (get_local_id(0) == 0) sums[chunks] = total;
}

/* One group writes the prefix sums of one chunk.
 * result: (n,) uint32 or uint64; may be the counts themselves if of the same width. */
__kernel void scan_chunks(
    const ulong n, const __global ulong *sums, const __global uint *counts,
    __global result_t *result)
{
    __local ulong scratch[GROUP];
    const ulong start = get_global_id(0) * RUN;
    const ulong stop = min(start + RUN, n);
    ulong sum = 0;
    for (ulong at = start; at < stop; ++at) sum += counts[at];
    ulong total;
    ulong before = sums[get_global_id(0) / GROUP] + group_scan(scratch, sum, &total);
    for (ulong at = start; at < stop; ++at) {
        const uint value = counts[at];
        result[at] = (result_t)before;
        before += value;
    }
}
