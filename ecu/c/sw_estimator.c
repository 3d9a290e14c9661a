/* The estimates of each pressure from the other pressures, for all views of a window. A view leaves out sensors or
 * exchanges two sensors (contract/controller/estimator.py).
 *
 * The first layer is linear in the window's columns, so the views share this layer's products of columns and weights.
 * Each product is computed only once, in integers. A view's input to the first ReLU is a sum of these products.
 * Activations are int16: readings in units of 1 / SW_ESTIMATOR_ONE, and hidden activations in units of
 * 1 / SW_INT16_QMAX of the largest activation in their vector. The products of both layers are exact, and all other
 * operations have a fixed order, so that all processors compute the same bits.
 */
#include "sw_ecu_settings.h"
#include "sw_exact.h"

#if SW_SENSOR_CHECK

#include "sw_estimator.h"

/* Largest number of columns of a matrix, for sw_dots.h. */
#define SW_DOTS_COLUMNS SW_ESTIMATOR_LONGEST
#include "sw_dots.h"

#if SW_SENSORS != 4 || SW_LANES != 8 || SW_ESTIMATOR_WIDTH % 8 != 0 || SW_ESTIMATOR_ROWS % 8 != 0
#error "sw_estimator.c: 4 sensors, and widths in whole eights"
#endif
#if SW_ESTIMATOR_ROWS > SW_WINDOW
#error "SW_ESTIMATOR_ROWS: the window has fewer"
#endif

/* Functions marked ONCE are not inlined: a call costs little time, but each copy of their code would take flash. */
#if defined(__GNUC__)
#define ONCE __attribute__((noinline))
#else
#define ONCE
#endif

/* Rounds the window into work->readings. Rows before row `first` are set equal to row `first`. */
static void take_readings(sw_estimator_work *work, const double window[SW_WINDOW][SW_COLUMNS], int first)
{
    for (int r = 0; r < SW_ESTIMATOR_ROWS; r++) {
        const int row = SW_WINDOW - SW_ESTIMATOR_ROWS + r;
        for (int c = 0; c < SW_COLUMNS; c++) work->readings[c][r] = (float)window[row > first ? row : first][c];
    }
}

/* Computes work->sums, the product of the window's column `column` and the first-layer weights of column `place`. */
ONCE static void product_of(sw_estimator_work *work, int place, int column)
{
    const sw_estimator_weights *w = work->weights;
    const float limit = (float)SW_ESTIMATOR_LIMIT;
    for (int r = 0; r < SW_ESTIMATOR_ROWS; r++) {
        const float value = work->readings[column][r];
        work->vector[r] = sw_saturated((value - w->mean[place]) * w->factor[place], limit);
    }
    sw_dots(work->sums, w->column_rows[place], work->vector, SW_ESTIMATOR_WIDTH, SW_ESTIMATOR_ROWS);
}

/* Computes the change of the sums if a sensor is left out. work->sums must have the product of the sensor's column. */
ONCE static void left_out(const sw_estimator_work *work, int sensor, int32_t out[SW_ESTIMATOR_WIDTH])
{
    const sw_estimator_weights *w = work->weights;
    for (int h = 0; h < SW_ESTIMATOR_WIDTH; h++) {
        out[h] = (int32_t)w->flags[sensor][h] * SW_ESTIMATOR_ONE - work->sums[h];
    }
}

/* Computes work->all and work->out, without an exchange of readings. */
ONCE static void in_place(sw_estimator_work *work)
{
    for (int h = 0; h < SW_ESTIMATOR_WIDTH; h++) work->all[h] = 0;
    for (int c = 0; c < SW_COLUMNS; c++) {
        product_of(work, c, c);
        for (int h = 0; h < SW_ESTIMATOR_WIDTH; h++) work->all[h] += work->sums[h];
        if (c < SW_SENSORS) left_out(work, c, work->out[c]);
    }
}

/* Computes work->crossed and work->crossed_out, with the readings of two sensors exchanged. */
ONCE static void exchanged(sw_estimator_work *work, int one, int other)
{
    for (int s = 0; s < SW_SENSORS; s++) {
        for (int h = 0; h < SW_ESTIMATOR_WIDTH; h++) work->crossed_out[s][h] = work->out[s][h];
    }
    product_of(work, one, other);
    left_out(work, one, work->crossed_out[one]);
    product_of(work, other, one);
    left_out(work, other, work->crossed_out[other]);
    for (int h = 0; h < SW_ESTIMATOR_WIDTH; h++) {
        const int32_t before = work->out[one][h] + work->out[other][h];
        work->crossed[h] = work->all[h] + (before - (work->crossed_out[one][h] + work->crossed_out[other][h]));
    }
}

/* Replaces work->values, the first layer's values, by the second layer's values; both are after the ReLU. `largest` is
 * the largest of the first layer's values.
 */
static void second_layer(sw_estimator_work *work, float largest)
{
    const sw_estimator_weights *w = work->weights;
    const float inverse = largest > 0.0f ? (float)SW_INT16_QMAX / largest : 0.0f;
    const float scale = largest / (float)SW_INT16_QMAX;
    SW_FOUR_TIMES
    for (int h = 0; h < SW_ESTIMATOR_WIDTH; h++) work->vector[h] = sw_rounded(work->values[h] * inverse);
    sw_dots(work->sums, w->second_rows, work->vector, SW_ESTIMATOR_WIDTH, SW_ESTIMATOR_WIDTH);
    SW_FOUR_TIMES
    for (int h = 0; h < SW_ESTIMATOR_WIDTH; h++) {
        const float product = (float)work->sums[h] * scale * w->second_scale[h];
        work->values[h] = sw_max(product + w->second_bias[h], 0.0f);
    }
}

/* Computes the hidden layers of a view. `out` is the change of the first layer's sums for the sensor left out. */
ONCE static void hidden_layers(sw_estimator_work *work, const int32_t *sums, const int32_t *out)
{
    const sw_estimator_weights *w = work->weights;
    float largest = 0.0f;
    SW_FOUR_TIMES
    for (int h = 0; h < SW_ESTIMATOR_WIDTH; h++) {
        const float value = (float)(sums[h] + out[h]) * w->first_scale[h] + w->first_bias[h];
        work->values[h] = sw_max(value, 0.0f);
        largest = sw_fmax(largest, work->values[h]);
    }
    second_layer(work, largest);
}

/* Computes the last layer for one sensor, in Cp. The four sums are independent, so no addition waits for another. */
ONCE static double last_layer(const sw_estimator_work *work, int sensor)
{
    const sw_estimator_weights *w = work->weights;
    const float *last = w->last[sensor];
    float sums[4] = {0.0f, 0.0f, 0.0f, 0.0f};
    for (int h = 0; h < SW_ESTIMATOR_WIDTH; h += 4) {
        for (int k = 0; k < 4; k++) sums[k] += last[h + k] * work->values[h + k];
    }
    const float output = (sums[0] + sums[1]) + (sums[2] + sums[3]) + w->last_bias[sensor];
    return (double)(output * w->spread[sensor] + w->mean[sensor]);
}

void sw_estimate(sw_estimator_work *work, const sw_estimator_weights *weights,
                 const double window[SW_WINDOW][SW_COLUMNS], int first)
{
    work->weights = weights;
    take_readings(work, window, first);
    in_place(work);
    int pair = SW_SENSORS;
    for (int i = 0; i < SW_SENSORS; i++) {
        hidden_layers(work, work->all, work->out[i]);
        work->estimates[i][i] = last_layer(work, i);
        for (int j = i + 1; j < SW_SENSORS; j++) {
            for (int h = 0; h < SW_ESTIMATOR_WIDTH; h++) work->crossed[h] = work->all[h] + work->out[j][h];
            hidden_layers(work, work->crossed, work->out[i]);
            work->estimates[j][i] = last_layer(work, i);
            work->estimates[i][j] = last_layer(work, j);
            exchanged(work, i, j);
            for (int s = 0; s < SW_SENSORS; s++) {
                hidden_layers(work, work->crossed, work->crossed_out[s]);
                work->estimates[pair][s] = last_layer(work, s);
            }
            pair++;
        }
    }
}

#endif
