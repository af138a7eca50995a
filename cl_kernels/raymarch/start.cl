/*
 * raymarch/start.cl: how far the rays of a tile can go before any of them may meet something.
 *
 * A beam: the four rays at the corners of a tile stand for all of it.  As long as everything within
 * some distance is empty, the beam goes on; it stays on the safe side of float32's errors.
 *
 * Host:       clvox/ops/beams.py, find_starts()
 * Reference:  clvox/reference/raymarch.py, first_voxels(), with which starts must not interfere
 * Tests:      tests/kernels/test_distances.py
 * Defines:    TILE  rays along the side of a tile
 *             MOST  largest distance
 */
#include "raymarch/rays.h"
#include "raymarch/states.h"

/* More than float32 and the rounding of directions are off, in blocks; and more than float32 is off
 * at a distance, as a part of it. */
#define SLACK 0.06f
#define FAR_SLACK 0x1p-21f
#define STEPS 192

/* How far everything around a place is empty along one axis, if so many blocks are. */
static inline float beyond(const float at, const int count)
{
    return fmax(-at, at - (float)count);
}

static inline float most_of(const float4 parts)
{
    return fmax(parts.x, fmax(parts.y, parts.z));
}

/* One work-item follows one tile.
 * size: rays along a row and a column; blocks: shape of the grid of blocks; per_block: steps along
 * the sides of a block; end: in directions, where all rays are past the grid.
 * distances: (blocks,) uint8 (raymarch/states.h).
 * starts: (tiles,) float32, in directions; INFINITY for a miss. */
__kernel void find_starts(
    const int2 size, const int4 blocks, const float4 per_block, const float end, RAY_PARAMETERS,
    const __global uchar *restrict distances, __global float *restrict starts)
{
    const int tiles_x = (size.x + TILE - 1) / TILE, tiles_y = (size.y + TILE - 1) / TILE;
    const ulong id = get_global_id(0);
    if (id >= (ulong)tiles_x * tiles_y) return;
    const int tile_y = (int)(id / tiles_x), tile_x = (int)(id - (ulong)tile_y * tiles_x);
    /* The middle one of the rays at the corners, and how far the others are from it. */
    float4 low = (float4)(INFINITY), high = -low, slow = low, fast = high;
    for (int corner = 0; corner < 4; ++corner) {
        const int u = min(tile_x * TILE + (corner & 1) * (TILE - 1), size.x - 1);
        const int v = min(tile_y * TILE + (corner >> 1) * (TILE - 1), size.y - 1);
        const float4 at = (float4)((float)PLACE_OF(x, u, v), (float)PLACE_OF(y, u, v),
                                   (float)PLACE_OF(z, u, v), 0.0f) / per_block;
        const float4 go = (float4)((float)DIRECTION_OF(x, u, v), (float)DIRECTION_OF(y, u, v),
                                   (float)DIRECTION_OF(z, u, v), 0.0f) / per_block;
        low = fmin(low, at);
        high = fmax(high, at);
        slow = fmin(slow, go);
        fast = fmax(fast, go);
    }
    const float4 at = 0.5f * (low + high), go = 0.5f * (slow + fast);
    const float wide = most_of(0.5f * (high - low)), wider = most_of(0.5f * (fast - slow));
    const float fastest = most_of(fmax(fabs(slow), fabs(fast)));
    float t = 0.0f;
    for (int step = 0; step < STEPS; ++step) {
        const float x = at.x + t * go.x, y = at.y + t * go.y, z = at.z + t * go.z;
        const float outside = fmax(
            beyond(x, blocks.x), fmax(beyond(y, blocks.y), beyond(z, blocks.z)));
        /* Going to the nearest place within the grid brings nothing that is in it farther away. */
        const float in_x = clamp(x, 0.0f, (float)blocks.x), in_y = clamp(y, 0.0f, (float)blocks.y);
        const float in_z = clamp(z, 0.0f, (float)blocks.z);
        const int i = min((int)in_x, blocks.x - 1), j = min((int)in_y, blocks.y - 1);
        const int k = min((int)in_z, blocks.z - 1);
        const int near = distances[((ulong)k * blocks.y + j) * blocks.x + i];
        const int distance = near < INSIDE_STATE ? near : 0;
        const float rest =
            fmin(fmin(fmin(in_x - i, i + 1 - in_x), fmin(in_y - j, j + 1 - in_y)),
                 fmin(in_z - k, k + 1 - in_z));
        const float safe =
            fmax(outside, distance == 0 ? 0.0f : (float)(distance - 1) + fmax(rest, 0.0f));
        const float slack = SLACK + FAR_SLACK * (most_of(fabs(at)) + t * fastest);
        const float gain = safe - (wide + t * wider) - slack;
        if (gain <= SLACK) break;
        t += gain / fastest;
        if (t > end) break;
    }
    starts[id] = t > end ? INFINITY : t;
}
