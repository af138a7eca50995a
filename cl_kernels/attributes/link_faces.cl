/*
 * attributes/link_faces.cl: the triangles that touch each boundary cell, as compressed rows.
 *
 * Counted, scanned on the host's behalf, and emitted in any order; sorting makes it one.
 *
 * Host:       clvox/ops/attributes.py, link_faces()
 * Reference:  clvox/reference/attributes.py, cell_faces()
 * Tests:      tests/kernels/test_attributes.py
 * Defines:    LEVELS, BRICK_*, MIDDLE_*  of the model (common/bricks.h)
 *             STEP_BITS, CELL_*, RUN, DIRECT, TILE  (boundary/visit.h), a cell being one of the
 *             last level above the voxels
 *             EMIT  0: count; 1: emit
 */
#include "common/tiles.h"
#include "boundary/overlap.h"
#include "attributes/touched.h"

/* counts: (cells,) uint32, of triangles found so far, zero before the first launch.
 * offsets: (cells + 1,) uint64; rows: int64, triangle numbers; both not used while counting. */
#define SINK_PARAMETERS \
    TREE_PARAMETERS, __global uint *counts, const __global ulong *row_offsets, __global long *rows
#define MAKE_SINK(grid) { TREE, counts, row_offsets, rows }
typedef struct {
    Tree tree;
    __global uint *counts;
    const __global ulong *offsets;
    __global long *rows;
} Sink;

static inline void mark(Sink *sink, const int3 cell, const ulong triangle)
{
    const uint number = find_brick(sink->tree, cell.x, cell.y, cell.z);
    if (number == NO_BRICK) return;
    const uint place = atomic_inc(sink->counts + number);
#if EMIT
    sink->rows[sink->offsets[number] + place] = (long)triangle;
#endif
}

static inline void finish(const Sink *sink)
{
}

#include "boundary/visit.h"

/* One work-item takes the lower half of one entry.  rows: (n,) int64; faces: (n,) int32. */
__kernel void take_low(
    const ulong n, const __global long *restrict rows, __global int *restrict faces)
{
    const ulong id = get_global_id(0);
    if (id < n) faces[id] = (int)rows[id];
}
