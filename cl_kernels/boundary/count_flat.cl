/*
 * boundary/count_flat.cl: triangles without area on the lattice.
 *
 * Host:       clvox/ops/boundary.py, count_flat()
 * Reference:  tests/kernels/test_boundary.py, in Python integers
 * Tests:      tests/kernels/test_boundary.py
 * Defines:    RUN  triangles per work-item
 */
#include "boundary/flat.h"
#include "common/corners.h"

/* One work-item counts RUN triangles.
 * faces: (m, 3) int32, vertices: (3 n + 1,) int32, on the lattice.
 * counts: (ceil(m / RUN),) uint32. */
__kernel void count_flat(
    const ulong n, const __global int *restrict faces, const __global int *restrict vertices,
    __global uint *restrict counts)
{
    const ulong start = get_global_id(0) * RUN;
    if (start >= n) return;
    uint count = 0;
    for (ulong triangle = start; triangle < min(start + RUN, n); ++triangle) {
        const int3 a = load_corner(vertices, faces[3 * triangle]);
        const int3 b = load_corner(vertices, faces[3 * triangle + 1]);
        const int3 c = load_corner(vertices, faces[3 * triangle + 2]);
        count += is_flat(b - a, c - a);
    }
    counts[get_global_id(0)] = count;
}
