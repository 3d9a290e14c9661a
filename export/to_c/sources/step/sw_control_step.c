/* A control step: it computes the initial plan, encodes the window, optimises the plan, and predicts the plan's
 * effects. The file also has the functions that reset the input and add a row to its window.
 */
#include "stillwake.h"
#include "sw_cost.h"
#include "sw_math.h"
#include "sw_networks.h"
#include "sw_prior.h"
#include "sw_weights.h"

sw_status sw_input_reset_of(const sw_program *program, sw_input *input)
{
    const sw_weights *w = program->weights;
    for (int row = 0; row < SW_WINDOW; row++) {
        for (int c = 0; c < SW_COLUMNS; c++) input->window[row][c] = w->window_mean[c];
    }
    for (int k = 0; k < SW_HORIZON; k++) {
        input->plan[k] = 0.0f;
        input->free[k] = 1.0f;
    }
    for (int i = 0; i < SW_TERMS; i++) input->weights[i] = w->default_weights[i];
    input->speed = 1.0f;
    input->limit = w->action_limit;
    return sw_arithmetic();
}

void sw_input_push(sw_input *input, const float pressures[SW_SENSORS], float previous_action)
{
    for (int row = 0; row + 1 < SW_WINDOW; row++) {
        for (int c = 0; c < SW_COLUMNS; c++) input->window[row][c] = input->window[row + 1][c];
    }
    for (int s = 0; s < SW_SENSORS; s++) input->window[SW_WINDOW - 1][s] = pressures[s];
    input->window[SW_WINDOW - 1][SW_SENSORS] = previous_action;
}

size_t sw_workspace_bytes(void) { return sizeof(sw_workspace); }

/* Makes a step of projected Adam on the free actions; `iteration` counts from 0. */
static void adam_step(sw_workspace *work, const float free_actions[SW_HORIZON], int iteration)
{
    const sw_weights *w = work->program.weights;
    const float rate = w->adam_rate[iteration], unbias = w->adam_unbias[iteration];
    for (int k = 0; k < SW_HORIZON; k++) {
        const float g = work->gradient[k];
        const float m = SW_ADAM_BETA1 * work->moment1[k] + (1.0f - SW_ADAM_BETA1) * g;
        const float v = SW_ADAM_BETA2 * work->moment2[k] + (1.0f - SW_ADAM_BETA2) * (g * g);
        const float moved = work->plan[k] - (m * rate) / (sw_sqrt(v) * unbias + w->adam_epsilon);
        work->moment1[k] = m;
        work->moment2[k] = v;
        if (free_actions[k] > 0.5f) work->plan[k] = sw_min(sw_max(moved, -work->limit), work->limit);
    }
}

/* Computes the cost weights for the iterations, and returns whether iterations are needed. The prior takes into
 * account the terms for which it was trained (contract/controller/goal.py), so these terms get the weight 0.
 */
static int asked_of_iterations(float asked[SW_TERMS], const float weights[SW_TERMS])
{
    int any = 0;
    for (int i = 0; i < SW_TERMS; i++) asked[i] = weights[i];
#if SW_PRIOR_UNITS > 0
    asked[SW_DRAG_MEAN] = 0.0f;
#if SW_PRIOR_KNOWS_GOAL
    asked[SW_EFFORT] = 0.0f;
    asked[SW_LIFT] = 0.0f;
#endif
    for (int i = 0; i < SW_TERMS; i++) any |= asked[i] > 0.0f || asked[i] < 0.0f;
#else
    any = 1; /* the iterations also clip free actions, which may exceed the limit without a prior */
#endif
    return any;
}

/* Writes an output of zeros, and returns SW_WRONG_ARITHMETIC. */
static sw_status refused(sw_output *output)
{
    for (int k = 0; k < SW_HORIZON; k++) {
        output->plan[k] = 0.0f;
        output->forces[k][0] = 0.0f;
        output->forces[k][1] = 0.0f;
    }
    for (int i = 0; i < SW_TERMS; i++) output->terms[i] = 0.0f;
    output->cost = 0.0f;
    return SW_WRONG_ARITHMETIC;
}

sw_status sw_control_step_of(const sw_program *program, sw_workspace *work, const sw_input *input, sw_output *output)
{
    const float previous_action = input->window[SW_WINDOW - 1][SW_SENSORS];
    if (sw_arithmetic() != SW_OK) return refused(output);
    work->program = *program;
    work->limit = sw_min(input->limit, program->weights->action_limit);
    sw_start_plan(work, input);
    sw_encode(work, input->window);
    for (int k = 0; k < SW_HORIZON; k++) {
        work->start[k] = work->plan[k];
        work->moment1[k] = 0.0f;
        work->moment2[k] = 0.0f;
    }
    float asked[SW_TERMS];
    const int iterations = asked_of_iterations(asked, input->weights) ? SW_ITERATIONS : 0;
    for (int i = 0; i < iterations; i++) {
        sw_roll_out(work);
        sw_decode(work);
        sw_cost_gradient(work, previous_action, asked);
        sw_decode_adjoint(work);
        sw_roll_out_adjoint(work);
        adam_step(work, input->free, i);
    }
    sw_roll_out(work);
    sw_decode(work);
    sw_cost_terms(work, previous_action, output->terms);
    output->cost = 0.0f;
    for (int i = 0; i < SW_TERMS; i++) output->cost += input->weights[i] * output->terms[i];
    for (int k = 0; k < SW_HORIZON; k++) {
        output->plan[k] = work->plan[k];
        output->forces[k][0] = work->forces[0][k];
        output->forces[k][1] = work->forces[1][k];
    }
    /* The inputs must be checked, too, because clipping turns a NaN into a finite action. */
    const int finite = sw_all_finite(&input->window[0][0], SW_WINDOW * SW_COLUMNS) & sw_all_finite(input->plan, SW_HORIZON) &
                       sw_all_finite(input->weights, SW_TERMS) & sw_all_finite(&input->speed, 1) &
                       sw_all_finite(&input->limit, 1) & sw_all_finite(&output->forces[0][0], 2 * SW_HORIZON) &
                       sw_all_finite(output->plan, SW_HORIZON) &
                       sw_all_finite(&output->cost, 1);
    return finite ? SW_OK : SW_NOT_FINITE;
}
