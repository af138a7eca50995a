/*
 * boundary/mark_cells.cl: the bit of every cell that some triangle touches.
 *
 * Cells are those of a coarse grid, or the smaller ones in the bricks above which a tree stands:
 * voxels, or cells of the middle level.  Each triangle walks the columns of cells in its shadow
 * along the dominant axis of its normal, and its plane bounds the cells of each column: never all
 * cells of its box.  A triangle within one row or one layer of cells takes a shorter way.
 *
 * Host:       clvox/ops/boundary.py
 * Reference:  clvox/reference/boundary.py
 * Tests:      tests/kernels/test_boundary.py
 * Defines:    STEP_BITS  log2 of the lattice steps in one voxel
 *             CELL_X, CELL_Y, CELL_Z  sides of a cell, in voxels
 *             SINK       0: CELLS, one bit per cell, rows padded to words;
 *                        1: VOXELS, in the bricks of a model
 *             RUN        triangles in a row that one work-item does directly
 *             DIRECT     most columns of a triangle that is done directly
 *             TILE       most rows of a tile (common/tiles.h)
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
#define GATHER_MARKS \
    static inline void finish(Sink *sink) \
    { \
        if (sink->bits) atomic_or(sink->word, sink->bits); \
    } \
    static inline void set(Sink *sink, __global uint *word, const uint bit) \
    { \
        if (word != sink->word) { \
            finish(sink); \
            sink->word = word; \
            sink->bits = 0; \
        } \
        sink->bits |= bit; \
    }

#if SINK == CELLS

#define SINK_PARAMETERS __global uint *marks
#define MAKE_SINK(grid) { marks, (grid).y, ((grid).x + 31) / 32, marks, 0 }
typedef struct {
    __global uint *marks;
    int rows, row_words;
    __global uint *word;
    uint bits;
} Sink;

GATHER_MARKS

static inline void mark(Sink *sink, const int3 cell)
{
    const ulong row = (ulong)cell.z * sink->rows + cell.y;
    set(sink, sink->marks + row * sink->row_words + cell.x / 32, 1u << (cell.x % 32));
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

GATHER_MARKS

static inline void mark(Sink *sink, const int3 cell)
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
    set(sink, sink->marks + (ulong)sink->brick * BRICK_WORDS + bit / 32, 1u << (bit % 32));
}

#endif

/* The columns of a row, from the first on, that meet the triangle's shadow. */
static inline Span columns_in_row(const Solid *s, const int u, const int first, const int last)
{
    Span span = {0, last - first};
    const int v = first * s->cell.y - HALF_STEP;
    for (int i = 0; i < 3; ++i) {
        const Side side = s->uv[i];
        const long step = (long)side.along_q * s->cell.y;
        narrow(&span, side_of(side, u, v), step, inverse_of(step));
    }
    return span;
}

/* All cells in a box of columns that the triangle touches. */
static void mark_columns(Sink *sink, const Solid *s, const int4 box)
{
    const bool wide = box.w - box.y >= WIDE;
    for (int i = box.x; i <= box.z; ++i) {
        const int u = i * s->cell.x - HALF_STEP;
        const Span span = wide ? columns_in_row(s, u, box.y, box.w) : (Span){0, box.w - box.y};
        for (int j = box.y + span.first; j <= box.y + span.last; ++j) {
            const int v = j * s->cell.y - HALF_STEP;
            if (!column_meets(s, u, v)) continue;
            const int2 depths = depths_in_column(s, u, v);
            for (int k = depths.x; k <= depths.y; ++k)
                if (cell_meets(s, u, v, k * s->cell.z - HALF_STEP))
                    mark(sink, restore((int3)(i, j, k), s->axis));
        }
    }
}

/* All cells that a triangle touches which lies within one layer of cells across `axis`: there its
 * shadow decides.  a, b, c: its corners, across that axis; box: the columns of the layer. */
static void mark_layer(
    Sink *sink, const int2 a, const int2 b, const int2 c, const int axis, const int4 box,
    const int first, const int last)
{
    const int2 cell = permute(CELL_SIDES, axis).xy;
    const long turn = cross2(a, b, c);
    const Side sides[3] = {
        make_side(a, b, turn, cell), make_side(b, c, turn, cell), make_side(c, a, turn, cell)};
    for (int i = box.x; i <= box.z; ++i) {
        const int u = i * cell.x - HALF_STEP;
        for (int j = box.y; j <= box.w; ++j) {
            const int v = j * cell.y - HALF_STEP;
            if (meets(sides[0], u, v) & meets(sides[1], u, v) & meets(sides[2], u, v))
                for (int k = first; k <= last; ++k) mark(sink, restore((int3)(i, j, k), axis));
        }
    }
}

/* All cells that one triangle touches; or false if its columns are too many. */
static bool mark_triangle(
    Sink *sink, const int3 grid, const __global int *faces, const __global int *vertices,
    const ulong triangle)
{
    const int3 a = corner_of(vertices, faces[3 * triangle]);
    const int3 b = corner_of(vertices, faces[3 * triangle + 1]);
    const int3 c = corner_of(vertices, faces[3 * triangle + 2]);
    const int3 low = min(min(a, b), c);
    const int3 high = max(max(a, b), c);
    const int3 first_cell = first_cell_of(low);
    const int3 last_cell = last_cell_of(high);
    const int3 from = max(first_cell, (int3)(0));
    const int3 to = min(last_cell, grid - 1);
    if (to.x < from.x || to.y < from.y || to.z < from.z) return true;
    const int3 more = last_cell - first_cell;
    if ((more.x > 0) + (more.y > 0) + (more.z > 0) <= 1) {
        /* One row of cells holds the whole triangle and is touched at both ends: all of it is. */
        for (int z = from.z; z <= to.z; ++z)
            for (int y = from.y; y <= to.y; ++y)
                for (int x = from.x; x <= to.x; ++x) mark(sink, (int3)(x, y, z));
        return true;
    }
    if (more.x == 0 || more.y == 0 || more.z == 0) {
        const int axis = more.x == 0 ? 0 : more.y == 0 ? 1 : 2;
        const int3 first = permute(from, axis);
        const int3 last = permute(to, axis);
        const int4 box = (int4)(first.x, first.y, last.x, last.y);
        if (!is_small(box)) return false;
        mark_layer(sink, permute(a, axis).xy, permute(b, axis).xy, permute(c, axis).xy, axis,
                   box, first.z, last.z);
        return true;
    }
    Solid s;
    const int4 box = make_solid(&s, faces, vertices, triangle, grid);
    if (!is_small(box)) return false;
    mark_columns(sink, &s, box);
    return true;
}

/* One work-item does RUN triangles in a row, from `first` on: those of few columns; the others it
 * puts on the list.
 * grid: shape of the grid of cells (x, y, z).
 * faces: (m, 3) int32, vertices: (n, 3) int32, on the lattice.
 * listed: (1,) uint32, length of the list, zero before the first launch.
 * list: (m,) uint32, triangle numbers in no particular order. */
__kernel void mark_direct(
    const ulong first, const ulong last, const int4 grid,
    const __global int *restrict faces, const __global int *restrict vertices,
    __global uint *listed, __global uint *list, SINK_PARAMETERS)
{
    const ulong start = first + get_global_id(0) * RUN;
    Sink sink = MAKE_SINK(grid);
    for (ulong triangle = start; triangle < min(start + RUN, last); ++triangle)
        if (!mark_triangle(&sink, grid.xyz, faces, vertices, triangle))
            list[atomic_inc(listed)] = (uint)triangle;
    finish(&sink);
}

static inline int rows_of(const Solid *s, const int4 box)
{
    return rows_in_tile(box, (long)abs(s->nw), s->extent, s->cell.y);
}

/* One work-item counts the tiles of one listed triangle.
 * tiles: (entries,) uint32. */
__kernel void count_tiles(
    const uint entries, const int4 grid,
    const __global int *restrict faces, const __global int *restrict vertices,
    const __global uint *restrict list, __global uint *restrict tiles)
{
    const uint id = get_global_id(0);
    if (id >= entries) return;
    Solid s;
    const int4 box = make_solid(&s, faces, vertices, list[id], grid.xyz);
    tiles[id] = tiles_of(box, rows_of(&s, box));
}

/* One work-item does one tile of columns of one listed triangle.
 * offsets: (entries,) uint64, exclusive prefix sum of the tiles. */
__kernel void mark_tiles(
    const ulong first, const ulong last, const uint entries, const int4 grid,
    const __global int *restrict faces, const __global int *restrict vertices,
    const __global uint *restrict list, const __global ulong *restrict offsets, SINK_PARAMETERS)
{
    const ulong pair = first + get_global_id(0);
    if (pair >= last) return;
    const uint item = entry_of(offsets, entries, pair);
    Solid s;
    const int4 box = make_solid(&s, faces, vertices, list[item], grid.xyz);
    Sink sink = MAKE_SINK(grid);
    mark_columns(&sink, &s, tile_box(box, rows_of(&s, box), (uint)(pair - offsets[item])));
    finish(&sink);
}
