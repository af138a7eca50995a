/*
 * common/index.h: from the number of an item of a box to its place.
 */
#ifndef CLVOX_INDEX_H
#define CLVOX_INDEX_H

/* Place along the fastest axis, of `count` items; leaves in *number what counts along the others.
 *
 * A remainder by subtraction: where quotient and remainder are both asked for, compilers put in an
 * instruction that Oclgrind does not know. */
static inline int take_place(ulong *number, const int count)
{
    const ulong rest = *number / count;
    const int place = (int)(*number - rest * count);
    *number = rest;
    return place;
}

/* Which of the `side` places of its cell a voxel, or a cell of a larger one, has. */
static inline int place_in(const int at, const int side)
{
    return at - at / side * side;
}

#endif
