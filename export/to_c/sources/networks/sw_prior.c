/* The plan that the optimiser starts from: a feedback on the past, followed over the horizon on predicted differences. */
#include "sw_math.h"
#include "sw_parts.h"
#include "sw_products.h"
#include "sw_weights.h"

#if SW_PRIOR_UNITS > 0

/* Rows before the present one, and the differences of the present one. The window does not hold the oldest, which is taken
 * to be like the one after it.
 */
static void take_past(sw_prior_scratch *prior, const float window[SW_WINDOW][SW_COLUMNS])
{
    const float(*newest)[SW_COLUMNS] = &window[SW_WINDOW - SW_PRIOR_MEMORY];
    for (int row = 1; row <= SW_PRIOR_MEMORY; row++) {
        for (int p = 0; p < SW_PRIOR_ROW - 1; p++) {
            prior->rows[row][p] = newest[row - 1][2 * p] - newest[row - 1][2 * p + 1];
        }
        if (row < SW_PRIOR_MEMORY) prior->rows[row][SW_PRIOR_ROW - 1] = newest[row][SW_SENSORS];
    }
    for (int c = 0; c < SW_PRIOR_ROW; c++) prior->rows[0][c] = prior->rows[1][c];
}

/* What the units read of the past that begins at a row. */
static void filter_past(sw_prior_scratch *prior, const sw_weights *w, int begin, float speed)
{
    const float *weight = w->prior_filter;
    for (int f = 0; f < SW_PRIOR_FILTERS; f++) {
        const int first = begin + (int)w->prior_filter_rows[f][0], count = (int)w->prior_filter_rows[f][1];
        for (int c = 0; c < SW_PRIOR_ROW; c++) {
            float sum = 0.0f;
            for (int i = 0; i < count; i++) sum += weight[i] * prior->rows[first + i][c];
            prior->inputs[f * SW_PRIOR_ROW + c] = sum;
        }
        weight += count;
    }
    for (int i = SW_PRIOR_FILTERED; i < SW_PRIOR_INPUTS; i++) {
        prior->inputs[i] = (speed - 1.0f) * prior->inputs[i - SW_PRIOR_FILTERED];
    }
}

/* The next differences after the past that begins at a row. */
static void predict(sw_prior_scratch *prior, const sw_weights *w, int begin)
{
    const float *past = prior->rows[begin];
    for (int p = 0; p < SW_PRIOR_ROW - 1; p++) {
        float sum = 0.0f;
        for (int i = 0; i < SW_PRIOR_PAST; i++) sum += w->prior_predictor[p][i] * past[i];
        prior->rows[begin + SW_PRIOR_MEMORY][p] = sum;
    }
}

void sw_start_plan(sw_workspace *work, const sw_input *input)
{
    const sw_weights *w = work->program.weights;
    sw_prior_scratch *prior = &work->phase.prior;
    take_past(prior, input->window);
    for (int k = 0; k < SW_HORIZON; k++) {
        float wanted = 0.0f, *now = prior->rows[SW_PRIOR_MEMORY + k];
        if (k > 0) predict(prior, w, k);
        filter_past(prior, w, k, input->speed);
        sw_products(prior->outputs, &w->prior_weight[0][0], SW_PRIOR_OUTPUTS, prior->inputs, SW_PRIOR_INPUTS);
        for (int u = 0; u < SW_PRIOR_UNITS; u++) wanted += w->prior_output[u] * sw_tanh(prior->outputs[u]);
        wanted = w->action_limit * sw_tanh(wanted);
        now[SW_PRIOR_ROW - 1] = input->free[k] > 0.5f ? wanted : input->plan[k + 1 < SW_HORIZON ? k + 1 : k];
        work->plan[k] = now[SW_PRIOR_ROW - 1];
    }
}

#else

void sw_start_plan(sw_workspace *work, const sw_input *input)
{
    for (int k = 0; k < SW_HORIZON; k++) work->plan[k] = input->plan[k + 1 < SW_HORIZON ? k + 1 : k];
}

#endif
