/*
 * raymarch/start.cl: how far the rays of a tile can go before any of them may meet something.
 *
 * A beam: the four rays at the corners of a tile stand for all of it.  As long as everything within
 * some distance is empty, the beam goes on; it stays on the safe side of float32's errors.
 *
 * Host:       clvox/ops/raymarch.py, find_starts()
 * Reference:  clvox/reference/raymarch.py, first_voxels(), with which starts must not interfere
 * Tests:      tests/kernels/test_distances.py
 * Defines:    TILE  rays along the side of a tile
 *             MOST  largest distance
 */
#include "raymarch/rays.h"

/* More than float32 and the rounding of directions are off, in blocks. */
#define SLACK 0.06f
#define STEPS 192

/* How far everything around a place is empty along one axis, if so many blocks are. */
static inline float beyond(const float at, const int count)
{
    return fmax(-at, at - (float)count);
}

/* One work-item follows one tile.
 * size: rays along a row and a column; blocks: shape of the grid of blocks; per_block: steps along
 * the sides of a block; end: in directions, where all rays are past the grid.
 * distances: (blocks,) uint8.  starts: (tiles,) float32, in directions; INFINITY for a miss. */
__kernel void find_starts(
    const int2 size, const int4 blocks, const float4 per_block, const float end, RAY_PARAMETERS,
    const __global uchar *restrict distances, __global float *restrict starts)
{
    const int tiles_x = (size.x + TILE - 1) / TILE, tiles_y = (size.y + TILE - 1) / TILE;
    const ulong id = get_global_id(0);
    if (id >= (ulong)tiles_x * tiles_y) return;
    const int tile_y = (int)(id / tiles_x), tile_x = (int)(id - (ulong)tile_y * tiles_x);
    float at_x[4], at_y[4], at_z[4], go_x[4], go_y[4], go_z[4];
    float fastest = 0.0f;
    for (int corner = 0; corner < 4; ++corner) {
        const int u = min(tile_x * TILE + (corner & 1) * (TILE - 1), size.x - 1);
        const int v = min(tile_y * TILE + (corner >> 1) * (TILE - 1), size.y - 1);
        at_x[corner] = (float)PLACE_OF(x, u, v) / per_block.x;
        at_y[corner] = (float)PLACE_OF(y, u, v) / per_block.y;
        at_z[corner] = (float)PLACE_OF(z, u, v) / per_block.z;
        go_x[corner] = (float)DIRECTION_OF(x, u, v) / per_block.x;
        go_y[corner] = (float)DIRECTION_OF(y, u, v) / per_block.y;
        go_z[corner] = (float)DIRECTION_OF(z, u, v) / per_block.z;
        fastest = fmax(fastest, fmax(fabs(go_x[corner]),
                                     fmax(fabs(go_y[corner]), fabs(go_z[corner]))));
    }
    float t = 0.0f;
    for (int step = 0; step < STEPS; ++step) {
        float x = 0.0f, y = 0.0f, z = 0.0f, wide = 0.0f;
        for (int corner = 0; corner < 4; ++corner) {
            x += 0.25f * (at_x[corner] + t * go_x[corner]);
            y += 0.25f * (at_y[corner] + t * go_y[corner]);
            z += 0.25f * (at_z[corner] + t * go_z[corner]);
        }
        for (int corner = 0; corner < 4; ++corner) {
            wide = fmax(wide, fabs(at_x[corner] + t * go_x[corner] - x));
            wide = fmax(wide, fabs(at_y[corner] + t * go_y[corner] - y));
            wide = fmax(wide, fabs(at_z[corner] + t * go_z[corner] - z));
        }
        const float outside = fmax(
            beyond(x, blocks.x), fmax(beyond(y, blocks.y), beyond(z, blocks.z)));
        /* Going to the nearest place within the grid brings nothing that is in it farther away. */
        const float in_x = clamp(x, 0.0f, (float)blocks.x), in_y = clamp(y, 0.0f, (float)blocks.y);
        const float in_z = clamp(z, 0.0f, (float)blocks.z);
        const int i = min((int)in_x, blocks.x - 1), j = min((int)in_y, blocks.y - 1);
        const int k = min((int)in_z, blocks.z - 1);
        const int distance = distances[((ulong)k * blocks.y + j) * blocks.x + i];
        const float rest =
            fmin(fmin(fmin(in_x - i, i + 1 - in_x), fmin(in_y - j, j + 1 - in_y)),
                 fmin(in_z - k, k + 1 - in_z));
        const float safe =
            fmax(outside, distance == 0 ? 0.0f : (float)(distance - 1) + fmax(rest, 0.0f));
        const float gain = safe - wide - SLACK;
        if (gain <= SLACK) break;
        t += gain / fastest;
        if (t > end) break;
    }
    starts[id] = t > end ? INFINITY : t;
}
