/*
 * raymarch/shade_volume.cl: colours of lengths within a solid.
 *
 * Host:       clvox/ops/shading.py, shade_volume()
 * Reference:  tests/kernels/test_shade.py, in NumPy; colours may differ by rounding
 * Tests:      tests/kernels/test_shade.py
 * Defines:    LISTED, SAMPLES, EACH  (raymarch/samples.h)
 * Source:     G. Young, "Multi-level voxel representation for GPU-accelerated solid modeling",
 *             2017: a ray's colour from how much of it is inside; Beer and Lambert's law.
 */
#include "raymarch/colours.h"
#include "raymarch/samples.h"

/* One work-item colours one pixel, the mean of its RAYS.
 * picture: columns and rows of pixels; density: for each unit of length; counted: opacity is
 * density times length; thin, thick: colours where little and nearly all of the light is held
 * back; background: its colour and opacity.  lengths: (rays,) float32.
 * pixels: (picture.y, picture.x, 4) uint8, sRGB and opacity. */
__kernel void shade_volume(
    PIXEL_PARAMETERS, const float density, const int counted, const float4 thin,
    const float4 thick, const float4 background, const __global float *restrict lengths,
    __global uchar *restrict pixels)
{
    const ulong id = get_global_id(0);
    if (id >= pixel_count) return;
    const ulong number = NUMBER_OF_PIXEL(id);
    float4 sum = (float4)(0.0f);
    for (int sample = 0; sample < RAYS; ++sample) {
        const float depth = density * lengths[id * RAYS + sample];
        const float opacity = counted ? clamp(depth, 0.0f, 1.0f) : 1.0f - exp(-depth);
        sum += over(background, mix(thin, thick, opacity), opacity);
    }
    store_pixel(pixels + 4 * number, sum * (1.0f / RAYS));
}
