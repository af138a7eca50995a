/*
 * selftest/contend.cl: many work-items at the same few words.
 *
 * Every sink of crossings relies on these atomics; a device that loses one update in a million
 * would make models that are wrong in one voxel.
 *
 * Host:       clvox/ops/selftest.py, contend()
 * Reference:  clvox/reference/selftest.py, contend()
 * Tests:      tests/kernels/test_selftest.py
 */

/* Each work-item updates all six words.
 * words: (6,) uint32, the last all ones and the others zero on entry. */
__kernel void contend(const ulong n, __global uint *words)
{
    const ulong id = get_global_id(0);
    if (id >= n) return;
    const uint hash = (uint)id * 2654435761u;
    atomic_inc(words);
    atomic_add(words + 1, hash);
    atomic_xor(words + 2, hash);
    atomic_or(words + 3, 1u << (hash >> 27));
    atomic_max(words + 4, hash);
    atomic_min(words + 5, hash);
}
