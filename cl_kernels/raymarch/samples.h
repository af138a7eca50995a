/*
 * raymarch/samples.h: the pixels of a picture that are drawn at once, and their rays.
 *
 * A pixel is divided into PLACES x PLACES places, and its rays run through as many of them as there
 * are along a side: one in each row and one in each column of places, so that a steep edge has as
 * many shades as a slanted one.  What is known of the rays of one pixel is kept together.
 *
 * Defines:    LISTED   1: pixels of a list; 0: pixels in a row
 *             SAMPLES  root of the number of rays of a pixel
 *             EACH     1: all of them; 0: one of them, another one in each pixel of a row or column
 */
#ifndef CLVOX_SAMPLES_H
#define CLVOX_SAMPLES_H

/* picture: its columns and rows; first: number of the first pixel; pixel_count: how many there are;
 * list: uint32, their numbers, if LISTED, from entry first_pixel on. */
#define PIXEL_PARAMETERS \
    const int2 picture, const ulong first_pixel, const ulong pixel_count, \
    const __global uint *restrict list

#define PLACES (SAMPLES * SAMPLES)
#define RAYS (EACH ? SAMPLES * SAMPLES : 1)

#define NUMBER_OF_PIXEL(item) (LISTED ? (ulong)list[first_pixel + (item)] : first_pixel + (item))

/* Column and row, in places, of one of the RAYS of pixel `number`. */
static inline int2 ray_of_sample(const ulong number, const int columns, const int sample)
{
    /* A picture has fewer than 2**32 pixels. */
    const int row = (int)((uint)number / (uint)columns), column = (int)number - row * columns;
    /* SAMPLES + 1 has no divisor in common with PLACES: any of them in a row are all the rays.  The
     * first pixel of all has one near its middle, lest a picture of one pixel be empty. */
    const uint turn = (uint)(column + SAMPLES / 2) * (SAMPLES + 1) + (uint)row;
    const int ray = EACH ? sample : (int)(turn % PLACES);
    const int below = ray / SAMPLES, beside = ray - below * SAMPLES;
    return (int2)(column * PLACES + beside * SAMPLES + SAMPLES - 1 - below,
                  row * PLACES + below * SAMPLES + beside);
}

#endif
