/* Whether a build computes as C99 and IEEE 754 have it, in float: a known answer.
 *
 * It finds sums and products in another order, divisions made products, more digits than the type has, small numbers
 * taken as zero, numbers that must not be NaN or infinite, zeros without a sign, and another rounding than to the nearest:
 * the compiler's doing, or the processor's mode of now. What goes in is unknown to the compiler, so that it does the same
 * to this as to all that it compiles with the same flags. What a macro tells is refused in sw_compiler.h.
 */
#ifndef SW_ARITHMETIC_H
#define SW_ARITHMETIC_H

#include "sw_math.h"

static inline float sw_unknown(float value)
{
    volatile float held = value;
    return held;
}

/* 0 if the number has these bits. */
static inline uint32_t sw_other(float value, uint32_t bits) { return sw_to_bits(value) ^ bits; }

/* 0 if it has, within the few last steps that a contraction to fused operations moves it. */
static inline uint32_t sw_far(float value, uint32_t bits) { return (sw_to_bits(value) - bits + 4u) & ~7u; }

/* Whether products are added without having been rounded: one that rounds to 1, less 1. */
static inline int sw_float_fused(void)
{
    const float one = sw_unknown(1.0f), above = sw_unknown(1.00012207f), below = sw_unknown(0.99987793f);
    const float product = above * below;
    return product - one != 0.0f || above * below - one != 0.0f;
}

/* 0 if all is right; contraction, which the control step allows, changes none of it. */
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
