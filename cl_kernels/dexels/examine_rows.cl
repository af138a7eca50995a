/*
 * dexels/examine_rows.cl: the deepest ray, the thinnest piece, and rays of odd depth.
 *
 * Host:       clvox/ops/dexel_measure.py, examine()
 * Reference:  clvox/reference/dexels.py, examine()
 * Tests:      tests/kernels/test_dexel_measure.py
 * Defines:    RUN  rays that one work-item looks at
 */

/* One work-item looks at RUN rays in a row.
 * offsets: (rays + 1,) uint64 of the crossings; piece_offsets, piece_depths: of resolved ends.
 * depth, deepest: per run, most crossings of a ray and the first such ray; odd: rays with an odd
 * number; length, thinnest: the shortest piece, UINT_MAX if there is none, and its first ray. */
__kernel void examine_rows(
    const ulong rays, const __global ulong *restrict offsets,
    const __global ulong *restrict piece_offsets, const __global int *restrict piece_depths,
    __global uint *restrict depth, __global ulong *restrict deepest, __global uint *restrict odd,
    __global uint *restrict length, __global ulong *restrict thinnest)
{
    const ulong run = get_global_id(0);
    const ulong start = run * RUN;
    if (start >= rays) return;
    uint most = 0;
    uint uneven = 0;
    uint least = UINT_MAX;
    ulong most_at = start;
    ulong least_at = start;
    for (ulong ray = start; ray < min(start + RUN, rays); ++ray) {
        const uint count = (uint)(offsets[ray + 1] - offsets[ray]);
        uneven += count & 1;
        if (count > most) {
            most = count;
            most_at = ray;
        }
        const ulong stop = piece_offsets[ray + 1];
        for (ulong at = piece_offsets[ray]; at < stop; at += 2) {
            const uint thick = (uint)piece_depths[at + 1] - (uint)piece_depths[at];
            if (thick < least) {
                least = thick;
                least_at = ray;
            }
        }
    }
    depth[run] = most;
    deepest[run] = most_at;
    odd[run] = uneven;
    length[run] = least;
    thinnest[run] = least_at;
}
