/*
 * common/index.h: from the number of an item of a box to its place, x fastest.
 */
#ifndef CLVOX_INDEX_H
#define CLVOX_INDEX_H

/* Place of item `id` in a box of (x, y, any number along z) items.  Remainders by subtraction: where
 * a quotient and a remainder are both asked for, compilers put in what Oclgrind does not know. */
static inline int3 index_of(const ulong id, const int x, const int y)
{
    const ulong row = id / x, z = row / y;
    return (int3)((int)(id - row * x), (int)(row - z * y), (int)z);
}

#endif
