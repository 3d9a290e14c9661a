/* The plan that the optimiser starts from: a feedback on the past, followed over the horizon on predicted differences. */
#include "sw_math.h"
#include "sw_parts.h"
#include "sw_products.h"
#include "sw_weights.h"

#if SW_PRIOR_UNITS > 0

/* What schedules the units, in the order of their weights. */
enum { ONE, SPEED, EFFORT, LIFT, LIMIT };

/* Where a weight of the cost lies in the range that the prior knows. */
static float root_of(float weight, float dearest)
{
    if (weight < dearest) return sw_sqrt(weight / dearest);
    return weight > 0.0f ? 1.0f : 0.0f;
}

/* Speed and goal as contract/controller/goal.py has them. */
static void take_schedule(float schedule[SW_SCHEDULED], const sw_workspace *work, const sw_input *input)
{
    const float *weights = input->weights, share = work->limit / work->program.weights->action_limit;
    schedule[ONE] = 1.0f;
    schedule[SPEED] = (input->speed - 1.0f) / SW_SPEED_SCALE;
    schedule[EFFORT] = root_of(weights[SW_EFFORT], SW_DEAREST_EFFORT * weights[SW_DRAG_MEAN]);
    schedule[LIFT] = root_of(weights[SW_LIFT], SW_DEAREST_LIFT * weights[SW_DRAG_MEAN]);
    schedule[LIMIT] = sw_min(sw_max((1.0f - share) / (1.0f - SW_NARROWEST), 0.0f), 1.0f);
}

/* What is read of the past that begins at a row: the first columns of its rows, filtered. */
static void filter_past(sw_prior_scratch *prior, const sw_weights *w, int begin, int columns)
{
    const float *weight = w->prior_filter;
    for (int f = 0; f < SW_PRIOR_FILTERS; f++) {
        const int first = begin + (int)w->prior_filter_rows[f][0], count = (int)w->prior_filter_rows[f][1];
        for (int c = 0; c < columns; c++) {
            float sum = 0.0f;
            for (int i = 0; i < count; i++) sum += weight[i] * prior->rows[first + i][c];
            prior->inputs[f * columns + c] = sum;
        }
        weight += count;
    }
}

/* The weights of the units at the present speed and goal. */
static void take_weights(sw_prior_scratch *prior, const sw_weights *w, const float schedule[SW_SCHEDULED])
{
    for (int o = 0; o < SW_PRIOR_OUTPUTS; o++) {
        float factor[SW_PRIOR_SCHEDULED];
        for (int j = 0; j < SW_PRIOR_SCHEDULED; j++) factor[j] = schedule[j] * w->prior_first_scale[o][j];
        for (int i = 0; i < SW_PRIOR_INPUTS; i++) {
            float weight = 0.0f;
            for (int j = 0; j < SW_PRIOR_SCHEDULED; j++) weight += factor[j] * (float)w->prior_first[o][i][j];
            prior->weight[i][o] = weight;
        }
    }
}

/* The last layer behind the gates, which read the sums of the newest rows. */
static void take_gates(sw_prior_scratch *prior, const sw_weights *w, const float schedule[SW_SCHEDULED],
                       const float window[SW_WINDOW][SW_COLUMNS])
{
#if SW_PRIOR_GATED
    const float(*newest)[SW_COLUMNS] = &window[SW_WINDOW - SW_PRIOR_MEMORY];
    for (int row = 0; row < SW_PRIOR_MEMORY; row++) {
        for (int p = 0; p < SW_PRIOR_ROW - 1; p++) {
            prior->rows[row][p] = newest[row][2 * p] + newest[row][2 * p + 1];
        }
    }
    filter_past(prior, w, 0, SW_PRIOR_ROW - 1);
    for (int u = 0; u < SW_PRIOR_UNITS; u++) {
        float gate = 0.0f, by_sums = 0.0f;
        for (int j = 0; j < SW_PRIOR_SCHEDULED; j++) gate += w->prior_gate[u][j] * schedule[j];
        for (int i = 0; i < SW_PRIOR_SUMS; i++) by_sums += (float)w->prior_sums[u][i] * prior->inputs[i];
        prior->gated[u] = w->prior_output[u] * (1.0f + sw_tanh(gate + w->prior_sums_scale[u] * by_sums));
    }
#else
    (void)schedule;
    (void)window;
    for (int u = 0; u < SW_PRIOR_UNITS; u++) prior->gated[u] = w->prior_output[u];
#endif
}

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
    float schedule[SW_SCHEDULED];
    take_schedule(schedule, work, input);
    take_weights(prior, w, schedule);
    take_gates(prior, w, schedule, input->window);
    take_past(prior, input->window);
    const float most = (1.0f - (1.0f - SW_NARROWEST) * schedule[LIMIT]) * w->action_limit;
    for (int k = 0; k < SW_HORIZON; k++) {
        float wanted = 0.0f, *now = prior->rows[SW_PRIOR_MEMORY + k];
        if (k > 0) predict(prior, w, k);
        filter_past(prior, w, k, SW_PRIOR_ROW);
        sw_products(prior->outputs, &prior->weight[0][0], SW_PRIOR_OUTPUTS, prior->inputs, SW_PRIOR_INPUTS);
        for (int u = 0; u < SW_PRIOR_UNITS; u++) wanted += prior->gated[u] * sw_tanh(prior->outputs[u]);
        wanted = sw_min(sw_max(most * sw_tanh(wanted), -work->limit), work->limit);
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
