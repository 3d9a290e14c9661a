/* Products of int8 matrices with int16 vectors in 32-bit sums, and the way there and back.
 *
 * A sum cannot overflow: a vector of n numbers keeps within SW_LEVELS(n). Where the core has the DSP extension, one
 * instruction multiplies and adds two pairs; the results are the same to the bit.
 */
#ifndef SW_INTEGER_H
#define SW_INTEGER_H

#include "sw_math.h"
#include "sw_workspace.h"

#if defined(__ARM_FEATURE_DSP) && defined(__thumb2__)
#include <arm_acle.h>
#define SW_DSP 1
#else
#define SW_DSP 0
#endif

/* Largest magnitude of an activation or adjoint in a vector of n numbers: (2^31 - 1) / 127 is 16909320. */
#define SW_LEVELS(n) ((n) <= 516 ? 32767 : 16909320 / (n))

/* The nearest integer of a number between -32768 and 32767, ties to even. */
static inline int16_t sw_rounded(float value)
{
    const float magic = 12582912.0f; /* as in sw_exp; these are its bits */
    return (int16_t)((int32_t)sw_to_bits(value + magic) - 0x4b400000);
}

static inline int16_t sw_saturated(float value, float levels)
{
    return sw_rounded(sw_min(sw_max(value, -levels), levels));
}

/* y = w x; rows a multiple of 4, columns of 8, padded with zeros.
 *
 * Matrices are tiles of four rows by four columns, those of the same rows one behind the other. A row's four weights are
 * one word, in the order 0, 2, 1, 3: widening every second byte of a word then gives the weights of two neighbours of
 * the vector.
 */
#if SW_DSP

/* The inner loop is written out, because compilers run out of registers there, and ordered for cores that issue two
 * instructions at a time: widening alternates with multiplying, and weights are loaded two rows ahead. The last loads
 * read the SW_AHEAD bytes that follow every matrix.
 */
#define SW_EIGHT_COLUMNS                                                                                   \
    "ldrd %[xa], %[xb], [%[x]], #8\n" "sxtb16 %[t], %[wa]\n" "sxtb16 %[u], %[wa], ror #8\n"                \
    "ldr %[wa], [%[w]], #4\n" "smlad %[s0], %[t], %[xa], %[s0]\n" "sxtb16 %[t], %[wb]\n"                   \
    "smlad %[s0], %[u], %[xb], %[s0]\n" "sxtb16 %[u], %[wb], ror #8\n" "smlad %[s1], %[t], %[xa], %[s1]\n" \
    "ldr %[wb], [%[w]], #4\n" "sxtb16 %[t], %[wa]\n" "smlad %[s1], %[u], %[xb], %[s1]\n"                   \
    "sxtb16 %[u], %[wa], ror #8\n" "smlad %[s2], %[t], %[xa], %[s2]\n" "ldr %[wa], [%[w]], #4\n"           \
    "sxtb16 %[t], %[wb]\n" "smlad %[s2], %[u], %[xb], %[s2]\n" "sxtb16 %[u], %[wb], ror #8\n"              \
    "smlad %[s3], %[t], %[xa], %[s3]\n" "ldr %[wb], [%[w]], #4\n" "smlad %[s3], %[u], %[xb], %[s3]\n"      \
    "ldrd %[xa], %[xb], [%[x]], #8\n" "sxtb16 %[t], %[wa]\n" "sxtb16 %[u], %[wa], ror #8\n"                \
    "ldr %[wa], [%[w]], #4\n" "smlad %[s0], %[t], %[xa], %[s0]\n" "sxtb16 %[t], %[wb]\n"                   \
    "smlad %[s0], %[u], %[xb], %[s0]\n" "sxtb16 %[u], %[wb], ror #8\n" "smlad %[s1], %[t], %[xa], %[s1]\n" \
    "ldr %[wb], [%[w]], #4\n" "sxtb16 %[t], %[wa]\n" "smlad %[s1], %[u], %[xb], %[s1]\n"                   \
    "sxtb16 %[u], %[wa], ror #8\n" "smlad %[s2], %[t], %[xa], %[s2]\n" "ldr %[wa], [%[w]], #4\n"           \
    "sxtb16 %[t], %[wb]\n" "smlad %[s2], %[u], %[xb], %[s2]\n" "sxtb16 %[u], %[wb], ror #8\n"              \
    "smlad %[s3], %[t], %[xa], %[s3]\n" "ldr %[wb], [%[w]], #4\n"  \
    "smlad %[s3], %[u], %[xb], %[s3]\n"

#define SW_OPERANDS                                                                                          \
    [s0] "+r"(s0), [s1] "+r"(s1), [s2] "+r"(s2), [s3] "+r"(s3), [x] "+r"(vector), [w] "+r"(weights),         \
        [wa] "+r"(wa), [wb] "+r"(wb), [xa] "=&r"(xa), [xb] "=&r"(xb), [t] "=&r"(t), [u] "=&r"(u)

static inline void sw_dots(int32_t *restrict y, const int8_t *restrict w, const int16_t *restrict x, int rows,
                           int columns)
{
    for (; rows > 0; rows -= 4, y += 4, w += 4 * columns) {
        int32_t s0 = 0, s1 = 0, s2 = 0, s3 = 0, xa, xb, wa, wb, t, u;
        const int16_t *vector = x;
        const int8_t *weights = w;
        int count = columns / 16;
        __asm__ volatile("ldr %[wa], [%[w]], #4\n" "ldr %[wb], [%[w]], #4\n"
                         : [w] "+r"(weights), [wa] "=&r"(wa), [wb] "=&r"(wb) : : "memory");
        /* Both are decided when this is compiled, since sizes are constants. */
        if (columns % 16 != 0) __asm__ volatile(SW_EIGHT_COLUMNS : SW_OPERANDS : : "memory");
        if (count > 0) {
            __asm__ volatile("1:\n" "subs %[count], #1\n" SW_EIGHT_COLUMNS SW_EIGHT_COLUMNS "bne 1b\n"
                             : SW_OPERANDS, [count] "+l"(count) : : "cc", "memory");
        }
        y[0] = s0;
        y[1] = s1;
        y[2] = s2;
        y[3] = s3;
    }
}

#else

/* The vector is put into the tiles' order once; the loop over them is then one that compilers vectorise. */
static inline void sw_dots(int32_t *restrict y, const int8_t *restrict w, const int16_t *restrict x, int rows,
                           int columns)
{
    int16_t in_order[4 * SW_LONGEST];
    for (int c = 0; c < columns; c += 4) {
        for (int r = 0; r < 4; r++) {
            in_order[4 * c + 4 * r] = x[c];
            in_order[4 * c + 4 * r + 1] = x[c + 2];
            in_order[4 * c + 4 * r + 2] = x[c + 1];
            in_order[4 * c + 4 * r + 3] = x[c + 3];
        }
    }
    for (; rows > 0; rows -= 4, y += 4, w += 4 * columns) {
        int32_t sums[32] = {0};
        for (int c = 0; c < 4 * columns; c += 32) {
            for (int j = 0; j < 32; j++) sums[j] += w[c + j] * in_order[c + j];
        }
        for (int j = 0; j < 16; j++) sums[j] += sums[j + 16];
        for (int r = 0; r < 4; r++) {
            y[r] = (sums[4 * r] + sums[4 * r + 1]) + (sums[4 * r + 2] + sums[4 * r + 3]);
        }
    }
}

#endif

#endif
