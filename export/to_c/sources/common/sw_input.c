/* The input of a control step: its start, and a window that moves on by a row. */
#include "stillwake.h"
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
