/* The integers that represent activations: their range, and the rounding of numbers to them. */
#ifndef SW_INTEGER_H
#define SW_INTEGER_H

#include "sw_math.h"
#include "sw_workspace.h"

/* Largest magnitude of an activation or adjoint in a vector of n numbers, so that no sum of products overflows. */
#define SW_QMAX(n) ((n) <= SW_FULL_RANGE_WIDTH ? SW_INT16_QMAX : SW_SUM_QMAX / (n))

/* Returns the nearest integer to a number between -32768 and 32767; a tie goes to the even integer. */
static inline int16_t sw_rounded(float value)
{
    const float magic = 12582912.0f; /* as in sw_exp; the integer is in the low bits of the sum */
    return (int16_t)(int32_t)(sw_to_bits(value + magic) - 0x4b400000u);
}

/* Returns the sum of two integers modulo 2^32. In exported programs no sum overflows. */
static inline int32_t sw_sum(int32_t a, int32_t b) { return (int32_t)((uint32_t)a + (uint32_t)b); }

/* Return the larger and the smaller of two numbers; if the first is NaN, both functions return the second number. */
#if defined(__ARM_FEATURE_NUMERIC_MAXMIN) || defined(__ARM_FPV5__)
static inline float sw_fmax(float a, float b) { return __builtin_fmaxf(a, b); }
static inline float sw_fmin(float a, float b) { return __builtin_fminf(a, b); }
#else
static inline float sw_fmax(float a, float b) { return sw_max(a, b); }
static inline float sw_fmin(float a, float b) { return sw_min(a, b); }
#endif

static inline int16_t sw_saturated(float value, float qmax) { return sw_rounded(sw_fmin(sw_fmax(value, -qmax), qmax)); }

/* Limits an integer to a range. */
static inline int32_t sw_held(int32_t value, int32_t least, int32_t most)
{
    return value < least ? least : value > most ? most : value;
}

/* Returns value * factor / 2^32, rounded, ties upwards: one instruction of a Cortex-M with the DSP extension. */
static inline int32_t sw_scaled(int32_t value, int32_t factor)
{
    return (int32_t)(((int64_t)value * factor + 0x80000000LL) >> 32);
}

/* Returns start + value * factor / 2^16, rounded down: one instruction, like sw_scaled. */
static inline int32_t sw_scaled_on(int32_t start, int32_t factor, int16_t value)
{
    return sw_sum(start, (int32_t)(((int64_t)factor * value) >> 16));
}

/* Truncates a number to an integer, limited to the range of integers. */
static inline int32_t sw_cut(float value) { return (int32_t)sw_fmin(sw_fmax(value, -2147483648.0f), 2147483520.0f); }

/* Converts a number to a factor for sw_scaled, limited to the largest possible factor. */
static inline int32_t sw_factor(float value) { return (int32_t)sw_fmin(value * 4294967296.0f, 2147483520.0f); }

/* Converts a 64-bit sum to float without a library function. */
static inline float sw_float_of(int64_t sum)
{
    return (float)(int32_t)(sum >> 32) * 4294967296.0f + (float)(uint32_t)(sum & 0xffffffff);
}

#endif
