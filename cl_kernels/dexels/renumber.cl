/*
 * dexels/renumber.cl: from which meshes ends come, and their triangles under other numbers.
 *
 * Host:       clvox/ops/dexels.py, used_meshes(), renumber()
 * Reference:  numpy.searchsorted of the triangles
 * Tests:      tests/kernels/test_dexels.py
 * Defines:    RUN  ends that one work-item looks at
 */
#include "common/entries.h"

#define CAP 0x7fffffffu

/* One work-item looks at RUN ends in a row.
 * starts: (meshes,) uint64, the first triangle of each mesh.  sides: triangle * 2 + (1 if in).
 * used: (meshes,) uint32, zero on entry; 1 if an end comes from the mesh. */
__kernel void mark_meshes(
    const ulong ends, const uint meshes, const __global ulong *restrict starts,
    const __global uint *restrict sides, __global uint *used)
{
    const ulong first = get_global_id(0) * RUN;
    uint last = meshes;
    for (ulong at = first; at < min(first + RUN, ends); ++at) {
        const uint triangle = sides[at] >> 1;
        if (triangle == CAP) continue;
        const uint mesh = entry_of(starts, meshes, triangle);
        if (mesh != last) atomic_or(used + mesh, 1u);
        last = mesh;
    }
}

/* One work-item renumbers RUN ends in a row.
 * moved: (meshes,) int32, by how much the numbers of a mesh's triangles grow. */
__kernel void renumber(
    const ulong ends, const uint meshes, const __global ulong *restrict starts,
    const __global int *restrict moved, __global uint *restrict sides)
{
    const ulong first = get_global_id(0) * RUN;
    for (ulong at = first; at < min(first + RUN, ends); ++at) {
        const uint triangle = sides[at] >> 1;
        if (triangle != CAP) sides[at] += 2 * (uint)moved[entry_of(starts, meshes, triangle)];
    }
}
