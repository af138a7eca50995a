/*
 * raymarch/shade_volume.cl: colours of lengths within a solid.
 *
 * Host:       clvox/ops/raymarch.py, shade_volume()
 * Reference:  tests/kernels/test_shade.py, in NumPy; colours may differ by rounding
 * Tests:      tests/kernels/test_shade.py
 * Defines:    SAMPLES  along the side of a pixel
 * Source:     G. Young, "Multi-level voxel representation for GPU-accelerated solid modeling",
 *             2017: a ray's colour from how much of it is inside; Beer and Lambert's law.
 */
#include "raymarch/colours.h"

/* One work-item colours one pixel, the mean of SAMPLES x SAMPLES rays.
 * size: columns and rows of pixels; density: for each unit of length; counted: opacity is
 * density times length; thin, thick: colours where little and nearly all of the light is held
 * back; background: its colour and opacity.  lengths: (size.y SAMPLES, size.x SAMPLES) float32.
 * pixels: (size.y, size.x, 4) uint8, sRGB and opacity. */
__kernel void shade_volume(
    const int2 size, const float density, const int counted, const float4 thin,
    const float4 thick, const float4 background, const __global float *restrict lengths,
    __global uchar *restrict pixels)
{
    const ulong id = get_global_id(0);
    if (id >= (ulong)size.x * size.y) return;
    const int line = (int)(id / size.x), row = line * SAMPLES;
    const int column = (int)(id - (ulong)line * size.x) * SAMPLES;
    float4 sum = (float4)(0.0f);
    for (int sample = 0; sample < SAMPLES * SAMPLES; ++sample) {
        const int below = sample / SAMPLES, across = sample - below * SAMPLES;
        const float depth =
            density * lengths[(ulong)(row + below) * size.x * SAMPLES + column + across];
        const float opacity = counted ? clamp(depth, 0.0f, 1.0f) : 1.0f - exp(-depth);
        sum += over(background, mix(thin, thick, opacity), opacity);
    }
    store_pixel(pixels + 4 * id, sum * (1.0f / (SAMPLES * SAMPLES)));
}
