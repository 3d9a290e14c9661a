/* The network that estimates each pressure from the other ones: its scratch memory, and its numbers, which are generated
 * into sw_estimator_weights.c from a release's sensors.onnx.
 *
 * Matrices are int8 with one scale an output, as in that file, laid out as in sw_dots.h.
 */
#ifndef SW_ESTIMATOR_H
#define SW_ESTIMATOR_H

#include <stdint.h>

#include "sw_estimator_settings.h"
#include "sw_settings.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Sums are of the first layer, in integers: one unit of a standardised reading or of a flag is SW_ESTIMATOR_ONE. */
typedef struct {
    int32_t all[SW_ESTIMATOR_WIDTH];     /* every column in its place, no flag */
    int32_t crossed[SW_ESTIMATOR_WIDTH]; /* the same with two readings exchanged */
    int32_t out[SW_SENSORS][SW_ESTIMATOR_WIDTH];         /* what leaving a sensor out adds: its flag less its column */
    int32_t crossed_out[SW_SENSORS][SW_ESTIMATOR_WIDTH]; /* the same with two readings exchanged */
    int32_t sums[SW_ESTIMATOR_WIDTH];
    float values[SW_ESTIMATOR_WIDTH];
    int16_t vector[SW_ESTIMATOR_LONGEST];
    double estimates[SW_SENSORS + SW_SENSORS * (SW_SENSORS - 1) / 2][SW_SENSORS]; /* sw_estimate's answer */
} sw_estimator_work;

/* Standardisation of a window's columns: (value - mean) factor, in integers. */
extern const float sw_estimator_mean[SW_SENSORS + 1];
extern const float sw_estimator_factor[SW_SENSORS + 1];

/* First layer: a matrix for the rows of each column, and the flag of each sensor. */
extern const int8_t sw_estimator_column_rows[SW_SENSORS + 1][SW_ESTIMATOR_WIDTH * SW_ESTIMATOR_ROWS + SW_AHEAD];
extern const int8_t sw_estimator_flags[SW_SENSORS][SW_ESTIMATOR_WIDTH];
extern const float sw_estimator_first_scale[SW_ESTIMATOR_WIDTH]; /* of an integer */
extern const float sw_estimator_first_bias[SW_ESTIMATOR_WIDTH];

extern const int8_t sw_estimator_second_rows[SW_ESTIMATOR_WIDTH * SW_ESTIMATOR_WIDTH + SW_AHEAD];
extern const float sw_estimator_second_scale[SW_ESTIMATOR_WIDTH];
extern const float sw_estimator_second_bias[SW_ESTIMATOR_WIDTH];

/* Last layer; Cp = mean + spread output. */
extern const float sw_estimator_last[SW_SENSORS][SW_ESTIMATOR_WIDTH];
extern const float sw_estimator_last_bias[SW_SENSORS];
extern const float sw_estimator_spread[SW_SENSORS];

#ifdef __cplusplus
}
#endif

#endif
