/*
 * selftest/calculate.cl: the arithmetic that decides geometry, on given numbers.
 *
 * Host:       clvox/ops/selftest.py, calculate() and round_off()
 * Reference:  clvox/reference/selftest.py, calculate() and round_off()
 * Tests:      tests/kernels/test_selftest.py
 */
#pragma OPENCL FP_CONTRACT OFF

/* One work-item takes a pair of numbers.
 * a, b: (n,) uint64.  out: (n, 7) uint64: product, shifted left, right, right with the sign, number
 * of set bits, less as unsigned, less as signed. */
__kernel void calculate(
    const ulong n, const __global ulong *restrict a, const __global ulong *restrict b,
    __global ulong *restrict out)
{
    const ulong id = get_global_id(0);
    if (id >= n) return;
    const ulong x = a[id];
    const ulong y = b[id];
    const uint by = (uint)(y & 63);
    __global ulong *row = out + 7 * id;
    row[0] = x * y;
    row[1] = x << by;
    row[2] = x >> by;
    row[3] = (ulong)((long)x >> by);
    row[4] = popcount(x);
    row[5] = x < y;
    row[6] = (long)x < (long)y;
}

/* One work-item takes three numbers.
 * a, b, c: (n,) float.  out: (n, 2) float: a to the nearest integer, halves to the even one;
 * a * b + c, rounded twice. */
__kernel void round_off(
    const ulong n, const __global float *restrict a, const __global float *restrict b,
    const __global float *restrict c, __global float *restrict out)
{
    const ulong id = get_global_id(0);
    if (id >= n) return;
    out[2 * id] = rint(a[id]);
    const float product = a[id] * b[id];
    out[2 * id + 1] = product + c[id];
}
