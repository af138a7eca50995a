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
#include "boundary/block.h"
#include "boundary/overlap.h"

#define CELLS 0
#define VOXELS 1

/* A block brings many bits of a word at once, and one of them is nearly always new: a look at the
 * word first would cost its wait and save nothing. */
static inline void set_bits(__global uint *word, const uint bits)
{
    if (bits) atomic_or(word, bits);
}

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

#define TAKES_BLOCKS

static inline void mark_block(Sink *sink, const Block *block, const ulong triangle)
{
    const int3 first = block->first, from = block->from, to = block->to;
    for (int x = from.x / 32; x <= to.x / 32; ++x) {
        const int shift = first.x - 32 * x;
        const int left = max(shift, 0), right = max(-shift, 0);
        for (int z = from.z; z <= to.z; ++z) {
            const ulong face = block->faces[z - first.z];
            __global uint *word
                = sink->marks + ((ulong)z * sink->rows + from.y) * sink->row_words + x;
            for (int y = from.y; y <= to.y; ++y) {
                const uint row = (uint)(face >> 8 * (y - first.y)) & 255;
                set_bits(word, row << left >> right);
                word += sink->row_words;
            }
        }
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

/* The brick below a cell of the level above. */
static inline uint brick_below(Sink *sink, const uint x, const uint y, const uint z)
{
    const ulong above = ((ulong)z << 20 | y) << 20 | x;
    const uint place = (z % 2 * 2 + y % 2) * 2 + x % 2;
    if (sink->above[place] != above) {
        sink->above[place] = above;
        sink->brick[place] = find_brick(sink->tree, x, y, z);
    }
    return sink->brick[place];
}

static inline void mark(Sink *sink, const int3 cell, const ulong triangle)
{
    /* Unsigned, so that powers of two are shifted. */
    const uint x = (uint)cell.x, y = (uint)cell.y, z = (uint)cell.z;
    const uint above_x = x / BRICK_X, above_y = y / BRICK_Y, above_z = z / BRICK_Z;
    const uint brick = brick_below(sink, above_x, above_y, above_z);
    if (brick == NO_BRICK) return;
    const uint bit = ((z - above_z * BRICK_Z) * BRICK_Y + (y - above_y * BRICK_Y)) * BRICK_X
                   + (x - above_x * BRICK_X);
    set_bit(sink, sink->marks + (ulong)brick * BRICK_WORDS + bit / 32, 1u << (bit % 32));
}

#if BRICK_X == 8 && BRICK_Y == 8 && BRICK_Z == 8

#define TAKES_BLOCKS

/* A face of a brick is two words, and a block lies in eight bricks at most: its faces are shifted
 * to theirs. */
static inline void mark_part(Sink *sink, const Block *block, const int x, const int y, const int z)
{
    const uint brick = brick_below(sink, x, y, z);
    if (brick == NO_BRICK) return;
    const int right_x = 8 * x - block->first.x;
    const int right = 8 * (8 * y - block->first.y) + right_x;
    const uint row = 255u << max(-right_x, 0) >> max(right_x, 0) & 255u;
    __global uint *word = sink->marks + (ulong)brick * BRICK_WORDS;
    const int last = min(block->to.z, 8 * z + 7);
    for (int k = max(block->from.z, 8 * z); k <= last; ++k) {
        const ulong face = block->faces[k - block->first.z] << max(-right, 0) >> max(right, 0);
        const ulong bits = face & row * EACH_BYTE;
        set_bits(word + k % 8 * 2, (uint)bits);
        set_bits(word + k % 8 * 2 + 1, (uint)(bits >> 32));
    }
}

static inline void mark_block(Sink *sink, const Block *block, const ulong triangle)
{
    const int3 from = block->from / 8, to = block->to / 8;
    for (int z = from.z; z <= to.z; ++z)
        for (int y = from.y; y <= to.y; ++y)
            for (int x = from.x; x <= to.x; ++x) mark_part(sink, block, x, y, z);
}

#endif
#endif

#include "boundary/visit.h"
