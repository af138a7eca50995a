/*
 * buffers/clear.cl: zeros in every word of a buffer.
 *
 * Host:       clvox/device/session.py, Session.zeros()
 * Reference:  numpy.zeros
 * Tests:      tests/kernels/test_clear.py
 */

/* One work-item clears four words side by side, fewer at the end.
 * words: (n,) uint32, undefined on entry. */
__kernel void clear(const ulong n, __global uint *words)
{
    const ulong first = get_global_id(0) * 4;
    if (first + 4 <= n) {
        vstore4((uint4)(0), 0, words + first);
        return;
    }
    for (ulong id = first; id < n; ++id) words[id] = 0;
}
