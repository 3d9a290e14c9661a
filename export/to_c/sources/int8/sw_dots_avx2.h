/* sw_dots.h for x86 processors with AVX2: one instruction multiplies and adds the eight pairs of numbers of a tile. */
#ifndef SW_DOTS_AVX2_H
#define SW_DOTS_AVX2_H

#include <immintrin.h>

#include "sw_workspace.h"

/* Number of tiles, of four rows each, that share the loads of a vector. */
#define SW_BESIDE 8

/* Returns `sums` plus the products of a tile with four numbers of the vector in the tile's order. `sums` has two
 * numbers for each row.
 */
static inline __m256i sw_with_tile(__m256i sums, const int8_t *tile, __m256i vector)
{
    const __m256i weights = _mm256_cvtepi8_epi16(_mm_loadu_si128((const __m128i *)(const void *)tile));
    return _mm256_add_epi32(sums, _mm256_madd_epi16(weights, vector));
}

static inline void sw_store_rows(int32_t *y, __m256i sums)
{
    const __m256i pairs = _mm256_hadd_epi32(sums, sums); /* sums of the rows 0, 1, 0, 1, 2, 3, 2, 3 */
    _mm_storeu_si128((__m128i *)(void *)y,
                     _mm_unpacklo_epi64(_mm256_castsi256_si128(pairs), _mm256_extracti128_si256(pairs, 1)));
}

static inline void sw_dots(int32_t *restrict y, const int8_t *restrict w, const int16_t *restrict x, int rows,
                           int columns)
{
    const int four_rows = 4 * columns;
    __m256i vector[SW_DOTS_COLUMNS / 4];
    for (int c = 0; c < columns; c += 4) {
        const __m128i four = _mm_loadl_epi64((const __m128i *)(const void *)(x + c));
        vector[c / 4] = _mm256_broadcastq_epi64(_mm_shufflelo_epi16(four, _MM_SHUFFLE(3, 1, 2, 0)));
    }
    for (; rows >= 4 * SW_BESIDE; rows -= 4 * SW_BESIDE, y += 4 * SW_BESIDE, w += SW_BESIDE * four_rows) {
        __m256i sums[SW_BESIDE];
        for (int i = 0; i < SW_BESIDE; i++) sums[i] = _mm256_setzero_si256();
        for (int c = 0; c < columns; c += 4) {
            for (int i = 0; i < SW_BESIDE; i++) {
                sums[i] = sw_with_tile(sums[i], w + i * four_rows + 4 * c, vector[c / 4]);
            }
        }
        for (int i = 0; i < SW_BESIDE; i++) sw_store_rows(y + 4 * i, sums[i]);
    }
    for (; rows > 0; rows -= 4, y += 4, w += four_rows) {
        __m256i sums = _mm256_setzero_si256();
        for (int c = 0; c < columns; c += 4) sums = sw_with_tile(sums, w + 4 * c, vector[c / 4]);
        sw_store_rows(y, sums);
    }
}

#endif
