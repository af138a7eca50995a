/*
 * dexels/search_rows.cl: is a place inside, and which end follows it?
 *
 * Host:       clvox/ops/dexel_measure.py, look_up(), find_ends()
 * Reference:  clvox/reference/dexels.py, holds()
 * Tests:      tests/kernels/test_dexel_measure.py
 */

/* Ends of a ray that are not behind `depth`. */
static inline ulong count_ends(
    const __global ulong *offsets, const __global int *depths, const ulong ray, const int depth)
{
    ulong low = offsets[ray];
    ulong high = offsets[ray + 1];
    while (low < high) {
        const ulong middle = low + (high - low) / 2;
        if (depths[middle] <= depth) low = middle + 1;
        else high = middle;
    }
    return low - offsets[ray];
}

/* One work-item looks up one place.
 * rays: (places,) int64, -1 for none; places: (places,) int32.
 * inside: (places,) uint8, 1 if the ray is inside at that depth. */
__kernel void look_up(
    const ulong count, const __global long *restrict rays, const __global int *restrict places,
    const __global ulong *restrict offsets, const __global int *restrict depths,
    __global uchar *restrict inside)
{
    const ulong id = get_global_id(0);
    if (id >= count) return;
    const long ray = rays[id];
    inside[id] = ray < 0 ? 0 : count_ends(offsets, depths, (ulong)ray, places[id]) & 1;
}

/* One work-item finds the first end behind one place.
 * found_depths, found_sides: (places,), its depth and its triangle * 2 + (1 if it goes in); the
 * depth is INT_MIN, which no end has, and the side 0, where no end of the ray lies behind. */
__kernel void find_ends(
    const ulong count, const __global long *restrict rays, const __global int *restrict places,
    const __global ulong *restrict offsets, const __global int *restrict depths,
    const __global uint *restrict sides,
    __global int *restrict found_depths, __global uint *restrict found_sides)
{
    const ulong id = get_global_id(0);
    if (id >= count) return;
    const ulong ray = (ulong)rays[id];
    const ulong at = offsets[ray] + count_ends(offsets, depths, ray, places[id]);
    const bool found = at < offsets[ray + 1];
    found_depths[id] = INT_MIN;
    found_sides[id] = 0;
    if (!found) return;
    found_depths[id] = depths[at];
    found_sides[id] = sides[at];
}
