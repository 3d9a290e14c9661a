/* The products of int8 matrices with int16 vectors, in 32-bit sums.
 *
 * The product is y = w x. The rows of w are padded with zeros to a multiple of 4, and the columns to a multiple of 8. A
 * sum cannot overflow, because each number of a vector of n numbers is within SW_QMAX(n).
 *
 * Matrices are tiles of four rows by four columns; the tiles of the same rows are adjacent. A row's four weights are
 * one word, in the order 0, 2, 1, 3. Sign-extending every second byte of a word then gives the weights for two adjacent
 * numbers of the vector.
 *
 * sw_dots takes one vector. sw_dots_two takes two vectors, and may sign-extend a weight once for both. The two vectors
 * are SW_APART numbers apart, and so are their products. The results are equal bit for bit on every processor.
 */
#ifndef SW_DOTS_H
#define SW_DOTS_H

#include "sw_integer.h"

/* Largest number of columns of a matrix. A file with longer rows defines this macro before including this header. */
#ifndef SW_DOTS_COLUMNS
#define SW_DOTS_COLUMNS SW_LONGEST
#endif

#if defined(__ARM_FEATURE_DSP) && defined(__thumb2__)
#include "sw_dots_dsp.h"
#else
#if defined(__AVX2__) && __STDC_HOSTED__ /* the compilers' headers for AVX2 need a C library */
#include "sw_dots_avx2.h"
#elif defined(__ARM_FEATURE_DOTPROD) && defined(__aarch64__)
#include "sw_dots_neon.h"
#else
#include "sw_dots_plain.h"
#endif

static inline void sw_dots_two(int32_t *restrict y, const int8_t *restrict w, const int16_t *restrict x, int rows,
                               int columns)
{
    sw_dots(y, w, x, rows, columns);
    sw_dots(y + SW_APART, w, x + SW_APART, rows, columns);
}
#endif

#endif
