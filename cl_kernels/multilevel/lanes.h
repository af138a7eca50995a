/*
 * multilevel/lanes.h: up to 32 neighbouring rows of cells, walked along y together.
 *
 * The state of a lane's rays is in its face after a brick, and one bit after a cell without a
 * brick: such a cell is touched by no triangle, so all its rays agree on a closed mesh.  Where they
 * do not, the cell is counted as a disagreement.
 */
#ifndef CLVOX_LANES_H
#define CLVOX_LANES_H

#include "multilevel/walk.h"

typedef struct {
    __global uint *faces;  /* one after the other, FACE_WORDS each */
    uint all;              /* a bit for each lane */
    uint faced;            /* whose state is in the face */
    uint uniform;          /* the state of the others */
    uint disagreements;
} Lanes;

static inline int first_lane(const uint lanes)
{
    return popcount((lanes & -lanes) - 1);
}

/* Lanes that start with what is in their faces. */
static inline Lanes start_lanes(__global uint *faces, const int count)
{
    const uint all = (uint)((1UL << count) - 1);
    const Lanes lanes = { faces, all, all, 0, 0 };
    return lanes;
}

/* Past cells without bricks, all but those of `touched`; returns which lanes are inside there. */
static inline uint pass_cells(Lanes *lanes, const uint touched)
{
    for (uint left = lanes->faced & ~touched; left; left &= left - 1) {
        const int lane = first_lane(left);
        const __global uint *face = lanes->faces + lane * FACE_WORDS;
        lanes->uniform = (lanes->uniform & ~(1u << lane)) | (face[0] & 1) << lane;
        if (!is_uniform(face)) ++lanes->disagreements;
    }
    lanes->faced &= touched;
    return lanes->uniform & ~touched & lanes->all;
}

/* Through the bricks of the lanes `touched`; they follow each other, and so do their exits.
 * room: voxels from the lowest corner of lane 0's cell to the end of the grid. */
static inline void pass_bricks(
    Lanes *lanes, const uint touched, __global uint *bricks, const __global uint *exits,
    const int3 room)
{
    uint brick = 0;
    for (uint left = touched; left; left &= left - 1, ++brick) {
        const int lane = first_lane(left);
        __global uint *face = lanes->faces + lane * FACE_WORDS;
        if (!(lanes->faced >> lane & 1)) fill_face(face, lanes->uniform >> lane & 1);
        const int3 kept = min(
            room - (int3)(lane * BRICK_X, 0, 0), (int3)(BRICK_X, BRICK_Y, BRICK_Z));
        walk_brick(bricks + (ulong)brick * BRICK_WORDS, face, exits + (ulong)brick * FACE_WORDS,
                   kept);
    }
    lanes->faced |= touched;
}

/* The rays that end inside, counted: those whose state is not that of `beyond`. */
static inline uint count_odd(const Lanes *lanes, const __global uint *beyond)
{
    uint odd = 0;
    for (uint left = lanes->all; left; left &= left - 1) {
        const int lane = first_lane(left);
        __global uint *face = lanes->faces + lane * FACE_WORDS;
        if (!(lanes->faced >> lane & 1)) fill_face(face, lanes->uniform >> lane & 1);
        for (uint w = 0; w < FACE_WORDS; ++w)
            odd += popcount(face[w] ^ beyond[lane * FACE_WORDS + w]);
    }
    return odd;
}

#endif
