/*
 * common/entries.h: from the number of a work-item to what it works on.
 *
 * A list has entries of different size; their sizes are scanned, and each unit of each entry is a
 * work-item.
 */
#ifndef CLVOX_ENTRIES_H
#define CLVOX_ENTRIES_H

/* The entry of the list to which unit `pair` belongs: the last one whose offset is not above it. */
static inline uint entry_of(const __global ulong *offsets, const uint entries, const ulong pair)
{
    uint low = 0, high = entries;
    while (high - low > 1) {
        const uint middle = low + (high - low) / 2;
        if (offsets[middle] <= pair) low = middle;
        else high = middle;
    }
    return low;
}

#endif
