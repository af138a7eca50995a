/*
 * raymarch/slope.h: the normal of a surface, from the voxels around a place.
 *
 * Each voxel pulls towards itself, by its distance from the place and by a weight that falls to 0
 * at the window's end along each axis: so the normal turns smoothly as the place moves, from voxel
 * to voxel, too.  The weight is a product of one for each axis; hence the sum over the window goes
 * row by row, eight voxels at a time.
 *
 * Defines:    WINDOW  voxels looked at on each side, at most 3
 */
#ifndef CLVOX_SLOPE_H
#define CLVOX_SLOPE_H

#include "raymarch/around.h"

#define ROWS (2 * WINDOW + 1)

/* Weight of a voxel `away` from the place along one axis. */
static inline float share_of(const float away)
{
    const float reach = WINDOW + 0.5f;
    const float share = fmax(1.0f - away * away / (reach * reach), 0.0f);
    return share * share;
}

/* rows: of ROWS x ROWS rows, z before y, the bits of the ROWS voxels from `first` on. */
static inline void read_around(
    const int4 shape, MODEL_PARAMETERS, const int4 first, uchar *rows)
{
    const int from_x = max(first.x, 0), to_x = min(first.x + ROWS, shape.x);
    const int from_y = max(first.y, 0), to_y = min(first.y + ROWS, shape.y);
    const int from_z = max(first.z, 0), to_z = min(first.z + ROWS, shape.z);
    for (int i = 0; i < ROWS * ROWS; ++i) rows[i] = 0;
    if (from_x >= to_x) return;
#if LEVELS == 1
    for (int z = from_z; z < to_z; ++z)
        for (int y = from_y; y < to_y; ++y)
            rows[(z - first.z) * ROWS + y - first.y] =
                row_bits(MODEL_ARGUMENTS, from_x, y, z, to_x - from_x) << (from_x - first.x);
#else
    for (int k = from_z / BRICK_Z; k * BRICK_Z < to_z; ++k)
        for (int j = from_y / BRICK_Y; j * BRICK_Y < to_y; ++j)
            for (int i = from_x / BRICK_X; i * BRICK_X < to_x; ++i) {
                const ulong state = cell_state(MODEL_ARGUMENTS, i, j, k);
                if (state == CELL_OUTSIDE) continue;
                const int x = max(from_x, i * BRICK_X);
                const int count = min(to_x, (i + 1) * BRICK_X) - x;
                const int end_y = min(to_y, (j + 1) * BRICK_Y);
                const int end_z = min(to_z, (k + 1) * BRICK_Z);
                for (int z = max(from_z, k * BRICK_Z); z < end_z; ++z)
                    for (int y = max(from_y, j * BRICK_Y); y < end_y; ++y)
                        rows[(z - first.z) * ROWS + y - first.y] |=
                            cell_bits(bricks, state, x - i * BRICK_X, y - j * BRICK_Y,
                                      z - k * BRICK_Z, count) << (x - first.x);
            }
#endif
}

/* Outward normal, in voxels, at `at` from the centre of `voxel`: not of length 1, but of about 1
 * on a plane, and of less where the voxels say little. */
static inline float4 slope_at(const int4 shape, MODEL_PARAMETERS, const int4 voxel, const float4 at)
{
    uchar rows[ROWS * ROWS];
    const int4 first = voxel - (int4)(WINDOW, WINDOW, WINDOW, 0);
    read_around(shape, MODEL_ARGUMENTS, first, rows);
    float share_y[ROWS], pull_y[ROWS];
    float all_y = 0.0f, far_y = 0.0f, all_z = 0.0f, far_z = 0.0f;
    for (int i = 0; i < ROWS; ++i) {
        const float away = (float)(i - WINDOW) - at.y;
        share_y[i] = share_of(away);
        pull_y[i] = share_y[i] * away;
        all_y += share_y[i];
        far_y += fabs(pull_y[i]);
    }
    const int8 number = (int8)(0, 1, 2, 3, 4, 5, 6, 7);
    /* Of each column along x: its weight, and how it pulls along y and z. */
    float8 held = (float8)(0.0f), back = (float8)(0.0f), up = (float8)(0.0f);
    for (int k = 0; k < ROWS; ++k) {
        float8 held_here = (float8)(0.0f), back_here = (float8)(0.0f);
        for (int j = 0; j < ROWS; ++j) {
            const int8 bits = ((int8)((int)rows[k * ROWS + j]) >> number) & (int8)(1);
            const float8 solid = convert_float8(bits);
            held_here += solid * share_y[j];
            back_here += solid * pull_y[j];
        }
        const float away = (float)(k - WINDOW) - at.z, share = share_of(away);
        all_z += share;
        far_z += share * fabs(away);
        held += held_here * share;
        back += back_here * share;
        up += held_here * (share * away);
    }
    const float8 away = convert_float8(number) - (WINDOW + at.x);
    const float reach = WINDOW + 0.5f;
    const float8 rest = fmax((float8)(1.0f) - away * away / (reach * reach), (float8)(0.0f));
    const float8 share = rest * rest;
    const float8 far = share * fabs(away);
    const float all_x = share.s0 + share.s1 + share.s2 + share.s3 + share.s4 + share.s5 + share.s6
                      + share.s7;
    const float far_x = far.s0 + far.s1 + far.s2 + far.s3 + far.s4 + far.s5 + far.s6 + far.s7;
    const float8 x = held * share * away, y = back * share, z = up * share;
    /* A half space has half of it all. */
    const float pull_x = x.s0 + x.s1 + x.s2 + x.s3 + x.s4 + x.s5 + x.s6 + x.s7;
    const float sum_y = y.s0 + y.s1 + y.s2 + y.s3 + y.s4 + y.s5 + y.s6 + y.s7;
    const float sum_z = z.s0 + z.s1 + z.s2 + z.s3 + z.s4 + z.s5 + z.s6 + z.s7;
    return (float4)(-2.0f * pull_x / (far_x * all_y * all_z),
                    -2.0f * sum_y / (all_x * far_y * all_z),
                    -2.0f * sum_z / (all_x * all_y * far_z), 0.0f);
}

#endif
