/*
 * common/group_scan.h: exclusive prefix sum over the work-items of a group.
 *
 * Source:     G. Blelloch, "Prefix sums and their applications", 1990, section 1.2: up-sweep and
 *             down-sweep over a tree kept in place.
 * Defines:    GROUP  work-group size, a power of two
 */
#ifndef CLVOX_GROUP_SCAN_H
#define CLVOX_GROUP_SCAN_H

/* Returns the sum of `value` over the work-items before this one, and the sum over all in *total.
 * sums: GROUP entries.  Every work-item of the group calls it. */
static inline ulong group_scan(__local ulong *sums, const ulong value, ulong *total)
{
    const uint id = get_local_id(0);
    sums[id] = value;
    for (uint stride = 1; stride < GROUP; stride *= 2) {
        barrier(CLK_LOCAL_MEM_FENCE);
        const uint at = (id + 1) * stride * 2 - 1;
        if (at < GROUP) sums[at] += sums[at - stride];
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    *total = sums[GROUP - 1];
    barrier(CLK_LOCAL_MEM_FENCE);
    if (id == 0) sums[GROUP - 1] = 0;
    for (uint stride = GROUP / 2; stride > 0; stride /= 2) {
        barrier(CLK_LOCAL_MEM_FENCE);
        const uint at = (id + 1) * stride * 2 - 1;
        if (at < GROUP) {
            const ulong left = sums[at - stride];
            sums[at - stride] = sums[at];
            sums[at] += left;
        }
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    return sums[id];
}

#endif
