/*
 * buffers/clear.cl: zeros in every word of a buffer.
 *
 * Host:       clvox/device/session.py, Session.zeros()
 * Reference:  numpy.zeros
 * Tests:      tests/kernels/test_clear.py
 */

/* One work-item clears one word.
 * words: (n,) uint32, undefined on entry. */
__kernel void clear(const ulong n, __global uint *words)
{
    const size_t id = get_global_id(0);
    if (id >= n) return;
    words[id] = 0;
}
