/*
 * raymarch/samples.h: the pixels of a picture that are drawn at once, and their rays.
 *
 * What is known of the SAMPLES x SAMPLES rays of one pixel is kept together.
 *
 * Defines:    LISTED   1: pixels of a list; 0: pixels in a row
 *             SAMPLES  rays along the side of a pixel
 */
#ifndef CLVOX_SAMPLES_H
#define CLVOX_SAMPLES_H

/* picture: its columns and rows; first: number of the first pixel; pixel_count: how many there are;
 * list: uint32, their numbers, if LISTED, from entry first_pixel on. */
#define PIXEL_PARAMETERS \
    const int2 picture, const ulong first_pixel, const ulong pixel_count, \
    const __global uint *restrict list

#define NUMBER_OF_PIXEL(item) (LISTED ? (ulong)list[first_pixel + (item)] : first_pixel + (item))

/* Column and row of the ray of one of the samples of pixel `number`. */
static inline int2 ray_of_sample(const ulong number, const int columns, const int sample)
{
    /* A picture has fewer than 2**32 pixels. */
    const int row = (int)((uint)number / (uint)columns), column = (int)number - row * columns;
    const int below = sample / SAMPLES;
    return (int2)(column * SAMPLES + sample - below * SAMPLES, row * SAMPLES + below);
}

#endif
