/*
 * common/spans.h: where along each row of a box three linear functions may all be at least 0.
 *
 * The root of such a function moves along by the same step from row to row, so a block of rows
 * costs three divisions, and a row some sums that a vector unit does for many rows at once.
 * Slivers run through many rows and meet few places of them, or none.
 */
#ifndef CLVOX_SPANS_H
#define CLVOX_SPANS_H

#define ROWS 32

/* Places first[k] to last[k], both included, along row k of a block; none if last < first. */
typedef struct {
    int first[ROWS], last[ROWS];
} Spans;

/* What one function leaves of a row: places from `low` to `high`, of which one is fixed; the other
 * moves by its step from row to row. */
typedef struct {
    float low, low_step, high, high_step;
} Bounds;

/* The function is value + place * step + row * rise; all three below 2^62.
 * Four conversions, a division (2.5 units in the last place are the worst that OpenCL allows), two
 * products and three sums are wrong by at most 14 units of 2^-24 of |root| + ROWS * |slope|, and
 * what spans_of() adds by two of 1: `slack` is more.  So no place is missed, and rarely one is
 * there that should not be. */
static inline Bounds bounds_of(const long value, const long step, const long rise, const int last)
{
    Bounds b = {-1.0f, 0.0f, (float)last, 0.0f};
    if (step == 0) return b;
    const float inverse = -1.0f / (float)step;
    const float root = (float)value * inverse;
    const float slope = (float)rise * inverse;
    const float slack = (fabs(root) + ROWS * fabs(slope) + 1.0f) * (1.0f / (float)(1 << 19));
    if (step > 0) {
        b.low = root - slack;
        b.low_step = slope;
    } else {
        b.high = root + slack;
        b.high_step = slope;
    }
    return b;
}

/* Of ROWS rows of the places 0 to last, at most 2^17, those within all bounds. */
static inline void spans_of(
    Spans *spans, const Bounds a, const Bounds b, const Bounds c, const int last)
{
    const float end = (float)last;
    for (int k = 0; k < ROWS; ++k) {
        const float row = (float)k;
        const float low = max(max(a.low + row * a.low_step, b.low + row * b.low_step),
                              c.low + row * c.low_step);
        const float high = min(min(a.high + row * a.high_step, b.high + row * b.high_step),
                               c.high + row * c.high_step);
        /* Conversions cut, and here nothing is negative.  `low` lies before the first place, by the
         * slack, so that the place behind it is the first. */
        spans->first[k] = (int)(clamp(low, -1.0f, end) + 1.0f);
        spans->last[k] = (int)(clamp(high, -1.0f, end) + 1.0f) - 1;
    }
}

/* Lists the first rows, so many, that are not empty, and returns how many these are. */
static inline int list_rows(const Spans *spans, const int rows, int *list)
{
    int count = 0;
    for (int k = 0; k < min(rows, ROWS); ++k) {
        list[count] = k;
        count += spans->first[k] <= spans->last[k];
    }
    return count;
}

#endif
