/* Integers for activations: their range, and rounding to them. */
#ifndef SW_INTEGER_H
#define SW_INTEGER_H

#include "sw_math.h"
#include "sw_workspace.h"

/* Largest magnitude of an activation or adjoint in a vector of n numbers, so that no product can overflow 32 bits. */
#define SW_QMAX(n) ((n) <= SW_FULL_RANGE_WIDTH ? SW_INT16_QMAX : SW_SUM_QMAX / (n))

/* The nearest integer of a number between -32768 and 32767, ties to even. */
static inline int16_t sw_rounded(float value)
{
    const float magic = 12582912.0f; /* as in sw_exp; these are its bits */
    return (int16_t)((int32_t)sw_to_bits(value + magic) - 0x4b400000);
}

/* The larger and the smaller of two numbers; if the first is a NaN, the second. */
#if defined(__ARM_FEATURE_NUMERIC_MAXMIN) || defined(__ARM_FPV5__)
static inline float sw_fmax(float a, float b) { return __builtin_fmaxf(a, b); }
static inline float sw_fmin(float a, float b) { return __builtin_fminf(a, b); }
#else
static inline float sw_fmax(float a, float b) { return sw_max(a, b); }
static inline float sw_fmin(float a, float b) { return sw_min(a, b); }
#endif

static inline int16_t sw_saturated(float value, float qmax) { return sw_rounded(sw_fmin(sw_fmax(value, -qmax), qmax)); }

#endif
