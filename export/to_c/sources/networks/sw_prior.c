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

void sw_start_plan(sw_workspace *work, const sw_input *input)
{
    sw_prior_scratch *prior = &work->phase.prior;
    take_past(prior, input->window);
    for (int k = 0; k < SW_HORIZON; k++) {
        float wanted = 0.0f, *now = prior->rows[SW_PRIOR_MEMORY + k];
        sw_products(prior->outputs, &sw_prior_weight[0][0], SW_PRIOR_OUTPUTS, prior->rows[k], SW_PRIOR_PAST);
        for (int u = 0; u < SW_PRIOR_UNITS; u++) wanted += sw_prior_output[u] * sw_tanh(prior->outputs[u]);
        wanted = SW_ACTION_LIMIT * sw_tanh(wanted);
        for (int p = 0; k > 0 && p < SW_PRIOR_ROW - 1; p++) now[p] = prior->outputs[SW_PRIOR_UNITS + p];
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
