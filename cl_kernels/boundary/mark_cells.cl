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

#define MARKS_FACES
static inline void mark_face(
    Sink *sink, const int3 first, const int z, const ulong face, const ulong triangle)
{
    ulong left = face;
    ulong row = (ulong)z * sink->rows + first.y;
    const uint at = (uint)first.x % 32;
    for (int y = 0; left; ++y, left >>= 8, ++row) {
        const ulong bits = (left & 255) << at;
        __global uint *word = sink->marks + row * sink->row_words + (first.x >> 5);
        if ((uint)bits) set_bit(sink, word, (uint)bits);
        if (bits >> 32) set_bit(sink, word + 1, (uint)(bits >> 32));
    }
}

#else

#include "common/bricks.h"

/* Cells that lie in one brick share what is known of the cell above; a triangle lies across few of
 * those, but its rows go to and fro between them.  Of eight that meet in a corner, each has its
 * place. */
#define KNOWN 8
#define NOTHING_KNOWN \
    { ULONG_MAX, ULONG_MAX, ULONG_MAX, ULONG_MAX, ULONG_MAX, ULONG_MAX, ULONG_MAX, ULONG_MAX }

#define SINK_PARAMETERS TREE_PARAMETERS, __global uint *marks
#define MAKE_SINK(grid) { TREE, marks, marks, 0, NOTHING_KNOWN }
typedef struct {
    Tree tree;
    __global uint *marks;
    __global uint *word;
    uint bits;
    ulong above[KNOWN];
    uint brick[KNOWN];
} Sink;

GATHER_BITS

#if BRICK_X == 8 && BRICK_Y == 8 && BRICK_Z == 8

#define MARKS_FACES
static inline void mark_part(Sink *sink, const ulong bits, const uint x, const uint y, const uint z)
{
    if (!bits) return;
    const uint above_z = z / 8;
    const ulong above = ((ulong)above_z << 20 | y) << 20 | x;
    const uint place = (above_z % 2 * 2 + y % 2) * 2 + x % 2;
    if (sink->above[place] != above) {
        sink->above[place] = above;
        sink->brick[place] = find_brick(sink->tree, x, y, above_z);
    }
    const uint brick = sink->brick[place];
    if (brick == NO_BRICK) return;
    __global uint *word = sink->marks + (ulong)brick * BRICK_WORDS + z % 8 * 2;
    if ((uint)bits) set_bit(sink, word, (uint)bits);
    if (bits >> 32) set_bit(sink, word + 1, (uint)(bits >> 32));
}

static inline void mark_face(
    Sink *sink, const int3 first, const int z, const ulong face, const ulong triangle)
{
    const int x = first.x & 7, y = 8 * (first.y & 7);
    const int above_x = first.x >> 3, above_y = first.y >> 3;
    const ulong left = (face << x) & ((255u << x) & 255u) * 0x0101010101010101UL;
    const ulong right = (face >> (8 - x)) & (255u >> (8 - x)) * 0x0101010101010101UL;
    mark_part(sink, left << y, above_x, above_y, z);
    mark_part(sink, right << y, above_x + 1, above_y, z);
    mark_part(sink, (left >> 1) >> (63 - y), above_x, above_y + 1, z);
    mark_part(sink, (right >> 1) >> (63 - y), above_x + 1, above_y + 1, z);
}

#endif

static inline void mark(Sink *sink, const int3 cell, const ulong triangle)
{
    /* Unsigned, so that powers of two are shifted. */
    const uint x = (uint)cell.x, y = (uint)cell.y, z = (uint)cell.z;
    const uint above_x = x / BRICK_X, above_y = y / BRICK_Y, above_z = z / BRICK_Z;
    const ulong above = ((ulong)above_z << 20 | above_y) << 20 | above_x;
    const uint place = (above_z % 2 * 2 + above_y % 2) * 2 + above_x % 2;
    if (sink->above[place] != above) {
        sink->above[place] = above;
        sink->brick[place] = find_brick(sink->tree, above_x, above_y, above_z);
    }
    const uint brick = sink->brick[place];
    if (brick == NO_BRICK) return;
    const uint bit = ((z - above_z * BRICK_Z) * BRICK_Y + (y - above_y * BRICK_Y)) * BRICK_X
                   + (x - above_x * BRICK_X);
    set_bit(sink, sink->marks + (ulong)brick * BRICK_WORDS + bit / 32, 1u << (bit % 32));
}

#endif

#include "boundary/visit.h"
