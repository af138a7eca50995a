/*
 * boundary/mark_cells.cl: the bit of every cell that some triangle touches.
 *
 * Cells are those of a coarse grid, or the smaller ones in the bricks above which a tree stands:
 * voxels, or cells of the middle level.
 *
 * Host:       clvox/ops/boundary.py
 * Reference:  clvox/reference/boundary.py
 * Tests:      tests/kernels/test_boundary.py
 * Defines:    STEP_BITS  log2 of the lattice steps in one voxel
 *             CELL_X, CELL_Y, CELL_Z  sides of a cell, in voxels
 *             SINK       0: CELLS, one bit per cell, rows padded to words;
 *                        1: VOXELS, in the bricks of a model
 *             RUN, DIRECT, TILE  (boundary/visit.h)
 *             ATOMIC_LOADS  if defined, OpenCL C 3.0 with atomic_load_explicit() (for CELLS)
 *             LEVELS, BRICK_*, MIDDLE_*  of the model, for the sink VOXELS (common/bricks.h)
 * Source:     separating axes in projections after M. Schwarz, H.-P. Seidel, "Fast parallel
 *             surface and solid voxelization on GPUs", ACM TOG 29(6), 2010, in integers.
 */
#include "common/tiles.h"
#include "boundary/overlap.h"

#define CELLS 0
#define VOXELS 1

/* Neighbouring cells often share a word: its bits are gathered, and written when another word's
 * turn comes. */
#define GATHER_BITS \
    static inline void finish(const Sink *sink) \
    { \
        if (sink->bits) atomic_or(sink->word, sink->bits); \
    } \
    static inline void set_bit(Sink *sink, __global uint *word, const uint bit) \
    { \
        if (word != sink->word) { \
            finish(sink); \
            sink->word = word; \
            sink->bits = 0; \
        } \
        sink->bits |= bit; \
    }

#if SINK == CELLS

#define IDEMPOTENT
#define SINK_PARAMETERS __global uint *marks
#define MAKE_SINK(grid) { marks, (grid).y, ((grid).x + 31) / 32, marks, 0 }
typedef struct {
    __global uint *marks;
    int rows, row_words;
    __global uint *word;
    uint bits;
} Sink;

#ifdef ATOMIC_LOADS

/* Many triangles touch a cell: looking first, be the answer late, saves nearly all atomics. */
static inline void set_bit(Sink *sink, __global uint *word, const uint bit)
{
    const uint seen = atomic_load_explicit(
        (volatile __global atomic_uint *)word, memory_order_relaxed, memory_scope_device);
    if (bit & ~seen) atomic_or(word, bit);
}

static inline void finish(const Sink *sink) {}

#else

GATHER_BITS

#endif

static inline void mark_if(
    Sink *sink, const bool touches, const int3 cell, const ulong triangle)
{
    const ulong row = (ulong)cell.z * sink->rows + cell.y;
    const uint x = (uint)cell.x;
    set_bit(sink, sink->marks + row * sink->row_words + x / 32, (uint)touches << (x % 32));
}

static inline void mark(Sink *sink, const int3 cell, const ulong triangle)
{
    mark_if(sink, true, cell, triangle);
}

#else

#include "common/bricks.h"

#define SINK_PARAMETERS TREE_PARAMETERS, __global uint *marks
#define MAKE_SINK(grid) { TREE, marks, (int3)(-1), NO_BRICK, marks, 0 }
typedef struct {
    Tree tree;
    __global uint *marks;
    int3 above;  /* the cell looked up last, since neighbouring voxels share it */
    uint brick;
    __global uint *word;
    uint bits;
} Sink;

GATHER_BITS

static inline void mark(Sink *sink, const int3 cell, const ulong triangle)
{
    const int3 sides = (int3)(BRICK_X, BRICK_Y, BRICK_Z);
    const int3 above = cell / sides;
    if (any(above != sink->above)) {
        sink->above = above;
        sink->brick = find_brick(sink->tree, above.x, above.y, above.z);
    }
    if (sink->brick == NO_BRICK) return;
    const int3 at = cell - above * sides;
    const int bit = (at.z * BRICK_Y + at.y) * BRICK_X + at.x;
    set_bit(sink, sink->marks + (ulong)sink->brick * BRICK_WORDS + bit / 32, 1u << (bit % 32));
}

#endif

#include "boundary/visit.h"
