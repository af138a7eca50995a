/*
 * common/exact_sign.h: the sign of an integer that may need more than 64 bits.
 *
 * The polynomial is evaluated twice: in float32, with an absolute error below 2^60, and modulo
 * 2^64.  Beyond 2^61 the float's sign is right; otherwise the true value lies within 2^61 + 2^60
 * of 0, fits a long, and the wrapped word is the value itself.
 */
#ifndef CLVOX_EXACT_SIGN_H
#define CLVOX_EXACT_SIGN_H

/* A long with the sign of the true value. */
static inline long exact_sign(const float estimate, const ulong wrapped)
{
    const float trusted = (float)(1UL << 61);
    if (estimate > trusted) return 1;
    if (estimate < -trusted) return -1;
    return (long)wrapped;
}

#endif
