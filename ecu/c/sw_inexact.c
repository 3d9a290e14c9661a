/* The check of exact arithmetic: known answers in float and double, and a test that no operations are fused. */
/* This header comes before all others: it also switches off contraction for the checks of sw_arithmetic.h. */
#include "sw_exact.h"

#include "sw_arithmetic.h"
#include "sw_ecu_parts.h"

static double unknown(double value)
{
    volatile double held = value;
    return held;
}

static int double_is_right(void)
{
    const double one = unknown(1.0), three = unknown(3.0), large = unknown(9007199254740992.0);
    const double most = unknown(1.7976931348623157e308), infinite = most * three, none = infinite * unknown(0.0);
    int right = ((one + large) - large) < one && ((one - large) + large) >= one;
    right &= unknown(13.0) * 1.1 * 1.3 == unknown(18.59);
    right &= unknown(7.0) / 10.0 == unknown(0.7) && unknown(10.0) / three == unknown(3.3333333333333335);
    right &= unknown(7.0) / three == unknown(2.3333333333333335) && unknown(5.0) / three == unknown(1.6666666666666667);
    right &= unknown(2.2250738585072014e-308) * unknown(0.5) * unknown(4.0) == unknown(4.4501477170144028e-308);
    return right && !(none <= most) && !(infinite <= most);
}

/* Repeats in double the check that sw_arithmetic.h makes in float. */
static int is_fused(void)
{
    const double whole = unknown(1.0), up = unknown(1.0000000074505806), down = unknown(0.99999999254941940);
    const double longer = up * down;
    return sw_float_fused() || longer - whole != 0.0 || up * down - whole != 0.0;
}

uint8_t sw_inexact(void)
{
    const int exact = sw_float_wrong() == 0u && double_is_right() && !is_fused();
    return (uint8_t)(exact ? SW_REASON_NONE : SW_REASON_INTERNAL);
}
