/* Checks for finite numbers; exp, tanh, the logistic function and the square root. The functions have no branches, so
 * that compilers can vectorise loops. Tests check the stated error bounds for all arguments that a controller uses.
 */
#ifndef SW_MATH_H
#define SW_MATH_H

#include <stdint.h>

#include "sw_compiler.h"

static inline float sw_min(float a, float b) { return a < b ? a : b; }
static inline float sw_max(float a, float b) { return a > b ? a : b; }

static inline float sw_from_bits(uint32_t bits)
{
    union {
        uint32_t bits;
        float value;
    } pun;
    pun.bits = bits;
    return pun.value;
}

static inline uint32_t sw_to_bits(float value)
{
    union {
        float value;
        uint32_t bits;
    } pun;
    pun.value = value;
    return pun.bits;
}

static inline float sw_abs(float value) { return sw_from_bits(sw_to_bits(value) & 0x7fffffffu); }

/* Returns whether all numbers are finite; comparisons with NaN are false. */
static inline int sw_all_finite(const float *values, int count)
{
    const float largest = 3.40282347e38f;
    int finite = 1;
    for (int i = 0; i < count; i++) finite &= sw_abs(values[i]) <= largest;
    return finite;
}

/* Returns exp(x) with a relative error of at most 1.5e-7 for -87 <= x <= 88; otherwise exp of the nearer limit. With x
 * = n * ln 2 + r and |r| <= ln 2 / 2, exp(x) is 2^n * (1 + r + r^2 * q(r)); q is fitted for the smallest maximum error.
 */
static inline float sw_exp(float x)
{
    const float magic = 12582912.0f; /* 1.5 * 2^23: after adding it, the sum's low bits are the rounded integer */
    const float held = sw_min(sw_max(x, -87.0f), 88.0f);
    const float shifted = held * 1.44269504f + magic;
    const float n = shifted - magic;
    /* ln 2 is the sum of two parts. The first part has so few digits that its product with n is exact. */
    const float r = (held - n * 0.693359375f) + n * 2.12194440e-4f;
    float q = 1.38145406e-3f;
    q = q * r + 8.36874545e-3f;
    q = q * r + 4.16683890e-2f;
    q = q * r + 1.66665211e-1f;
    q = q * r + 4.99999940e-1f;
    q = q * (r * r) + r + 1.0f;
    return sw_from_bits(sw_to_bits(q) + (sw_to_bits(shifted) << 23));
}

/* Returns 1 / (1 + exp(-x)) with an error of at most 1.5e-7. */
static inline float sw_logistic(float x) { return 1.0f / (1.0f + sw_exp(-x)); }

/* Returns tanh(x) with an error of at most 3e-7. */
static inline float sw_tanh(float x) { return 1.0f - 2.0f / (1.0f + sw_exp(2.0f * x)); }

/* Returns 1 / sqrt(x) with a relative error of at most 3e-7 for normal x > 0: an estimate from the exponent, improved
 * by Newton's iteration.
 */
static inline float sw_inverse_sqrt(float x)
{
    const float half = 0.5f * x;
    float y = sw_from_bits(0x5f375a86u - (sw_to_bits(x) >> 1));
    y = y * (1.5f - half * y * y);
    y = y * (1.5f - half * y * y);
    y = y * (1.5f - half * y * y);
    return y;
}

/* Returns sqrt(x) with a relative error of at most 3e-7; 0 for subnormal x, whose roots are below 1.1e-19. */
static inline float sw_sqrt(float x) { return x < 1.17549435e-38f ? 0.0f : x * sw_inverse_sqrt(x); }

#endif
