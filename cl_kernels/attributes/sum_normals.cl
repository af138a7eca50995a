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
 *             ATOMIC_LOADS  if defined, OpenCL C 3.0 with atomic_load_explicit()
 *             RANK_WORDS  1: the ranks that this kernel is given have an entry for each word
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
#define MAKE_SINK(grid) \
    { TREE, edge, edge_rank, normals, first_voxel, last_voxel, sums, lowest }
typedef struct {
    Tree tree;
    const __global uint *edge;
    const __global uint *edge_rank;
    const __global int *normals;
    uint first, last;
    __global uint *sums;
    __global uint *lowest;
} Sink;

static inline void add(__global uint *sum, const int value)
{
    const uint low = (uint)value;
    const uint before = atomic_add(sum, low);
#if LIMBS == 2
    /* Nothing, unless the sum's sign changes or it grows past a word. */
    const uint high = (value < 0 ? 0xffffffffu : 0u) + (before + low < low);
    if (high) atomic_add(sum + 1, high);
#endif
}

static inline void set_lowest(__global uint *lowest, const uint number)
{
#ifdef ATOMIC_LOADS
    /* Lower ones mostly come first: looking, be the answer late, saves nearly all of these. */
    const uint seen = atomic_load_explicit(
        (volatile __global atomic_uint *)lowest, memory_order_relaxed, memory_scope_device);
    if (number <= seen) return;
#endif
    atomic_max(lowest, number);
}

static inline void mark(Sink *sink, const int3 cell, const ulong triangle)
{
    const uint brick = find_cell(sink->tree, cell.x, cell.y, cell.z);
    if (brick == NO_BRICK) return;
    /* The voxel's bit is set, since `edge` was made by the same walk. */
    const uint voxel = touched_number(
        brick, sink->edge, sink->edge_rank, edge_bit(brick, cell.x, cell.y, cell.z));
    const bool mine = voxel >= sink->first && voxel < sink->last;
    const int x = mine ? sink->normals[3 * triangle] : 0;
    const int y = mine ? sink->normals[3 * triangle + 1] : 0;
    const int z = mine ? sink->normals[3 * triangle + 2] : 0;
    /* For all others nothing is added to the first one: with more branches, Intel's compiler reads
     * where it must not. */
    const ulong at = mine ? voxel - sink->first : 0;
    add(sink->sums + 3 * at * LIMBS, x);
    add(sink->sums + (3 * at + 1) * LIMBS, y);
    add(sink->sums + (3 * at + 2) * LIMBS, z);
    set_lowest(sink->lowest + at, (x | y | z) != 0 ? ~(uint)triangle : 0u);
}

static inline void finish(const Sink *sink)
{
}

/* Says that a work-item is vectors already: Intel's compiler, which would put sixteen of them
 * together, then reads where it must not. */
#define VISIT_HINT __attribute__((vec_type_hint(int4)))
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
    const ulong n, const uint first, const __global int *restrict normals,
    const __global uint *restrict sums,
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

/* One work-item counts the bits of one word.  bits: (words,) uint32.  counts: (words,) uint32. */
__kernel void count_words(
    const ulong words, const __global uint *restrict bits, __global uint *restrict counts)
{
    const ulong id = get_global_id(0);
    if (id < words) counts[id] = popcount(bits[id]);
}
