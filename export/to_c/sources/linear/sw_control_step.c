/* A control step of a linear controller: the history of differences, and then, step by step over the horizon, the action
 * that is committed or that the feedback wants, and what the model predicts under it.
 */
#include "sw_cost.h"
#include "sw_math.h"
#include "sw_products.h"
#include "sw_weights.h"

/* Rows (y, a) of the window's rows (Cp, action one step before). The last row's action is not decided yet. */
static void take_history(sw_workspace *work, const float window[SW_WINDOW][SW_COLUMNS])
{
    for (int row = 0; row < SW_WINDOW; row++) {
        for (int p = 0; p < SW_DIFFERENCES; p++) work->history[row][p] = window[row][2 * p] - window[row][2 * p + 1];
        if (row + 1 < SW_WINDOW) work->history[row][SW_DIFFERENCES] = window[row + 1][SW_SENSORS];
    }
}

static void roll_out(sw_workspace *work, const sw_input *input)
{
    const sw_weights *w = work->program.weights;
    float outputs[SW_OUTPUTS];
    for (int k = 0; k < SW_HORIZON; k++) {
        const float committed = input->plan[k + 1 < SW_HORIZON ? k + 1 : k];
        sw_products(outputs, &w->by_history[0][0], SW_OUTPUTS, &work->history[k][0], SW_HISTORY);
        const float held = sw_min(sw_max(outputs[SW_ROW], -w->action_limit), w->action_limit);
        const float action = input->free[k] > 0.5f ? held : committed;
        for (int row = 0; row < SW_ROW; row++) outputs[row] += w->by_action[row] * action;
        work->plan[k] = action;
        work->start[k] = action;
        work->history[SW_WINDOW - 1 + k][SW_DIFFERENCES] = action;
        for (int p = 0; p < SW_DIFFERENCES; p++) work->history[SW_WINDOW + k][p] = outputs[p];
        work->forces[0][k] = w->force_mean[0];
        work->forces[1][k] = outputs[SW_DIFFERENCES];
    }
}

sw_status sw_control_step_of(const sw_program *program, sw_workspace *work, const sw_input *input, sw_output *output)
{
    if (sw_arithmetic() != SW_OK) return sw_refused(output);
    work->program = *program;
    take_history(work, input->window);
    roll_out(work, input);
    sw_cost_terms(work, input->window[SW_WINDOW - 1][SW_SENSORS], output->terms);
    output->cost = 0.0f;
    for (int i = 0; i < SW_TERMS; i++) output->cost += input->weights[i] * output->terms[i];
    for (int k = 0; k < SW_HORIZON; k++) {
        output->plan[k] = work->plan[k];
        output->forces[k][0] = work->forces[0][k];
        output->forces[k][1] = work->forces[1][k];
    }
    /* The inputs as well: clipping makes a finite action of a NaN. */
    const int finite = sw_all_finite(&input->window[0][0], SW_WINDOW * SW_COLUMNS) &
                       sw_all_finite(input->plan, SW_HORIZON) & sw_all_finite(input->weights, SW_TERMS) &
                       sw_all_finite(&output->forces[0][0], 2 * SW_HORIZON) & sw_all_finite(output->plan, SW_HORIZON) &
                       sw_all_finite(&output->cost, 1);
    return finite ? SW_OK : SW_NOT_FINITE;
}
