/*
 * attributes/sum_normals.cl: for each touched voxel, the sum of the normals of its triangles.
 *
 * Normals are integers, and so are their sums: they do not depend on the order of addition.
 *
 * Host:       clvox/ops/attributes.py, sum_normals()
 * Reference:  clvox/reference/attributes.py, voxel_normals()
 * Tests:      tests/kernels/test_attributes.py
 * Defines:    LEVELS, BRICK_*, MIDDLE_*  of the model (common/bricks.h)
 *             STEP_BITS, CELL_*, RUN, DIRECT, TILE  (boundary/visit.h), a cell being a voxel
 *             LIMBS  words of a sum: 1, or 2 where one might overflow
 * Source:     G. Young, "Multi-level voxel representation for GPU-accelerated solid modeling",
 *             2017: the mean normal of the triangles that meet a voxel.
 */
#include "common/tiles.h"
#include "boundary/overlap.h"
#include "attributes/touched.h"
#include "attributes/octahedral.h"

/* normals: (m, 3) int32, of each triangle.  Of the touched voxels first to before last,
 * sums: (last - first, 3, LIMBS) uint32, lowest limb first;
 * lowest: (last - first) uint32, ~ of the lowest triangle with a normal; 0 for none. */
#define SINK_PARAMETERS \
    TOUCHED_PARAMETERS, const __global int *normals, const uint first_voxel, \
    const uint last_voxel, __global uint *sums, __global uint *lowest
#define MAKE_SINK(grid) { TOUCHED, normals, first_voxel, last_voxel, sums, lowest }
typedef struct {
    Touched touched;
    const __global int *normals;
    uint first, last;
    __global uint *sums;
    __global uint *lowest;
} Sink;

static inline void add(__global uint *sum, const int value)
{
    if (value == 0) return;
    const uint low = (uint)value;
    const uint before = atomic_add(sum, low);
#if LIMBS == 2
    const uint high = (value < 0 ? 0xffffffffu : 0u) + (before + low < low);
    if (high) atomic_add(sum + 1, high);
#endif
}

static inline void mark(Sink *sink, const int3 cell, const ulong triangle)
{
    const uint voxel = find_touched(&sink->touched, cell.x, cell.y, cell.z);
    if (voxel == UNTOUCHED || voxel < sink->first || voxel >= sink->last) return;
    const __global int *normal = sink->normals + 3 * triangle;
    if (normal[0] == 0 && normal[1] == 0 && normal[2] == 0) return;
    const ulong at = voxel - sink->first;
    for (int i = 0; i < 3; ++i) add(sink->sums + (3 * at + i) * LIMBS, normal[i]);
    atomic_max(sink->lowest + at, ~(uint)triangle);
}

static inline void finish(const Sink *sink)
{
}

#include "boundary/visit.h"

static inline long sum_at(const __global uint *sums, const ulong number)
{
#if LIMBS == 2
    return (long)((ulong)sums[2 * number + 1] << 32 | sums[2 * number]);
#else
    return (long)(int)sums[number];
#endif
}

/* One work-item packs the normal of one voxel, of n from number `first` on.
 * packed: (touched voxels,) uint32. */
__kernel void pack_normals(
    const ulong n, const uint first, const __global int *restrict normals, const __global uint *restrict sums,
    const __global uint *restrict lowest, __global uint *restrict packed)
{
    const ulong id = get_global_id(0);
    if (id >= n) return;
    long x = sum_at(sums, 3 * id), y = sum_at(sums, 3 * id + 1), z = sum_at(sums, 3 * id + 2);
    if (x == 0 && y == 0 && z == 0 && lowest[id] != 0) {
        const __global int *normal = normals + 3 * (ulong)~lowest[id];
        x = normal[0];
        y = normal[1];
        z = normal[2];
    }
    packed[first + id] = pack_normal(x, y, z);
}
