/*
 * common/spans.h: where along a row an edge function is not negative, solved for.
 *
 * Scanning a row costs more than solving from about WIDE places on.
 */
#ifndef CLVOX_SPANS_H
#define CLVOX_SPANS_H

#define WIDE 12

/* Places first to last along a row, both included, within [0, 2^17]. */
typedef struct {
    int first, last;
} Span;

/* -1 / step, as narrow() takes it. */
static inline float inverse_of(const long step)
{
    return -1.0f / (float)step;
}

/* Keeps the places p of a span where edge + p * step >= 0.
 * Two conversions, a division (2.5 units in the last place are the worst that OpenCL allows) and a
 * product are wrong by less than 2^-21 of the root in all.  So wherever the root lies on the row or
 * one place beside it, the float is within 1/8 of it: the nearest integer, or the place beside it,
 * is the end, and one exact sign tells which. */
static inline void narrow(Span *span, const long edge, const long step, const float inverse)
{
    if (step == 0) {
        if (edge < 0) span->last = -1;
        return;
    }
    const float root = clamp((float)edge * inverse, -1.0f, (float)(span->last + 1));
    const int nearest = (int)rint(root);
    const bool holds = edge + nearest * step >= 0;
    if (step > 0) span->first = max(span->first, holds ? nearest : nearest + 1);
    else span->last = min(span->last, holds ? nearest : nearest - 1);
}

#endif
