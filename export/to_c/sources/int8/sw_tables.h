/* The functions ELU, logistic and tanh of integers, computed from tables with linear interpolation. */
#ifndef SW_TABLES_H
#define SW_TABLES_H

#include "sw_integer.h"
#include "sw_weights.h"

/* Returns a table's value at x >= 0, interpolated linearly between points that are `step` apart. A point is a word: the
 * lower half is its value, and the upper half is the rise to the next point.
 */
static inline int16_t sw_between(const uint32_t *points, int32_t x, int32_t step)
{
    const uint32_t point = points[x / step];
    const int32_t rise = (int32_t)point >> 16; /* signed, so that shift and product are one instruction */
    return (int16_t)(point + (uint32_t)(rise * (x % step) + step / 2) / (uint32_t)step);
}

/* Returns ELU(y) in units of 1 / SW_ELU_ONE; the argument is y in units of 1 / SW_ELU_ARGUMENT_ONE, plus SW_ELU_START.
 * Interpolation between points 1 / 32 apart errs by at most 1.5 units. Below -8 and above 8 the value is constant.
 */
static inline int16_t sw_elu(int32_t y)
{
    return sw_between(sw_elu_points, sw_held(y, 0, 2 * SW_ELU_START - 1), SW_ELU_STEP);
}

/* Returns ELU' in units of 1 / 256, minus one unit, so that a byte suffices; h is in units of 1 / SW_ELU_ONE. */
static inline uint8_t sw_slope_of(int16_t h) { return (uint8_t)sw_held((h + SW_ELU_ONE) >> SW_SLOPE_SHIFT, 0, 255); }

/* Returns 1 / (1 + exp(-x)) in units of 1 / SW_LOGISTIC_QMAX; the argument is x in units of 1 / SW_LOGISTIC_ONE, plus
 * SW_LOGISTIC_START. Interpolation between points 1 / 32 apart errs by at most 5e-5. For |x| > 16 the value is fixed.
 */
static inline int32_t sw_table_logistic(int32_t x)
{
    return sw_between(sw_logistic_points, sw_held(x, 0, 2 * SW_LOGISTIC_START - 1), SW_LOGISTIC_STEP);
}

/* Returns tanh(x) in units of 1 / SW_LOGISTIC_QMAX, from the logistic function of 2 x. */
static inline int32_t sw_tanh_of(int32_t logistic) { return 2 * logistic - SW_LOGISTIC_QMAX; }

#endif
