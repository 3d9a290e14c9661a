/* The check that a build computes floats as C99 and IEEE 754 define: it compares results with a known answer.
 *
 * The check detects sums and products in another order, divisions replaced by products, more digits than the type has,
 * small numbers taken as zero, the assumption that numbers are never NaN or infinite, zeros without a sign, and
 * rounding other than to the nearest. The cause may be the compiler or the processor's present mode. The inputs are
 * unknown to the compiler, so that it compiles this code like all other code. sw_compiler.h rejects the flags that a
 * predefined macro shows.
 */
#ifndef SW_ARITHMETIC_H
#define SW_ARITHMETIC_H

#include "sw_math.h"

static inline float sw_unknown(float value)
{
    volatile float held = value;
    return held;
}

/* Returns 0 if the number has these bits. */
static inline uint32_t sw_other(float value, uint32_t bits) { return sw_to_bits(value) ^ bits; }

/* Returns 0 if the number differs from these bits by at most a few units in the last place, as fusing may cause. */
static inline uint32_t sw_far(float value, uint32_t bits) { return (sw_to_bits(value) - bits + 4u) & ~7u; }

/* Returns whether products are added without rounding. A product that rounds to 1 then differs from 1 in a sum. */
static inline int sw_float_fused(void)
{
    const float one = sw_unknown(1.0f), above = sw_unknown(1.00012207f), below = sw_unknown(0.99987793f);
    const float product = above * below;
    return product - one != 0.0f || above * below - one != 0.0f;
}

/* Returns 0 if all results are correct. The control step allows contraction, which changes none of these results. */
static inline uint32_t sw_float_wrong(void)
{
    const float one = sw_unknown(1.0f), three = sw_unknown(3.0f), five = sw_unknown(5.0f), seven = sw_unknown(7.0f);
    const float ten = sw_unknown(10.0f), large = sw_unknown(16777216.0f), most = sw_unknown(3.40282347e38f);
    const float zero = sw_unknown(0.0f), below_zero = sw_unknown(-0.0f), half = sw_unknown(0.5f);
    const float least = sw_unknown(1.17549435e-38f), infinite = most * ten, none = infinite * zero;
    uint32_t wrong = sw_other((one + large) - large, 0u) | sw_other((one - large) + large, 0x3f800000u);
    wrong |= sw_other(sw_unknown(13.0f) * 0.1f * 10.0f, 0x41500001u);
    wrong |= sw_other(five / 3.0f, 0x3fd55555u) | sw_other(sw_unknown(13.0f) / 10.0f, 0x3fa66666u);
    wrong |= sw_other(one / three, 0x3eaaaaabu) | sw_other(five / three, 0x3fd55555u);
    wrong |= sw_other(seven / three, 0x40155555u) | sw_other(ten / three, 0x40555555u);
    wrong |= sw_other(least * half, 0x00400000u) | sw_other(sw_unknown(5.87747175e-39f) * ten, 0x01a00000u);
    wrong |= sw_other(below_zero + 0.0f, 0u) | sw_other(0.0f - zero, 0u);
    wrong |= (uint32_t)(none <= most) | (uint32_t)(none > most) | (uint32_t)sw_all_finite(&none, 1);
    wrong |= (uint32_t)(infinite <= most) | sw_other(sw_max(none, one), 0x3f800000u);
    wrong |= sw_far(sw_exp(three), 0x41a0af2eu) | sw_far(sw_exp(-five), 0x3bdcc9ffu);
    wrong |= sw_far(sw_tanh(half), 0x3eec9a9fu) | sw_far(sw_inverse_sqrt(three), 0x3f13cd3au);
    return wrong;
}

#endif
