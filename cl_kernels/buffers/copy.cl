/*
 * buffers/copy.cl: one buffer into another.
 *
 * The yardstick of the streaming passes: no pass over memory can be faster than reading and
 * writing it once.
 *
 * Host:       clvox/bench/streaming.py, copy()
 * Reference:  numpy.copyto
 * Tests:      tests/api/test_bench.py
 */

/* One work-item copies four words.
 * source, target: (4 n,) uint32; target is undefined on entry. */
__kernel void copy(
    const ulong n, const __global uint4 *restrict source, __global uint4 *restrict target)
{
    const size_t id = get_global_id(0);
    if (id >= n) return;
    target[id] = source[id];
}
