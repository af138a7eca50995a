/*
 * crossings/sinks.h: what becomes of a crossing.
 *
 * A sink is a type Sink with the function cross(); SINK_PARAMETERS are its kernel arguments and
 * MAKE_SINK gathers them, for the rays of a window (first u, first v, last u, last v).  begin()
 * tells it of each triangle that is cast.  COUNT, DENSE and BRICKS commute and what EMIT lists is
 * sorted afterwards, so the order of the triangles never shows.
 *
 * Defines:    SINK  COUNT, DENSE, BRICKS or EMIT; WIDE; and what these need: see cast_rays.cl
 */
#ifndef CLVOX_SINKS_H
#define CLVOX_SINKS_H

#define COUNT 0
#define DENSE 1
#define BRICKS 2
#define EMIT 3

#if SINK == COUNT || SINK == EMIT

/* Number of a ray in its window; the later of the two axes across the rays is the slowest. */
static inline ulong ray_number(const int4 window, const int u, const int v)
{
#if AXIS == 1
    return (ulong)(u - window.x) * (window.w - window.y + 1) + (v - window.y);
#else
    return (ulong)(v - window.y) * (window.z - window.x + 1) + (u - window.x);
#endif
}

#endif

#if SINK == COUNT

/* counts: crossings per ray, added to. */
#define SINK_PARAMETERS __global uint *counts
#define MAKE_SINK(window) { window, counts }
typedef struct {
    int4 window;
    __global uint *counts;
} Sink;

static inline void cross(Sink *sink, const int u, const int v, const int slot)
{
    atomic_inc(sink->counts + ray_number(sink->window, u, v));
}

#elif SINK == EMIT

/* starts: where each ray's row begins; left: how many crossings of the ray are still to come, at
 * first all.  rows: crossings, each as depth * 2^32 + triangle * 2 + (1 if the ray goes in). */
#define SINK_PARAMETERS \
    const __global ulong *starts, __global uint *left, __global long *rows
#define MAKE_SINK(window) { window, starts, left, rows, 0 }
typedef struct {
    int4 window;
    const __global ulong *starts;
    __global uint *left;
    __global long *rows;
    uint side;
} Sink;

static inline void begin(Sink *sink, const ulong triangle, const bool flipped)
{
    sink->side = (uint)triangle << 1 | flipped;
}

/* depth: fixed point in voxels, FRACTION_BITS after the point, rounded up. */
static inline void cross(Sink *sink, const int u, const int v, const int depth)
{
    const ulong ray = ray_number(sink->window, u, v);
    const ulong at = sink->starts[ray] + (atomic_dec(sink->left + ray) - 1);
    sink->rows[at] = (long)((ulong)(uint)depth << 32 | sink->side);
}

#elif SINK == DENSE

/* Rays along y: u is z and v is x.  The bit flipped is that of the first voxel after the crossing.
 * voxels: bits, rows padded to words.
 * beyond: a bit per ray, (z, x), for crossings past the end. */
#define SINK_PARAMETERS \
    const int depth, const int row_words, __global uint *voxels, __global uint *beyond
#define MAKE_SINK(window) { depth, row_words, voxels, beyond }
typedef struct {
    int depth, row_words;
    __global uint *voxels;
    __global uint *beyond;
} Sink;

static inline void cross(Sink *sink, const int u, const int v, const int slot)
{
    __global uint *row = slot >= sink->depth
        ? sink->beyond + (ulong)u * sink->row_words
        : sink->voxels + ((ulong)u * sink->depth + max(slot, 0)) * sink->row_words;
    atomic_xor(row + (uint)v / 32, 1u << ((uint)v % 32));
}

#elif SINK == BRICKS

#include "common/index.h"
#include "crossings/known.h"

/* Rays along y: u is z and v is x.
 * columns: cells of voxels along each axis.  The tree above the bricks: common/bricks.h.
 * entry, beyond: a face per column of cells along y, (z, x), for crossings before the first sample
 * and past the last.  exits: a face per brick, for crossings in the last half voxel of its cell
 * when no brick follows.  All three are of a slab, whose cells begin at z = first_layer and whose
 * bricks begin with first_brick; no ray is in another. */
#define SINK_PARAMETERS \
    const int4 columns, TREE_PARAMETERS, const int first_layer, const uint first_brick, \
    __global uint *bricks, __global uint *exits, __global uint *entry, __global uint *beyond
#define MAKE_SINK(window) \
    { TREE, columns, first_layer, first_brick, bricks, exits, entry, beyond, \
      { { 0 } } }
typedef struct {
    Tree tree;
    int4 columns;
    int first_layer;
    uint first_brick;
    __global uint *bricks;
    __global uint *exits;
    __global uint *entry;
    __global uint *beyond;
    Known known;
} Sink;

/* A crossing that no brick holds. */
static void cross_outside(Sink *sink, const uint u, const uint v, const int slot)
{
    const uint x = v / BRICK_X;
    const uint z = u / BRICK_Z;
    const uint y = (uint)max(slot, 0) / BRICK_Y;
    const uint ray = (u - z * BRICK_Z) * BRICK_X + (v - x * BRICK_X);
    const ulong column = ((ulong)(z - sink->first_layer) * sink->columns.x + x) * FACE_WORDS;
    __global uint *face;
    if (slot <= 0) {
        face = sink->entry + column;
    } else if (y >= (uint)sink->columns.y) {
        face = sink->beyond + column;
    } else {
        /* The cell of the first sample behind the crossing is untouched: the crossing lies in the
         * last half voxel of the cell before, which is touched, or before the grid. */
        const uint before = y ? find_brick(sink->tree, x, y - 1, z) : NO_BRICK;
        face = before == NO_BRICK
            ? sink->entry + column
            : sink->exits + (ulong)(before - sink->first_brick) * FACE_WORDS;
    }
    atomic_xor(face + ray / 32, 1u << (ray % 32));
}

/* Flips bits, of one word of a brick that its cell does not have, in faces. */
static void flip_outside(Sink *sink, const ulong id, const uint bits)
{
    for (uint left = bits; left; left &= left - 1) {
        ulong voxel = 32 * (id & 0x1fff) + popcount((left & -left) - 1);
        const int in_x = take_place(&voxel, BRICK_X);
        const int in_y = take_place(&voxel, BRICK_Y);
        cross_outside(sink, Z_OF(id) * BRICK_Z + (uint)voxel, X_OF(id) * BRICK_X + in_x,
                      (int)(Y_OF(id) * BRICK_Y) + in_y);
    }
}

/* Two words, of which `bits` has the first in its lower half: by one 64-bit atomic, where the
 * device has it.  Bricks of two words are then changed by such atomics only, since atomics of
 * different widths on one place are undefined. */
#if defined(cl_khr_int64_extended_atomics) && BRICK_WORDS == 2
#pragma OPENCL EXTENSION cl_khr_int64_extended_atomics : enable
#define FLIPS_PAIRS 1
static inline void flip_brick(__global uint *brick, const ulong bits)
{
    atom_xor((volatile __global ulong *)brick, bits);
}
#else
#define FLIPS_PAIRS 0
#endif

/* Flips bits of one word of a cell's brick; or, if the cell has none, of faces. */
static inline void flip_word(Sink *sink, const ulong id, const uint bits)
{
    const uint number = known_brick(&sink->known, sink->tree, id);
    if (number == NO_BRICK) {
        flip_outside(sink, id, bits);
        return;
    }
    __global uint *brick = sink->bricks + (ulong)number * BRICK_WORDS;
#if FLIPS_PAIRS
    flip_brick(brick, (ulong)bits << 32 * (id & 1));
#else
    atomic_xor(brick + (id & 0x1fff), bits);
#endif
}

/* The same of two words of one brick, `second` words apart; the lower bits are those of the first,
 * whose id is given. */
static inline void flip_pair(Sink *sink, const ulong id, const uint second, const ulong bits)
{
    const uint number = known_brick(&sink->known, sink->tree, id);
    const uint lower = (uint)bits, upper = (uint)(bits >> 32);
    if (number == NO_BRICK) {
        flip_outside(sink, id, lower);
        flip_outside(sink, id + second, upper);
        return;
    }
    __global uint *brick = sink->bricks + (ulong)number * BRICK_WORDS;
#if FLIPS_PAIRS
    flip_brick(brick, bits);
#else
    if (lower) atomic_xor(brick + (id & 0x1fff), lower);
    if (upper) atomic_xor(brick + (id & 0x1fff) + second, upper);
#endif
}

#define GATHERS
#define MOST_GATHERED 32

/* Neighbouring crossings are often in the same word: flips of one are gathered, without a branch,
 * since nobody could foresee it. */
static inline void cross_all(
    Sink *sink, const uint count, const int *us, const int *vs, const int *slots)
{
    ulong ids[MOST_GATHERED];
    uint bits[MOST_GATHERED];
    for (uint i = 0; i < count; ++i) {
        const uint u = (uint)us[i], v = (uint)vs[i], at = (uint)max(slots[i], 0);
        /* Unsigned, so that powers of two are shifted. */
        const uint x = v / BRICK_X, y = at / BRICK_Y, z = u / BRICK_Z;
        const uint voxel = ((u - z * BRICK_Z) * BRICK_Y + (at - y * BRICK_Y)) * BRICK_X
                         + (v - x * BRICK_X);
        ids[i] = WORD_OF(x, y, z, voxel / 32);
        bits[i] = 1u << (voxel % 32);
    }
    uint words = 0, gathered = 0;
    ulong last = ULONG_MAX;
    const int end = sink->columns.y * BRICK_Y;
    for (uint i = 0; i < count; ++i) {
        if (slots[i] <= 0 || slots[i] >= end) {
            cross_outside(sink, us[i], vs[i], slots[i]);
            continue;
        }
        const ulong id = ids[i];
        const bool same = id == last;
        gathered = (same ? gathered : 0) ^ bits[i];
        words += !same;
        ids[words - 1] = last = id;
        bits[words - 1] = gathered;
    }
    for (uint i = 0; i < words; ++i) flip_word(sink, ids[i], bits[i]);
}

static inline void cross(Sink *sink, const int u, const int v, const int slot)
{
    cross_all(sink, 1, &u, &v, &slot);
}

#endif

#if SINK != EMIT
static inline void begin(Sink *sink, const ulong triangle, const bool flipped) {}
#endif
#endif
