/*
 * raymarch/shade.cl: the colour of the voxels that rays meet.
 *
 * The normal of a voxel that the mesh touches is that of the mesh, if the model keeps it, and
 * between the middles of voxels it turns from one to the next.  Otherwise it is derived from the
 * voxels around the place where a ray comes in: weighted by their distance from that place, not
 * from a voxel's centre, so that it turns smoothly from voxel to voxel.
 *
 * Host:       clvox/ops/shading.py, shade()
 * Reference:  clvox/reference/raymarch.py, first_voxels(), says where colour is; colours may differ
 *             from device to device
 * Tests:      tests/kernels/test_shade.py, tests/api/test_render.py
 * Defines:    LEVELS, RULE, BRICK_*, MIDDLE_*  (common/model.h)
 *             LISTED, SAMPLES, EACH  (raymarch/samples.h)
 *             WINDOW   voxels looked at on each side of a place
 *             STORED   1: there are normals; 0: they are derived
 *             LINES    1: faces of voxels are shown, and their edges drawn
 *             LIGHTS   number of lights
 *             COLOURED 1: triangles have colours; with LATTICE_BITS
 *             SKY      1: what the sky hides is known
 *             SKY_MARGIN  blocks around the grid, if SKY
 * Source:     G. Young, "Multi-level voxel representation for GPU-accelerated solid modeling",
 *             2017, equations 4.6 to 4.9: ambient, diffuse, specular and emitted light.
 */
#include "common/model.h"
#include "attributes/octahedral.h"
#include "raymarch/colours.h"
#include "raymarch/rays.h"
#include "raymarch/samples.h"
#include "raymarch/slope.h"
#if LEVELS == 1
#include "common/bricks.h"
#endif
#if COLOURED
#include "raymarch/nearest.h"
#endif

#define CUT 4
#define BY_PLANE 3
#define TOUCHED_VOXEL 1
#define INSIDE_CELL 2

/* Of a blurred plane, at one standard deviation above it; and how dark full hollows are. */
#define PLANE_LEAVES 0.1587f
#define SKY_DEPTH 1.0f

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

/* A place along one axis, in steps of rays from the lower face of voxel `at`. */
static inline float place_from(const int bits, const long place, const int at)
{
    return (float)(place - ((long)at << bits));
}

#if SKY

/* How full the space is at a place, in blocks from the middle of the first one; from 0 to 1. */
static inline float fullness(const int4 blocks, const __global uchar *sky, const float4 at)
{
    const float x = clamp(at.x, 0.0f, blocks.x - 1.001f), y = clamp(at.y, 0.0f, blocks.y - 1.001f);
    const float z = clamp(at.z, 0.0f, blocks.z - 1.001f);
    const int i = (int)x, j = (int)y, k = (int)z;
    const float u = x - i, v = y - j, w = z - k;
    const __global uchar *here = sky + ((ulong)k * blocks.y + j) * blocks.x + i;
    const __global uchar *over = here + (ulong)blocks.x * blocks.y;
    const int next = blocks.x;
    const float front = mix((float)here[0], (float)here[1], u);
    const float back = mix((float)here[next], (float)here[next + 1], u);
    const float front_over = mix((float)over[0], (float)over[1], u);
    const float back_over = mix((float)over[next], (float)over[next + 1], u);
    return mix(mix(front, back, v), mix(front_over, back_over, v), w) * (1.0f / 255.0f);
}

/* How much of the sky a place sees, from 0 to 1: what is `reach` above it, more than a plane leaves
 * there, hides it.  normal: in the unit of `widths`. */
static inline float sky_at(
    const int4 blocks, const float4 side, const float reach, const __global uchar *sky,
    const float4 place, const float4 normal, const float4 widths)
{
    const float4 above = place + normal * reach / widths;
    const float4 at = vec(above.x / side.x, above.y / side.y, above.z / side.z)
                    + (SKY_MARGIN - 0.5f);
    const float hidden = (fullness(blocks, sky, at) - PLANE_LEAVES) / (1.0f - PLANE_LEAVES);
    return 1.0f - SKY_DEPTH * clamp(hidden, 0.0f, 1.0f);
}

#endif

#if STORED

/* The packed normal of a voxel, or NO_NORMAL. */
static inline uint normal_of(
    const int4 shape, MODEL_PARAMETERS, const __global uint *touched, const __global uint *ranks,
    const __global uint *normals, const int x, const int y, const int z)
{
    if (x < 0 || y < 0 || z < 0 || x >= shape.x || y >= shape.y || z >= shape.z) return NO_NORMAL;
#if LEVELS == 1
    const ulong word = cell_word(cells, x, y, z);
    const uint bit = x % 32;
#else
    const ulong state = cell_state(MODEL_ARGUMENTS, x / BRICK_X, y / BRICK_Y, z / BRICK_Z);
    if (state >= CELL_OUTSIDE) return NO_NORMAL;
    const uint at = (place_in(z, BRICK_Z) * BRICK_Y + place_in(y, BRICK_Y)) * BRICK_X
                  + place_in(x, BRICK_X);
    const ulong word = state * BRICK_WORDS + at / 32;
    const uint bit = at % 32;
#endif
    if (!(touched[word] >> bit & 1)) return NO_NORMAL;
    return normals[rank_of(touched, ranks, word, bit)];
}

/* The normals of the eight voxels whose middles are around the place `at` from the middle of
 * `voxel`, each by its share; those that face away from the voxel's own do not count.  Or the
 * voxel's `alone`. */
static inline float4 normal_at(
    const int4 shape, MODEL_PARAMETERS, const __global uint *touched, const __global uint *ranks,
    const __global uint *normals, const int4 voxel, const float4 at, const bool alone)
{
    const uint packed = normal_of(
        shape, MODEL_ARGUMENTS, touched, ranks, normals, voxel.x, voxel.y, voxel.z);
    if (packed == NO_NORMAL) return (float4)(0.0f);
    const float4 own = unit(unpack_normal(packed));
    if (alone) return own;
    const int to_x = at.x < 0.0f ? -1 : 1, to_y = at.y < 0.0f ? -1 : 1;
    const int to_z = at.z < 0.0f ? -1 : 1;
    float4 sum = own * ((1.0f - fabs(at.x)) * (1.0f - fabs(at.y)) * (1.0f - fabs(at.z)));
    for (int other = 1; other < 8; ++other) {
        const int x = other & 1, y = other >> 1 & 1, z = other >> 2;
        const uint there = normal_of(
            shape, MODEL_ARGUMENTS, touched, ranks, normals, voxel.x + x * to_x,
            voxel.y + y * to_y, voxel.z + z * to_z);
        const float4 normal = unit(unpack_normal(there));
        /* Across a sharp edge normals do not mix. */
        if (there == NO_NORMAL || dot(normal, own) < 0.7f) continue;
        sum += normal * ((x ? fabs(at.x) : 1.0f - fabs(at.x))
                         * (y ? fabs(at.y) : 1.0f - fabs(at.y))
                         * (z ? fabs(at.z) : 1.0f - fabs(at.z)));
    }
    return unit(sum);
}

#endif

/* A number above 0 to the power of another, within 4e-5 of itself; at least 2**-120.  The
 * language's own takes a fifth longer for the whole of shading.
 * A mantissa's logarithm is a series of (m - 1) / (m + 1), m being within a root of 2 of 1. */
static inline float power(const float base, const float exponent)
{
    const int bits = as_int(base), whole = (bits - 0x3f3504f3) >> 23;
    const float mantissa = as_float(bits - whole * (1 << 23));
    const float part = (mantissa - 1.0f) / (mantissa + 1.0f), square = part * part;
    const float log = whole + part * (2.88539008f + square * (0.96179669f + square * 0.57707802f));
    const float product = fmax(log * exponent, -120.0f), rest = product - floor(product);
    const float scaled = 1.0000026f
        + rest * (0.6930096f + rest * (0.2415183f + rest * (0.0520107f + rest * 0.0134606f)));
    return as_float(as_int(scaled) + (int)floor(product) * (1 << 23));
}

/* Light that comes from a place: Phong's law, from a sky that is brighter above, a key light from
 * the upper left and a fill light from the right; `view` points to the eye. */
static inline float4 light_of(
    const float4 normal, const float sky, const float4 view, const float4 key, const float4 fill,
    const float4 up, const float4 phong, const float emission, const float4 colour)
{
    const float open = 0.4f + 0.6f * sky;
    const float above = 0.5f + 0.5f * dot(normal, up);
    const float4 ambient =
        vec(0.72f + 0.50f * above, 0.69f + 0.60f * above, 0.66f + 0.72f * above);
    float4 diffuse = ambient * (phong.x * sky);
    float shine = 0.0f;
    for (int light = 0; light < LIGHTS; ++light) {
        const float4 towards = light == 0 ? key : fill;
        const float strength = light == 0 ? 1.0f : 0.22f;
        const float facing = dot(normal, towards);
        if (facing <= 0.0f) continue;
        diffuse += vec(1.0f, 1.0f, 1.0f) * (strength * phong.y * facing * open);
        const float4 mirrored = normal * (2.0f * facing) - towards;
        const float glance = dot(view, mirrored);
        /* Elsewhere it is below a thousandth. */
        if (phong.w * (1.0f - glance) < 7.0f && glance > 0.0f)
            shine += strength * power(glance, phong.w);
    }
    const float aside = 1.0f - clamp(dot(normal, view), 0.0f, 1.0f), square = aside * aside;
    const float white = (phong.z * shine + 0.05f * square * square) * sky;
    return vec(colour.x * (diffuse.x + emission) + white, colour.y * (diffuse.y + emission) + white,
               colour.z * (diffuse.z + emission) + white);
}

#if STORED && !LINES

/* Is it inside a voxel and a half below another one?  normal: of that, in voxels. */
static inline bool is_solid_below(
    const int4 shape, MODEL_PARAMETERS, const int4 voxel, const float4 normal)
{
    const float longest = fmax(fabs(normal.x), fmax(fabs(normal.y), fabs(normal.z)));
    const float4 down = normal * (-1.5f / longest);
    const int x = voxel.x + convert_int_rte(down.x), y = voxel.y + convert_int_rte(down.y);
    const int z = voxel.z + convert_int_rte(down.z);
    if (x < 0 || y < 0 || z < 0 || x >= shape.x || y >= shape.y || z >= shape.z) return false;
#if LEVELS == 1
    return row_bits(MODEL_ARGUMENTS, x, y, z, 1) != 0;
#else
    const ulong state = cell_state(MODEL_ARGUMENTS, x / BRICK_X, y / BRICK_Y, z / BRICK_Z);
    return cell_bits(bricks, state, place_in(x, BRICK_X), place_in(y, BRICK_Y),
                     place_in(z, BRICK_Z), 1) != 0;
#endif
}

#endif

#if LINES

/* How near a place is to the edge of the face that it lies on, as an opacity: `at` is the place in
 * its cube, from 0 to 1, `normal` that of the face, and `wide` a pixel, in the cube's sides. */
static inline float line_at(const float4 at, const float4 normal, const float4 wide)
{
    const float4 rest = fmin(at, 1.0f - at) / wide;
    /* Along the face it is farther to a side that the face meets at an angle; never to its own. */
    const float x = rest.x / sqrt(fmax(1.0f - normal.x * normal.x, 1e-6f));
    const float y = rest.y / sqrt(fmax(1.0f - normal.y * normal.y, 1e-6f));
    const float z = rest.z / sqrt(fmax(1.0f - normal.z * normal.z, 1e-6f));
    const float nearest = fmin(fabs(normal.x) > 0.99f ? INFINITY : x,
                               fmin(fabs(normal.y) > 0.99f ? INFINITY : y,
                                    fabs(normal.z) > 0.99f ? INFINITY : z));
    const float widest = fmax(wide.x, fmax(wide.y, wide.z));
    /* A line is a pixel wide, and never hides more than a part of the face. */
    const float sharp = clamp(1.3f - nearest, 0.0f, 1.0f);
    return sharp * clamp(0.3f / widest - 1.0f, 0.0f, 1.0f);
}

static inline float part_in(const int voxel, const float at, const int side)
{
    return (voxel - voxel / side * side + at) / side;
}

#endif

#if COLOURED

/* Number of the cell of a touched voxel, as links have it. */
static inline ulong linked_cell(
    MODEL_PARAMETERS, const __global uint *touched, const __global uint *ranks, const int4 voxel)
{
#if LEVELS == 1
    return rank_of(touched, ranks, cell_word(cells, voxel.x, voxel.y, voxel.z), voxel.x % 32);
#else
    const ulong state = cell_state(
        MODEL_ARGUMENTS, voxel.x / BRICK_X, voxel.y / BRICK_Y, voxel.z / BRICK_Z);
    return state < CELL_OUTSIDE ? state : NO_BRICK;
#endif
}

#endif

/* One work-item colours one pixel, the mean of its RAYS.
 * widths: of a voxel;
 * key_light, fill_light: where light comes from; up_of, back_of: unit vectors of the view, as they
 * are, too; cut_normal: of the plane that cuts; shape:
 * voxels of the grid.
 * phong: ambient, diffuse, specular, shininess; emission.  background: linear, and its
 * opacity.  pixel, spread: width of a pixel where rays begin, and for each unit farther on.
 * flip: -1 if normals point inwards.  colours: (4, 3) float32, linear, by what is met, and of a
 * cut.  blocks, block_side, sky_reach, sky: of clvox/ops/sky.py, if SKY.  voxels, far: as march()
 * leaves them.  touched, ranks, normals: of the touched voxels, if STORED or COLOURED.
 * link_offsets, linked: the triangles of each cell, as compressed rows; faces, vertices: of the
 * mesh, on the lattice; palette: (triangles, 3) float32, linear: if COLOURED.
 * pixels: (picture.y, picture.x, 4) uint8. */
__kernel void shade(
    PIXEL_PARAMETERS, const int4 shape,
    RAY_PARAMETERS, const float4 widths, const float4 key_light, const float4 fill_light,
    const float4 up_of, const float4 back_of, const float4 cut_normal, const float4 phong,
    const float emission,
    const float4 background, const float pixel, const float spread, const float flip,
    const __global float *restrict colours, const int4 blocks, const float4 block_side,
    const float sky_reach, const __global uchar *restrict sky,
    const __global int *restrict voxels, const __global float *restrict far, MODEL_PARAMETERS,
    const __global uint *restrict touched, const __global uint *restrict ranks,
    const __global uint *restrict normals, const __global ulong *restrict link_offsets,
    const __global int *restrict linked, const __global int *restrict faces,
    const __global int *restrict vertices, const __global float *restrict palette,
    __global uchar *restrict pixels)
{
    const ulong id = get_global_id(0);
    if (id >= pixel_count) return;
    const ulong number = NUMBER_OF_PIXEL(id);
    const float4 widths4 = (float4)(widths.x, widths.y, widths.z, 1.0f);
    const float4 inverse = (float4)(1.0f) / widths4;
    /* In voxels: a power of two, so that this is what a division by its inverse would be. */
    const float one_step = 1.0f / (float)(1L << bits);
    float4 sum = (float4)(0.0f);
    for (int sample = 0; sample < RAYS; ++sample) {
        const int2 place_of_ray = ray_of_sample(number, picture.x, sample);
        const int u = place_of_ray.x, v = place_of_ray.y;
        const ulong ray = id * RAYS + sample;
        const int4 voxel = (int4)(voxels[4 * ray], voxels[4 * ray + 1], voxels[4 * ray + 2], 0);
        if (voxel.x < 0) {
            sum += over(background, (float4)(0.0f), 0.0f);
            continue;
        }
        const int met = voxels[4 * ray + 3], axis = met & 3, kind = met >> 3;
        const bool cut = (met & CUT) != 0;
        const float4 ahead = vec((float)DIRECTION_OF(x, u, v), (float)DIRECTION_OF(y, u, v),
                                 (float)DIRECTION_OF(z, u, v));
        const float steps = far[ray] * one_step;
        const float4 within = clamp(
            vec(place_from(bits, PLACE_OF(x, u, v), voxel.x),
                place_from(bits, PLACE_OF(y, u, v), voxel.y),
                place_from(bits, PLACE_OF(z, u, v), voxel.z)) * one_step + ahead * steps,
            0.0f, 1.0f);
        const float4 at = vec(within.x - 0.5f, within.y - 0.5f, within.z - 0.5f);
        const float4 run = ahead * widths;
        const float span = sqrt(dot(run, run));
        const float4 view = run * (-1.0f / span);
        const float wide = pixel + spread * steps * span * fmax(dot(view, back_of), 0.0f);
        const float4 face = vec(axis == 0 ? -sign(ahead.x) : 0.0f,
                                axis == 1 ? -sign(ahead.y) : 0.0f,
                                axis == 2 ? -sign(ahead.z) : 0.0f);
        /* Rays that begin inside show the plane on which they begin. */
        const bool near = cut && axis != BY_PLANE && far[ray] == 0.0f;
        const bool by_plane = axis == BY_PLANE;
        float4 normal = face;
        if (near) normal = back_of;
        if (by_plane) normal = cut_normal;
#if !LINES
#if STORED
        if (!cut) {
            /* Voxels narrower than a pixel need no transitions. */
            const bool narrow = wide > 0.8f * fmax(widths.x, fmax(widths.y, widths.z));
            const float4 stored = normal_at(
                shape, MODEL_ARGUMENTS, touched, ranks, normals, voxel, at, narrow) * flip;
            /* What lies wholly inside is met only where the grid ends. */
            if (dot(stored, stored) > 0.0f) normal = stored;
            /* A sheet is seen from both sides.  Of a solid only the rim of a face behind it is:
             * it is lit as if it were seen edge on. */
            const float towards_eye = dot(normal, view);
            if (towards_eye < -0.35f
                && !is_solid_below(shape, MODEL_ARGUMENTS, voxel, normal * inverse))
                normal = -normal;
            else if (towards_eye < 0.0f)
                normal = unit(normal - towards_eye * view + 1e-3f * face);
        }
#else
        if (!cut) {
            const float4 slope = slope_at(shape, MODEL_ARGUMENTS, voxel, at);
            /* Where the voxels around do not tell, the face of the voxel does. */
            const float doubt = clamp(1.5f - 3.0f * length(slope), 0.0f, 1.0f);
            normal = unit(slope + face * (doubt + 1e-3f));
            normal = unit(vec(normal.x * inverse.x, normal.y * inverse.y, normal.z * inverse.z));
        }
#endif
#endif
#if SKY
        const float open = near ? 1.0f : sky_at(
            blocks, block_side, sky_reach, sky, convert_float4(voxel) + within, normal, widths4);
#else
        const float open = 1.0f;
#endif
        const __global float *part = colours + 3 * (cut && !LINES ? 3 : kind);
#if COLOURED
        const ulong cell = kind == TOUCHED_VOXEL && !cut
            ? linked_cell(MODEL_ARGUMENTS, touched, ranks, voxel) : NO_BRICK;
        if (cell != NO_BRICK && link_offsets[cell] < link_offsets[cell + 1])
            part = palette + 3 * (ulong)nearest_triangle(
                linked, link_offsets[cell], link_offsets[cell + 1], faces, vertices, voxel, at,
                vec(widths.x, widths.y, widths.z));
#endif
        float4 colour = vec(part[0], part[1], part[2]);
#if LINES
#if LEVELS == 1
        const float4 sides = widths, place = within;
#else
        const bool whole = kind == INSIDE_CELL;
        const float4 sides = whole ? vec(widths.x * BRICK_X, widths.y * BRICK_Y, widths.z * BRICK_Z)
                                   : widths;
        const float4 place = whole ? vec(part_in(voxel.x, within.x, BRICK_X),
                                         part_in(voxel.y, within.y, BRICK_Y),
                                         part_in(voxel.z, within.z, BRICK_Z))
                                   : within;
#endif
        colour *= 1.0f - 0.6f * line_at(
            place, normal, (float4)(wide / sides.x, wide / sides.y, wide / sides.z, 1.0f));
#endif
        const float4 light = light_of(
            normal, open, view, key_light, fill_light, up_of, phong, emission, colour);
        sum += over(background, light, 1.0f);
    }
    store_pixel(pixels + 4 * number, sum * (1.0f / RAYS));
}
