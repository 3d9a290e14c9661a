/* Integers for activations: their range, rounding to them, and functions of them by tables. */
#ifndef SW_INTEGER_H
#define SW_INTEGER_H

#include "sw_math.h"
#include "sw_workspace.h"

/* Largest magnitude of an activation or adjoint in a vector of n numbers: (2^31 - 1) / 127 is 16909320. */
#define SW_LEVELS(n) ((n) <= 516 ? 32767 : 16909320 / (n))

/* The nearest integer of a number between -32768 and 32767, ties to even. */
static inline int16_t sw_rounded(float value)
{
    const float magic = 12582912.0f; /* as in sw_exp; these are its bits */
    return (int16_t)((int32_t)sw_to_bits(value + magic) - 0x4b400000);
}

/* The larger and the smaller of two numbers; if the first is a NaN, the second. */
#if defined(__ARM_FEATURE_NUMERIC_MAXMIN) || defined(__ARM_FPV5__)
static inline float sw_larger(float a, float b) { return __builtin_fmaxf(a, b); }
static inline float sw_smaller(float a, float b) { return __builtin_fminf(a, b); }
#else
static inline float sw_larger(float a, float b) { return sw_max(a, b); }
static inline float sw_smaller(float a, float b) { return sw_min(a, b); }
#endif

static inline int16_t sw_saturated(float value, float levels)
{
    return sw_rounded(sw_smaller(sw_larger(value, -levels), levels));
}

/* A table's value at x >= 0 on a straight line between its points, which are `step` apart. A point is a word: its value
 * in the lower half, the rise to the next one in the upper half.
 */
static inline int16_t sw_between(const uint32_t *points, int32_t x, int32_t step)
{
    const uint32_t point = points[x / step];
    const int32_t rise = ((int32_t)(point >> 16) * (x % step) + step / 2) / step;
    return (int16_t)(point + (uint32_t)rise);
}

#endif
