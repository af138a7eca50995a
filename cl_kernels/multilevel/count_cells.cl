/*
 * multilevel/count_cells.cl: set bits in each block of 256, the first half of a rank.
 *
 * Host:       clvox/ops/multilevel.py, rank_cells()
 * Reference:  clvox/reference/multilevel.py, rank()
 * Tests:      tests/kernels/test_multilevel.py
 */

/* One work-item counts one block of eight words.
 * bits: (words,) uint32.  counts: (ceil(words / 8),) uint32. */
__kernel void count_cells(
    const ulong words, const __global uint *restrict bits, __global uint *restrict counts)
{
    const ulong start = get_global_id(0) * 8;
    if (start >= words) return;
    uint count = 0;
    for (ulong at = start; at < min(start + 8, words); ++at) count += popcount(bits[at]);
    counts[get_global_id(0)] = count;
}
