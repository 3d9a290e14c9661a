/* The optimiser's initial plan: a feedback on the past and the predicted pressure differences. */
#include "sw_prior.h"

#include "sw_math.h"
#include "sw_weights.h"

#if SW_PRIOR_UNITS > 0

/* The scheduling variables of the units and their gates, in the order of their weights. */
enum { ONE, SLOWER, FASTER, EFFORT, LIFT, LIMIT };

#if SW_SCHEDULED != 6
#error "six weights of a unit on an input are added up here"
#endif

/* Returns the square root of weight / dearest, but at most 1. The prior was trained for weights up to `dearest`. */
static float root_of(float weight, float dearest)
{
    if (weight < dearest) return sw_sqrt(weight / dearest);
    return weight > 0.0f ? 1.0f : 0.0f;
}

/* Computes the scheduling variables from the speed and the goal, as in contract/controller/goal.py. */
static void take_schedule(float schedule[SW_SCHEDULED], const sw_workspace *work, const sw_input *input)
{
    const float *weights = input->weights, share = work->limit / work->program.weights->action_limit;
    schedule[ONE] = 1.0f;
    const float speed = (input->speed - 1.0f) / SW_SPEED_SCALE;
    schedule[SLOWER] = sw_min(speed, 0.0f);
    schedule[FASTER] = sw_max(speed, 0.0f);
    schedule[EFFORT] = root_of(weights[SW_EFFORT], SW_DEAREST_EFFORT * weights[SW_DRAG_MEAN]);
    schedule[LIFT] = root_of(weights[SW_LIFT], SW_DEAREST_LIFT * weights[SW_DRAG_MEAN]);
    schedule[LIMIT] = sw_min(sw_max((1.0f - share) / (1.0f - SW_NARROWEST), 0.0f), 1.0f);
}

/* Returns the index of the variable, SLOWER or FASTER, that is not zero; SLOWER if both are zero. */
static int speed_in(const float schedule[SW_SCHEDULED])
{
    return schedule[FASTER] > 0.0f ? FASTER : SLOWER;
}

/* Computes the weights by which the units multiply their inputs at the present speed and goal. */
static void take_weights(sw_prior_scratch *prior, const sw_weights *w)
{
    const int speed = speed_in(prior->schedule);
    for (int u = 0; u < SW_PRIOR_OUTPUTS; u++) prior->weight[SW_PRIOR_INPUTS][u] = 0.0f;
    for (int u = 0; u < SW_PRIOR_OUTPUTS; u++) {
        float s[SW_SCHEDULED];
        for (int j = 0; j < SW_SCHEDULED; j++) s[j] = prior->schedule[j] * w->prior_first_scale[u][j];
        for (int i = 0; i < SW_PRIOR_INPUTS; i++) {
            const sw_prior_number *of = w->prior_first[u][i];
            const float own = s[ONE] * (float)of[ONE] + s[speed] * (float)of[speed];
            const float prices = s[EFFORT] * (float)of[EFFORT] + s[LIFT] * (float)of[LIFT];
            prior->weight[i][u] = own + prices + s[LIMIT] * (float)of[LIMIT];
        }
    }
}

/* Copies the rows before the present row, and computes the present row's pressure differences. The oldest row is not in
 * the window, so a copy of the second-oldest row replaces it.
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

/* Returns the sum of weights times values; the values are `apart` numbers apart. Adds in two independent sums. */
static float product(const float *weights, const float *values, int apart, int count)
{
    float sum = 0.0f, other = 0.0f;
    for (int i = 1; i < count; i += 2) {
        sum += weights[i - 1] * values[0];
        other += weights[i] * values[apart];
        values += 2 * apart;
    }
    if (count % 2 != 0) sum += weights[count - 1] * values[0];
    return sum + other;
}

/* Filters the first `columns` columns of the past that begins at the row `begin`. */
static void filter_past(sw_prior_scratch *prior, const sw_weights *w, int begin, int columns)
{
    const float *weight = w->prior_filter;
    for (int f = 0; f < SW_PRIOR_FILTERS; f++) {
        const int first = begin + (int)w->prior_filter_rows[f][0], count = (int)w->prior_filter_rows[f][1];
        for (int c = 0; c < columns; c++) {
            prior->inputs[f * columns + c] = product(weight, &prior->rows[first][c], SW_PRIOR_ROW, count);
        }
        weight += count;
    }
}

/* Multiplies the last layer's weights by the gates. The gates depend on the sums of the two Cp of each sensor pair in
 * the newest rows; these sums are written to `rows`.
 */
static void take_gates(sw_prior_scratch *prior, const sw_weights *w, const float window[SW_WINDOW][SW_COLUMNS])
{
    const float(*newest)[SW_COLUMNS] = &window[SW_WINDOW - SW_PRIOR_MEMORY];
    for (int row = 0; row < SW_PRIOR_MEMORY; row++) {
        for (int p = 0; p < SW_PRIOR_ROW - 1; p++) {
            prior->rows[row][p] = newest[row][2 * p] + newest[row][2 * p + 1];
        }
    }
    filter_past(prior, w, 0, SW_PRIOR_ROW - 1);
    const int speed = speed_in(prior->schedule);
    for (int u = 0; u < SW_PRIOR_OUTPUTS; u++) {
        const float *of = w->prior_gate[u], *s = prior->schedule;
        const float gate = of[ONE] * s[ONE] + of[EFFORT] * s[EFFORT] + of[LIMIT] * s[LIMIT]
            + (of[speed] * s[speed] + of[LIFT] * s[LIFT]);
        float by_sums = 0.0f;
        for (int i = 0; i < SW_PRIOR_SUMS; i++) by_sums += (float)w->prior_sums[u][i] * prior->inputs[i];
        prior->gated[u] = w->prior_output[u] * (1.0f + sw_tanh(gate + w->prior_sums_scale[u] * by_sums));
    }
}

/* Computes the products of weights and inputs. Eight units at a time share the loads; each unit has its own sum. */
static void multiply(float *outputs, const float *weights, const float *inputs)
{
    for (int first = 0; first < SW_PRIOR_OUTPUTS; first += 8) {
        float s0 = 0.0f, s1 = 0.0f, s2 = 0.0f, s3 = 0.0f, s4 = 0.0f, s5 = 0.0f, s6 = 0.0f, s7 = 0.0f;
        const float *of = &weights[first];
        float w0 = of[0], w1 = of[1], w2 = of[2], w3 = of[3], w4 = of[4], w5 = of[5], w6 = of[6], w7 = of[7];
        for (int i = 0; i < SW_PRIOR_INPUTS; i++) {
            const float value = inputs[i];
            SW_LOADED(w0, w1, w2, w3);
            SW_LOADED(w4, w5, w6, w7);
            s0 += w0 * value;
            s1 += w1 * value;
            s2 += w2 * value;
            s3 += w3 * value;
            s4 += w4 * value;
            s5 += w5 * value;
            s6 += w6 * value;
            s7 += w7 * value;
            of += SW_PRIOR_OUTPUTS; /* the next weights are loaded while these are multiplied */
            w0 = of[0];
            w1 = of[1];
            w2 = of[2];
            w3 = of[3];
            w4 = of[4];
            w5 = of[5];
            w6 = of[6];
            w7 = of[7];
        }
        outputs[first] = s0;
        outputs[first + 1] = s1;
        outputs[first + 2] = s2;
        outputs[first + 3] = s3;
        outputs[first + 4] = s4;
        outputs[first + 5] = s5;
        outputs[first + 6] = s6;
        outputs[first + 7] = s7;
    }
}

/* Returns the feedback's action divided by the action's bound: from -1 to 1. */
static float wanted(sw_prior_scratch *prior)
{
    float sum = 0.0f, other = 0.0f;
    multiply(prior->outputs, &prior->weight[0][0], prior->inputs);
    for (int u = 0; u < SW_PRIOR_OUTPUTS; u += 2) {
        sum += prior->gated[u] * sw_tanh(prior->outputs[u]);
        other += prior->gated[u + 1] * sw_tanh(prior->outputs[u + 1]);
    }
    return sw_tanh(sum + other);
}

/* Predicts the pressure differences after the past that begins at the row `begin`, in two independent sums. */
static void predict(sw_prior_scratch *prior, const sw_weights *w, int begin)
{
    const float *values = prior->rows[begin];
    for (int p = 0; p < SW_PRIOR_ROW - 1; p++) {
        const float *weights = w->prior_predictor[p];
        float sum = 0.0f, other = 0.0f;
        SW_FOUR_TIMES
        for (int i = 0; i + 1 < SW_PRIOR_PAST; i += 2) {
            sum += weights[i] * values[i];
            other += weights[i + 1] * values[i + 1];
        }
#if SW_PRIOR_PAST % 2 != 0
        sum += weights[SW_PRIOR_PAST - 1] * values[SW_PRIOR_PAST - 1];
#endif
        prior->rows[begin + SW_PRIOR_MEMORY][p] = sum + other;
    }
}

void sw_start_plan(sw_workspace *work, const sw_input *input)
{
    const sw_weights *w = work->program.weights;
    sw_prior_scratch *prior = &work->phase.prior;
    take_schedule(prior->schedule, work, input);
    take_weights(prior, w);
    take_gates(prior, w, input->window);
    take_past(prior, input->window);
    const float most = (1.0f - (1.0f - SW_NARROWEST) * prior->schedule[LIMIT]) * w->action_limit;
    for (int k = 0; k < SW_HORIZON; k++) {
        float *action = &prior->rows[SW_PRIOR_MEMORY + k][SW_PRIOR_ROW - 1];
        if (k > 0) predict(prior, w, k);
        filter_past(prior, w, k, SW_PRIOR_ROW);
        const float free = sw_min(sw_max(most * wanted(prior), -work->limit), work->limit);
        *action = input->free[k] > 0.5f ? free : input->plan[k + 1 < SW_HORIZON ? k + 1 : k];
        work->plan[k] = *action;
    }
}

#else

void sw_start_plan(sw_workspace *work, const sw_input *input)
{
    for (int k = 0; k < SW_HORIZON; k++) work->plan[k] = input->plan[k + 1 < SW_HORIZON ? k + 1 : k];
}

#endif
