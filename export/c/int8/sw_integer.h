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

#if SW_DSP
static inline int32_t sw_word(const void *at)
{
    int32_t word;
    __builtin_memcpy(&word, at, 4);
    return word;
}
#endif

/* Matrices are rows of int8, both sides padded to whole words of four. Within a word the weights of columns c .. c + 3
 * stand in the order 0, 2, 1, 3: widening every second byte of a word then gives those of c and c + 1, or of c + 2 and
 * c + 3, which meet two neighbours of a vector.
 */

#if SW_DSP

/* Widened weights of columns c and c + 1 of a word, or of c + 2 and c + 3. */
static inline int32_t sw_low(int32_t word) { return __sxtb16(word); }
static inline int32_t sw_high(int32_t word) { return __sxtb16((int32_t)__ror((uint32_t)word, 8)); }

/* Two words of pairs regrouped: the first, or the second, of each. */
static inline int32_t sw_firsts(int32_t a, int32_t b)
{
    return (int32_t)(((uint32_t)a & 0xffffu) | ((uint32_t)b << 16));
}
static inline int32_t sw_seconds(int32_t a, int32_t b)
{
    return (int32_t)(((uint32_t)b & 0xffff0000u) | ((uint32_t)a >> 16));
}

/* y = w x. */
static inline void sw_dots(int32_t *restrict y, const int8_t *restrict w, const int16_t *restrict x, int rows,
                           int columns)
{
    for (; rows > 0; rows -= 4, y += 4, w += 4 * columns) {
        int32_t s0 = 0, s1 = 0, s2 = 0, s3 = 0;
        for (int c = 0; c < columns; c += 4) {
            const int32_t x01 = sw_word(x + c), x23 = sw_word(x + c + 2);
            const int32_t w0 = sw_word(w + c), w1 = sw_word(w + columns + c);
            const int32_t w2 = sw_word(w + 2 * columns + c), w3 = sw_word(w + 3 * columns + c);
            s0 = __smlad(sw_low(w0), x01, s0);
            s1 = __smlad(sw_low(w1), x01, s1);
            s2 = __smlad(sw_low(w2), x01, s2);
            s3 = __smlad(sw_low(w3), x01, s3);
            s0 = __smlad(sw_high(w0), x23, s0);
            s1 = __smlad(sw_high(w1), x23, s1);
            s2 = __smlad(sw_high(w2), x23, s2);
            s3 = __smlad(sw_high(w3), x23, s3);
        }
        y[0] = s0;
        y[1] = s1;
        y[2] = s2;
        y[3] = s3;
    }
}

/* y[t] = w x[t] for four steps t; rows of x and y are `stride` apart. Two outputs at a time share the widening. */
static inline void sw_product(int32_t *restrict y, const int8_t *restrict w, const int16_t *restrict x, int outputs,
                              int inputs, int stride)
{
    for (int o = 0; o < outputs; o += 2, w += 2 * inputs) {
        int32_t a0 = 0, a1 = 0, a2 = 0, a3 = 0, b0 = 0, b1 = 0, b2 = 0, b3 = 0;
        for (int i = 0; i < inputs; i += 4) {
            const int32_t wa = sw_word(w + i), wb = sw_word(w + inputs + i);
            for (int half = 0; half < 2; half++) {
                const int16_t *pair = x + i + 2 * half;
                const int32_t va = half ? sw_high(wa) : sw_low(wa), vb = half ? sw_high(wb) : sw_low(wb);
                const int32_t x0 = sw_word(pair), x1 = sw_word(pair + stride);
                const int32_t x2 = sw_word(pair + 2 * stride), x3 = sw_word(pair + 3 * stride);
                a0 = __smlad(va, x0, a0);
                b0 = __smlad(vb, x0, b0);
                a1 = __smlad(va, x1, a1);
                b1 = __smlad(vb, x1, b1);
                a2 = __smlad(va, x2, a2);
                b2 = __smlad(vb, x2, b2);
                a3 = __smlad(va, x3, a3);
                b3 = __smlad(vb, x3, b3);
            }
        }
        y[o] = a0, y[o + 1] = b0;
        y[stride + o] = a1, y[stride + o + 1] = b1;
        y[2 * stride + o] = a2, y[2 * stride + o + 1] = b2;
        y[3 * stride + o] = a3, y[3 * stride + o + 1] = b3;
    }
}

/* y[t] = w^T x[t] for four steps t, with w as in sw_product: four inputs of two steps at a time. */
static inline void sw_product_transposed(int32_t *restrict y, const int8_t *restrict w, const int16_t *restrict x,
                                         int outputs, int inputs, int stride)
{
    for (int t = 0; t < 4; t += 2, x += 2 * stride, y += 2 * stride) {
        for (int i = 0; i < inputs; i += 4) {
            int32_t a0 = 0, a1 = 0, a2 = 0, a3 = 0, b0 = 0, b1 = 0, b2 = 0, b3 = 0;
            const int8_t *words = w + i;
            for (int o = 0; o < outputs; o += 2, words += 2 * inputs) {
                const int32_t one = sw_word(words), two = sw_word(words + inputs);
                const int32_t low_one = sw_low(one), low_two = sw_low(two);
                const int32_t high_one = sw_high(one), high_two = sw_high(two);
                const int32_t xa = sw_word(x + o), xb = sw_word(x + stride + o);
                const int32_t w0 = sw_firsts(low_one, low_two), w1 = sw_seconds(low_one, low_two);
                const int32_t w2 = sw_firsts(high_one, high_two), w3 = sw_seconds(high_one, high_two);
                a0 = __smlad(w0, xa, a0);
                b0 = __smlad(w0, xb, b0);
                a1 = __smlad(w1, xa, a1);
                b1 = __smlad(w1, xb, b1);
                a2 = __smlad(w2, xa, a2);
                b2 = __smlad(w2, xb, b2);
                a3 = __smlad(w3, xa, a3);
                b3 = __smlad(w3, xb, b3);
            }
            y[i] = a0, y[i + 1] = a1, y[i + 2] = a2, y[i + 3] = a3;
            y[stride + i] = b0, y[stride + i + 1] = b1, y[stride + i + 2] = b2, y[stride + i + 3] = b3;
        }
    }
}

#else

/* y = w x. The vector is put into the weights' order once; the loop over a row is then one that compilers know. */
static inline void sw_dots(int32_t *restrict y, const int8_t *restrict w, const int16_t *restrict x, int rows,
                           int columns)
{
    int16_t in_order[SW_LONGEST];
    for (int c = 0; c < columns; c += 4) {
        in_order[c] = x[c];
        in_order[c + 1] = x[c + 2];
        in_order[c + 2] = x[c + 1];
        in_order[c + 3] = x[c + 3];
    }
    for (; rows > 0; rows--, y++, w += columns) {
        int32_t sum = 0;
        for (int c = 0; c < columns; c++) sum += w[c] * in_order[c];
        y[0] = sum;
    }
}

/* y[t] = w x[t] for four steps t; rows of x and y are `stride` apart. */
static inline void sw_product(int32_t *restrict y, const int8_t *restrict w, const int16_t *restrict x, int outputs,
                              int inputs, int stride)
{
    for (int t = 0; t < 4; t++) sw_dots(y + t * stride, w, x + t * stride, outputs, inputs);
}

/* y[t] = w^T x[t] for four steps t, with w as in sw_product. */
static inline void sw_product_transposed(int32_t *restrict y, const int8_t *restrict w, const int16_t *restrict x,
                                         int outputs, int inputs, int stride)
{
    for (int t = 0; t < 4; t++, x += stride, y += stride) {
        int32_t sums[SW_LONGEST] = {0};
        for (int o = 0; o < outputs; o++) {
            const int32_t factor = x[o];
            for (int i = 0; i < inputs; i++) sums[i] += w[o * inputs + i] * factor;
        }
        for (int i = 0; i < inputs; i += 4) {
            y[i] = sums[i];
            y[i + 1] = sums[i + 2];
            y[i + 2] = sums[i + 1];
            y[i + 3] = sums[i + 3];
        }
    }
}

#endif

#endif
