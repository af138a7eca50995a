/*
 * raymarch/lanes.h: some rays side by side, as the parts of vectors.
 *
 * Processors add, compare and choose for many rays at once, and have nothing to guess where no
 * ray goes its own way.  A condition is all bits of a part, or none, so that `&` chooses.
 *
 * Defines:    WIDTH  rays side by side: 8, or 1 for devices whose work-items are such lanes
 */
#ifndef CLVOX_LANES_H
#define CLVOX_LANES_H

#if WIDTH == 1

typedef long longs;
typedef float floats;
#define WHERE(condition) (-(long)(condition))
#define AS_LONGS(values) ((long)(values))
#define AS_FLOATS(values) ((float)(values))
#define LOAD(array) ((array)[0])
#define STORE(values, array) ((array)[0] = (values))
#define LOOK_UP(array, at) ((long)(array)[at])
#define ALL_OF(op, values) (values)

#else

typedef long8 longs;
typedef float8 floats;
#define WHERE(condition) (condition)
#define AS_LONGS(values) convert_long8(values)
#define AS_FLOATS(values) convert_float8(values)
#define LOAD(array) vload8(0, array)
#define STORE(values, array) vstore8(values, 0, array)
#define LOOK_UP(array, at) \
    (longs)((array)[(at).s0], (array)[(at).s1], (array)[(at).s2], (array)[(at).s3], \
            (array)[(at).s4], (array)[(at).s5], (array)[(at).s6], (array)[(at).s7])
#define ALL_OF(op, values) \
    ((values).s0 op (values).s1 op (values).s2 op (values).s3 op (values).s4 op (values).s5 \
     op (values).s6 op (values).s7)

#endif

/* The first where the condition holds, else the second. */
#define EITHER(condition, first, second) (((first) & (condition)) | ((second) & ~(condition)))

static inline bool any_of(const longs condition)
{
    return ALL_OF(|, condition) != 0;
}

#endif
