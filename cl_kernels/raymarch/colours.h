/*
 * raymarch/colours.h: from linear light to the bytes of a picture.
 *
 * Sums are of (red, green, blue) times opacity, and opacity.
 */
#ifndef CLVOX_COLOURS_H
#define CLVOX_COLOURS_H

/* A colour of some opacity in front of the background, which brings its own as w. */
static inline float4 over(const float4 background, const float4 colour, const float opacity)
{
    const float behind = background.w * (1.0f - opacity);
    return (float4)(colour.x * opacity + background.x * behind,
                    colour.y * opacity + background.y * behind,
                    colour.z * opacity + background.z * behind, opacity + behind);
}

/* The nearest byte, of a part from 0 to 1; compilers do more for a conversion that rounds. */
static inline uchar to_byte(const float part)
{
    return (uchar)(int)(part * 255.0f + 0.5f);
}

/* sRGB's curve, but near 0, by roots, within 0.012 of a grey level: a power takes longer. */
static inline float4 srgb_by_roots(const float4 value)
{
    const float4 second = sqrt(value), fourth = sqrt(second), eighth = sqrt(fourth);
    return 0.64236529f * second + 0.71211087f * fourth - 0.33687011f * eighth
         - 0.01756299f * value;
}

static inline uchar to_srgb(const float value, const float by_roots)
{
    return to_byte(value <= 0.0031308f ? value * 12.92f : by_roots);
}

/* pixel: four bytes, sRGB and opacity, not multiplied into them. */
static inline void store_pixel(__global uchar *pixel, const float4 sum)
{
    if (sum.w <= 0.0f) {
        pixel[0] = pixel[1] = pixel[2] = pixel[3] = 0;
        return;
    }
    const float4 value = clamp(sum * (1.0f / sum.w), 0.0f, 1.0f), curve = srgb_by_roots(value);
    pixel[0] = to_srgb(value.x, curve.x);
    pixel[1] = to_srgb(value.y, curve.y);
    pixel[2] = to_srgb(value.z, curve.z);
    pixel[3] = to_byte(sum.w);
}

#endif
