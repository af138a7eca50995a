/*
 * raymarch/nearest.h: which triangle of a cell a place on the surface belongs to: the nearest one.
 *
 * Defines:    LATTICE_BITS  lattice steps in a voxel, as a power of two
 */
#ifndef CLVOX_NEAREST_H
#define CLVOX_NEAREST_H

/* Squared distance of the origin from the segment a, b. */
static inline float from_segment(const float4 a, const float4 b)
{
    const float4 along = b - a;
    const float part = clamp(-dot(a, along) / fmax(dot(along, along), 1e-30f), 0.0f, 1.0f);
    const float4 there = a + along * part;
    return dot(there, there);
}

/* Squared distance of the origin from a triangle. */
static inline float from_triangle(const float4 a, const float4 b, const float4 c)
{
    const float4 normal = cross(b - a, c - a);
    const float square = dot(normal, normal), height = dot(a, normal);
    const bool above = square > 0.0f && dot(cross(a, b), normal) >= 0.0f
                    && dot(cross(b, c), normal) >= 0.0f && dot(cross(c, a), normal) >= 0.0f;
    const float sides = fmin(from_segment(a, b), fmin(from_segment(b, c), from_segment(c, a)));
    return above ? height * height / square : sides;
}

/* A corner of a triangle, as long as `widths`, from the place `at` off the middle of `voxel`. */
static inline float4 corner_from(
    const __global int *vertices, const int number, const int4 voxel, const float4 at,
    const float4 widths)
{
    const __global int *corner = vertices + 3 * (ulong)number;
    const float scale = 1.0f / (1 << LATTICE_BITS);
    const float4 away = (float4)(
        (float)(corner[0] - (voxel.x << LATTICE_BITS)) * scale,
        (float)(corner[1] - (voxel.y << LATTICE_BITS)) * scale,
        (float)(corner[2] - (voxel.z << LATTICE_BITS)) * scale, 0.0f);
    return (away - at) * widths;
}

/* The nearest of the triangles linked[first] to before linked[last], the first of equal ones. */
static inline int nearest_triangle(
    const __global int *linked, const ulong first, const ulong last, const __global int *faces,
    const __global int *vertices, const int4 voxel, const float4 at, const float4 widths)
{
    int nearest = linked[first];
    float least = INFINITY;
    for (ulong i = first; i < last; ++i) {
        const __global int *face = faces + 3 * (ulong)linked[i];
        const float distance = from_triangle(
            corner_from(vertices, face[0], voxel, at, widths),
            corner_from(vertices, face[1], voxel, at, widths),
            corner_from(vertices, face[2], voxel, at, widths));
        if (distance < least) {
            least = distance;
            nearest = linked[i];
        }
    }
    return nearest;
}

#endif
