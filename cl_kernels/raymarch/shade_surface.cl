/*
 * raymarch/shade_surface.cl: the colour of the voxels that rays meet.
 *
 * Models carry no normals, so a normal is derived from the voxels around the place where a ray
 * comes in: weighted by their distance from that place, not from a voxel's centre, so that it
 * turns smoothly from voxel to voxel.
 *
 * Host:       clvox/ops/raymarch.py, shade_surface()
 * Reference:  clvox/reference/raymarch.py, first_voxels(), says where colour is; colours may differ
 *             from device to device
 * Tests:      tests/api/test_render.py; not on Oclgrind, which crashes on it
 * Defines:    LEVELS, RULE, BRICK_X, BRICK_Y, BRICK_Z  (common/model.h)
 *             SIDE    samples along the side of a pixel
 *             WINDOW  voxels looked at on each side of a place
 * Source:     G. Young, "Multi-level voxel representation for GPU-accelerated solid modeling",
 *             2017: ambient, diffuse and specular light.
 */
#include "common/model.h"
#include "raymarch/rays.h"

/* In or out, also beyond the grid. */
static inline uint read_anywhere(const int4 shape, MODEL_PARAMETERS, const int3 voxel)
{
    if (any(voxel < 0) || any(voxel >= shape.xyz)) return 0;
    return read_voxel(MODEL_ARGUMENTS, voxel.x, voxel.y, voxel.z);
}

/* Where in its voxel the ray comes in, from the voxel's centre, and through which face. */
static inline float3 entry_of(
    const int bits, const long4 direction, const long3 place, const int3 voxel, float3 *face)
{
    const float3 from = convert_float3(place - convert_long3(voxel) * (1L << bits))
                      * (1.0f / (float)(1L << bits));
    const float3 ahead = convert_float3(direction.xyz);
    const float3 plane = ahead > 0.0f ? (float3)(0.0f) : (float3)(1.0f);
    const float3 times = ahead == 0.0f ? (float3)(-INFINITY) : (plane - from) / ahead;
    const float time = max(times.x, max(times.y, times.z));
    *face = times == time ? -sign(ahead) : (float3)(0.0f);
    return clamp(from + time * ahead, 0.0f, 1.0f) - 0.5f;
}

/* Outward normal, in voxels, at `at` from the centre of `voxel`: not of length 1, but of about 1
 * on a plane, and of less where the voxels say little. */
static inline float3 slope_at(
    const int4 shape, MODEL_PARAMETERS, const int3 voxel, const float3 at)
{
    const float reach = WINDOW + 0.5f;
    float right = 0.0f, back = 0.0f, up = 0.0f, most = 0.0f;
    for (int z = -WINDOW; z <= WINDOW; ++z)
        for (int y = -WINDOW; y <= WINDOW; ++y)
            for (int x = -WINDOW; x <= WINDOW; ++x) {
                const float3 away = (float3)(x, y, z) - at;
                const float share = 1.0f - dot(away, away) / (reach * reach);
                if (share <= 0.0f) continue;
                const float weight = share * share;
                most += weight * length(away);
                if (!read_anywhere(shape, MODEL_ARGUMENTS, voxel + (int3)(x, y, z))) continue;
                right -= weight * away.x;
                back -= weight * away.y;
                up -= weight * away.z;
            }
    /* A half space has a quarter of it all. */
    return (float3)(right, back, up) * (4.0f / most);
}

/* How much of the sky a place sees, from 0 to 1: of the voxels at `offsets` those above the
 * surface count that are inside. */
static inline float sky_at(
    const int4 shape, MODEL_PARAMETERS, const int3 voxel, const float3 at, const float3 normal,
    const int n, const __global float *restrict offsets)
{
    float hidden = 0.0f, all_of_it = 0.0f;
    const float3 from = convert_float3(voxel) + 0.5f + at + 2.0f * normal;
    for (int i = 0; i < n; ++i) {
        const float3 either = vload3(i, offsets);
        const float height = dot(either, normal);
        const float3 offset = either * (height < 0.0f ? -1.0f : 1.0f);
        const float weight = fabs(height) / length(offset);
        all_of_it += weight;
        if (read_anywhere(shape, MODEL_ARGUMENTS, convert_int3_rtn(from + offset)))
            hidden += weight;
    }
    return 1.0f - hidden / max(all_of_it, 1.0f);
}

static inline float3 light_of(
    const float3 normal, const float sky, const float3 right, const float3 up, const float3 back,
    const float3 colour)
{
    const float3 key = normalize(up * 0.8f - right * 0.55f + back * 0.75f);
    const float3 fill = normalize(right * 0.9f + back * 0.5f - up * 0.1f);
    const float3 half_way = normalize(key + back);
    const float above = 0.5f + 0.5f * dot(normal, up);
    const float3 ambient = mix((float3)(0.20f, 0.19f, 0.18f), (float3)(0.40f, 0.43f, 0.47f), above);
    const float diffuse = max(dot(normal, key), 0.0f);
    const float other = max(dot(normal, fill), 0.0f);
    const float shine = pow(max(dot(normal, half_way), 0.0f), 48.0f);
    const float rim = pow(1.0f - max(dot(normal, back), 0.0f), 4.0f);
    const float open = 0.4f + 0.6f * sky;
    return colour * (ambient * sky + (0.85f * diffuse + 0.18f * other) * open)
         + (float3)((0.16f * shine + 0.05f * rim) * sky);
}

static inline float3 to_srgb(const float3 linear)
{
    const float3 value = clamp(linear, 0.0f, 1.0f);
    return value <= 0.0031308f ? value * 12.92f
                               : 1.055f * powr(value, (float3)(1.0f / 2.4f)) - 0.055f;
}

/* One work-item colours one pixel, the mean of SIDE x SIDE rays.
 * size: columns and rows of pixels; widths: of a voxel, the narrowest being 1; right_of, up_of,
 * back_of: unit vectors of the view; colour, background: linear, background.w its opacity.
 * offsets: (n, 3) float32, in voxels.  hits: (size.y SIDE, size.x SIDE, 3) int32.
 * pixels: (size.y, size.x) uchar4, sRGB and opacity. */
__kernel void shade_surface(
    const int2 size, const int4 shape, RAY_PARAMETERS, const float4 widths, const float4 right_of,
    const float4 up_of, const float4 back_of, const float4 colour, const float4 background,
    const int n, const __global float *restrict offsets, const __global int *restrict hits,
    MODEL_PARAMETERS, __global uchar4 *restrict pixels)
{
    const ulong id = get_global_id(0);
    if (id >= (ulong)size.x * size.y) return;
    const int line = (int)(id / size.x);
    const int row = line * SIDE, column = (int)(id - (ulong)line * size.x) * SIDE;
    float red = 0.0f, green = 0.0f, blue = 0.0f, covered = 0.0f;
    for (int sample = 0; sample < SIDE * SIDE; ++sample) {
        const int u = column + sample % SIDE, v = row + sample / SIDE;
        const int3 voxel = vload3((ulong)v * size.x * SIDE + u, hits);
        if (voxel.x < 0) {
            red += background.x * background.w;
            green += background.y * background.w;
            blue += background.z * background.w;
            covered += background.w;
            continue;
        }
        const long3 place = place_of(fraction, start, right, down, u, v);
        float3 face;
        const float3 at = entry_of(bits, direction, place, voxel, &face);
        const float3 slope = slope_at(shape, MODEL_ARGUMENTS, voxel, at);
        /* Where the voxels around do not tell, the face of the voxel does. */
        const float doubt = clamp(1.5f - 3.0f * length(slope), 0.0f, 1.0f);
        const float3 straight = normalize(face);
        const float3 inner = normalize(slope + (doubt + 1e-3f) * straight);
        const float3 normal = normalize(inner / widths.xyz);
        const float sky = sky_at(shape, MODEL_ARGUMENTS, voxel, at, inner, n, offsets);
        const float3 light = light_of(
            normal, sky, right_of.xyz, up_of.xyz, back_of.xyz, colour.xyz);
        red += light.x;
        green += light.y;
        blue += light.z;
        covered += 1.0f;
    }
    const float3 mean = to_srgb((float3)(red, green, blue) / max(covered, 1e-6f));
    const float opacity = covered * (1.0f / (SIDE * SIDE));
    pixels[id] = convert_uchar4_sat_rte((float4)(mean, opacity) * 255.0f);
}
