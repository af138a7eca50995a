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
 * Tests:      tests/kernels/test_shade.py, tests/api/test_render.py
 * Defines:    LEVELS, RULE, BRICK_*, MIDDLE_*  (common/model.h)
 *             SIDE    samples along the side of a pixel
 *             WINDOW  voxels looked at on each side of a place
 * Source:     G. Young, "Multi-level voxel representation for GPU-accelerated solid modeling",
 *             2017: ambient, diffuse and specular light.
 */
#include "common/model.h"
#include "raymarch/rays.h"

/* Places and directions are four wide, the last part being 0: Oclgrind crashes on some programs of
 * three wide vectors, and of small structs. */

static inline float4 vec(const float x, const float y, const float z)
{
    return (float4)(x, y, z, 0.0f);
}

/* Of length 1; of length 0 if `v` is. */
static inline float4 unit(const float4 v)
{
    const float square = dot(v, v);
    return v * (square > 0.0f ? 1.0f / sqrt(square) : 0.0f);
}

/* In or out, also beyond the grid. */
static inline uint read_anywhere(
    const int4 shape, MODEL_PARAMETERS, const int x, const int y, const int z)
{
    if (x < 0 || y < 0 || z < 0 || x >= shape.x || y >= shape.y || z >= shape.z) return 0;
    return read_voxel(MODEL_ARGUMENTS, x, y, z);
}

/* A place along one axis, in voxels from the lower face of voxel `at`. */
static inline float place_in_voxel(
    const int bits, const int fraction, const long start, const long right, const long down,
    const int column, const int row, const int at)
{
    const long place = (start + right * column + down * row) >> fraction;
    return (float)(place - (long)at * (1L << bits)) / (float)(1L << bits);
}

/* When a ray from `from` meets the face of its voxel through which it comes in along one axis. */
static inline float entry_time(const float from, const float ahead)
{
    return ahead == 0.0f ? -INFINITY : ((ahead > 0.0f ? 0.0f : 1.0f) - from) / ahead;
}

/* Part of the outward normal of the face that is met at `time`, if the ray comes in at `entry`. */
static inline float face_part(const float time, const float entry, const float ahead)
{
    return time == entry ? -sign(ahead) : 0.0f;
}

/* Where in its voxel the ray comes in, from the voxel's centre, and through which face. */
static inline float4 entry_of(const float4 from, const float4 ahead, float4 *face)
{
    const float x = entry_time(from.x, ahead.x), y = entry_time(from.y, ahead.y);
    const float z = entry_time(from.z, ahead.z);
    const float entry = fmax(x, fmax(y, z));
    *face = vec(face_part(x, entry, ahead.x), face_part(y, entry, ahead.y),
                face_part(z, entry, ahead.z));
    return vec(clamp(from.x + entry * ahead.x, 0.0f, 1.0f) - 0.5f,
               clamp(from.y + entry * ahead.y, 0.0f, 1.0f) - 0.5f,
               clamp(from.z + entry * ahead.z, 0.0f, 1.0f) - 0.5f);
}

/* Outward normal, in voxels, at `at` from the centre of `voxel`: not of length 1, but of about 1
 * on a plane, and of less where the voxels say little. */
static inline float4 slope_at(const int4 shape, MODEL_PARAMETERS, const int4 voxel, const float4 at)
{
    const float reach = WINDOW + 0.5f;
    float right = 0.0f, back = 0.0f, up = 0.0f, most = 0.0f;
    for (int z = -WINDOW; z <= WINDOW; ++z)
        for (int y = -WINDOW; y <= WINDOW; ++y)
            for (int x = -WINDOW; x <= WINDOW; ++x) {
                const float4 away = vec(x - at.x, y - at.y, z - at.z);
                const float square = dot(away, away);
                const float share = 1.0f - square / (reach * reach);
                if (share <= 0.0f) continue;
                const float weight = share * share;
                most += weight * sqrt(square);
                if (!read_anywhere(
                        shape, MODEL_ARGUMENTS, voxel.x + x, voxel.y + y, voxel.z + z)) continue;
                right -= weight * away.x;
                back -= weight * away.y;
                up -= weight * away.z;
            }
    /* A half space has a quarter of it all. */
    return vec(right, back, up) * (4.0f / most);
}

/* How much of the sky a place sees, from 0 to 1: of the voxels at `offsets` those above the
 * surface count that are inside. */
static inline float sky_at(
    const int4 shape, MODEL_PARAMETERS, const int4 voxel, const float4 at, const float4 normal,
    const int n, const __global float *offsets)
{
    float hidden = 0.0f, all_of_it = 0.0f;
    const float4 from = convert_float4(voxel) + 0.5f + at + normal * 2.0f;
    for (int i = 0; i < n; ++i) {
        const float4 either = vec(offsets[3 * i], offsets[3 * i + 1], offsets[3 * i + 2]);
        const float height = dot(either, normal);
        const float4 offset = either * (height < 0.0f ? -1.0f : 1.0f);
        const float weight = fabs(height) / length(offset);
        all_of_it += weight;
        if (read_anywhere(
                shape, MODEL_ARGUMENTS, (int)floor(from.x + offset.x),
                (int)floor(from.y + offset.y), (int)floor(from.z + offset.z)))
            hidden += weight;
    }
    return 1.0f - hidden / fmax(all_of_it, 1.0f);
}

static inline float4 light_of(
    const float4 normal, const float sky, const float4 right, const float4 up, const float4 back,
    const float4 colour)
{
    const float4 key = unit(up * 0.8f - right * 0.55f + back * 0.75f);
    const float4 fill = unit(right * 0.9f + back * 0.5f - up * 0.1f);
    const float above = 0.5f + 0.5f * dot(normal, up);
    const float4 ambient = vec(0.20f + 0.20f * above, 0.19f + 0.24f * above, 0.18f + 0.29f * above);
    const float diffuse = fmax(dot(normal, key), 0.0f);
    const float other = fmax(dot(normal, fill), 0.0f);
    const float shine = powr(fmax(dot(normal, unit(key + back)), 0.0f), 48.0f);
    const float rim = powr(fmax(1.0f - fmax(dot(normal, back), 0.0f), 0.0f), 4.0f);
    const float bright = (0.85f * diffuse + 0.18f * other) * (0.4f + 0.6f * sky);
    const float white = (0.16f * shine + 0.05f * rim) * sky;
    return vec(colour.x * (ambient.x * sky + bright) + white,
               colour.y * (ambient.y * sky + bright) + white,
               colour.z * (ambient.z * sky + bright) + white);
}

static inline uchar to_byte(const float part)
{
    return convert_uchar_sat_rte(part * 255.0f);
}

static inline uchar to_srgb(const float linear)
{
    const float value = clamp(linear, 0.0f, 1.0f);
    return to_byte(value <= 0.0031308f ? value * 12.92f
                                       : 1.055f * powr(value, 1.0f / 2.4f) - 0.055f);
}

/* One work-item colours one pixel, the mean of SIDE x SIDE rays.
 * size: columns and rows of pixels; widths: of a voxel, the narrowest being 1; right_of, up_of,
 * back_of: unit vectors of the view; colour, background: linear, background.w its opacity.
 * offsets: (n, 3) float32, in voxels.  hits: (size.y SIDE, size.x SIDE, 3) int32.
 * pixels: (size.y, size.x, 4) uint8, sRGB and opacity. */
__kernel void shade_surface(
    const int2 size, const int4 shape, RAY_PARAMETERS, const float4 widths, const float4 right_of,
    const float4 up_of, const float4 back_of, const float4 colour, const float4 background,
    const int n, const __global float *restrict offsets, const __global int *restrict hits,
    MODEL_PARAMETERS, __global uchar *restrict pixels)
{
    const ulong id = get_global_id(0);
    if (id >= (ulong)size.x * size.y) return;
    const int line = (int)(id / size.x);
    const int row = line * SIDE, column = (int)(id - (ulong)line * size.x) * SIDE;
    const float4 ahead = vec(direction.x, direction.y, direction.z);
    float red = 0.0f, green = 0.0f, blue = 0.0f, covered = 0.0f;
    for (int sample = 0; sample < SIDE * SIDE; ++sample) {
        const int below = sample / SIDE;
        const int u = column + sample - below * SIDE, v = row + below;
        const ulong hit = 3 * ((ulong)v * size.x * SIDE + u);
        if (hits[hit] < 0) {
            red += background.x * background.w;
            green += background.y * background.w;
            blue += background.z * background.w;
            covered += background.w;
            continue;
        }
        const int4 voxel = (int4)(hits[hit], hits[hit + 1], hits[hit + 2], 0);
        const float4 from = vec(
            place_in_voxel(bits, fraction, start.x, right.x, down.x, u, v, voxel.x),
            place_in_voxel(bits, fraction, start.y, right.y, down.y, u, v, voxel.y),
            place_in_voxel(bits, fraction, start.z, right.z, down.z, u, v, voxel.z));
        float4 face;
        const float4 at = entry_of(from, ahead, &face);
        const float4 slope = slope_at(shape, MODEL_ARGUMENTS, voxel, at);
        /* Where the voxels around do not tell, the face of the voxel does. */
        const float doubt = clamp(1.5f - 3.0f * length(slope), 0.0f, 1.0f);
        const float4 outward = unit(slope + unit(face) * (doubt + 1e-3f));
        const float4 normal = unit(
            vec(outward.x / widths.x, outward.y / widths.y, outward.z / widths.z));
        const float sky = sky_at(shape, MODEL_ARGUMENTS, voxel, at, outward, n, offsets);
        const float4 light = light_of(
            normal, sky, right_of, up_of, back_of, colour);
        red += light.x;
        green += light.y;
        blue += light.z;
        covered += 1.0f;
    }
    const float share = 1.0f / fmax(covered, 1e-6f);
    pixels[4 * id] = to_srgb(red * share);
    pixels[4 * id + 1] = to_srgb(green * share);
    pixels[4 * id + 2] = to_srgb(blue * share);
    pixels[4 * id + 3] = to_byte(covered * (1.0f / (SIDE * SIDE)));
}
