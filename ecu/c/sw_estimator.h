/* The network that estimates each pressure from the other pressures: its scratch memory and its weights. A release's
 * weights come from its sensors.onnx. The generated sw_estimator_weights.c defines the weights that are compiled in.
 *
 * Matrices are int8 with one scale for each output, as in sensors.onnx, in the layout of sw_dots.h.
 */
#ifndef SW_ESTIMATOR_H
#define SW_ESTIMATOR_H

#include <stdint.h>

#include "sw_estimator_settings.h"
#include "sw_settings.h"
#include "sw_workspace.h"

/* The network's weights, read in place: little-endian, no pointers, every member aligned to SW_ALIGNMENT. */
typedef struct sw_estimator_weights {
    /* Standardisation of a window's columns: (value - mean) * factor, rounded to an integer. */
    SW_ALIGNED float mean[SW_SENSORS + 1];
    SW_ALIGNED float factor[SW_SENSORS + 1];

    /* First layer: one weight matrix for each column of the window, and the weights of each sensor's flag, which is 1
     * if the sensor is left out.
     */
    SW_ALIGNED int8_t column_rows[SW_SENSORS + 1][SW_ESTIMATOR_WIDTH * SW_ESTIMATOR_ROWS + SW_AHEAD];
    SW_ALIGNED int8_t flags[SW_SENSORS][SW_ESTIMATOR_WIDTH];
    SW_ALIGNED float first_scale[SW_ESTIMATOR_WIDTH]; /* value of one unit of the sum */
    SW_ALIGNED float first_bias[SW_ESTIMATOR_WIDTH];

    SW_ALIGNED int8_t second_rows[SW_ESTIMATOR_WIDTH * SW_ESTIMATOR_WIDTH + SW_AHEAD];
    SW_ALIGNED float second_scale[SW_ESTIMATOR_WIDTH];
    SW_ALIGNED float second_bias[SW_ESTIMATOR_WIDTH];

    /* Last layer: Cp = mean + spread * output. */
    SW_ALIGNED float last[SW_SENSORS][SW_ESTIMATOR_WIDTH];
    SW_ALIGNED float last_bias[SW_SENSORS];
    SW_ALIGNED float spread[SW_SENSORS];
} sw_estimator_weights;

extern const sw_estimator_weights sw_own_estimator; /* the compiled-in weights */

/* Scratch memory. The sums are first-layer sums in integers; SW_ESTIMATOR_ONE represents a reading or flag of 1. */
typedef struct {
    const sw_estimator_weights *weights;         /* the network in use */
    int32_t all[SW_ESTIMATOR_WIDTH];             /* sum of all columns' products, without exchange and flags */
    int32_t crossed[SW_ESTIMATOR_WIDTH];         /* `all` with two readings exchanged, or without a sensor */
    int32_t out[SW_SENSORS][SW_ESTIMATOR_WIDTH]; /* change of the sum if a sensor is left out: flag minus column */
    int32_t crossed_out[SW_SENSORS][SW_ESTIMATOR_WIDTH]; /* change of `crossed` if a sensor is left out */
    int32_t sums[SW_ESTIMATOR_WIDTH];
    float readings[SW_COLUMNS][SW_ESTIMATOR_ROWS]; /* columns of the window */
    float values[SW_ESTIMATOR_WIDTH];
    int16_t vector[SW_ESTIMATOR_LONGEST];
    double estimates[SW_SENSORS + SW_SENSORS * (SW_SENSORS - 1) / 2][SW_SENSORS]; /* the result of sw_estimate */
} sw_estimator_work;

/* Writes estimates of the newest pressures, in Cp, to work->estimates. Entry [h][i] is the estimate for sensor i under
 * hypothesis h. The estimates of row j < SW_SENSORS leave out the sensors j and i. The estimates of row SW_SENSORS + p
 * exchange the p-th pair of sensors and leave out sensor i. The window has data from row `first` on. Estimates are
 * always finite.
 */
void sw_estimate(sw_estimator_work *work, const sw_estimator_weights *weights,
                 const double window[SW_WINDOW][SW_COLUMNS], int first);

#endif
