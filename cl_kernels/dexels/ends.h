/*
 * dexels/ends.h: ends of pieces of rays, counted first and then written.
 *
 * A kernel that makes ends is built twice: the first pass counts those of each ray, the second,
 * once the counts are scanned, writes them to where they belong.  Both walk alike.
 *
 * Defines:    PASS  0: COUNT, 1: WRITE
 */
#ifndef CLVOX_ENDS_H
#define CLVOX_ENDS_H

#define COUNT 0
#define WRITE 1

/* Triangle of an end where the face of the grid's box cuts the solid. */
#define CAP 0x7fffffffu

#if PASS == COUNT

/* counts: (rays,) uint32, undefined on entry. */
#define ENDS_PARAMETERS __global uint *restrict counts
#define MAKE_ENDS(ray) { 0 }
#define FINISH_ENDS(ends, ray) counts[ray] = (ends).count
typedef struct {
    uint count;
} Ends;

static inline void put_end(Ends *ends, const int depth, const uint triangle, const bool goes_in)
{
    ++ends->count;
}

#else

/* starts: where each ray's ends begin.  made_depths, made_sides: depth, and triangle * 2 + (1 if
 * the ray goes in), undefined on entry. */
#define ENDS_PARAMETERS \
    const __global ulong *restrict starts, \
    __global int *restrict made_depths, __global uint *restrict made_sides
#define MAKE_ENDS(ray) { made_depths + starts[ray], made_sides + starts[ray] }
#define FINISH_ENDS(ends, ray)
typedef struct {
    __global int *depth;
    __global uint *side;
} Ends;

static inline void put_end(Ends *ends, const int depth, const uint triangle, const bool goes_in)
{
    *ends->depth++ = depth;
    *ends->side++ = triangle << 1 | goes_in;
}

#endif
#endif
