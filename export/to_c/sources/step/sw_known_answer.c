/* The known answer of a whole control step. Correct sums and divisions (sw_arithmetic.h) do not prove that a network is
 * correct: a compiler may translate a product wrongly, a linker may omit parameters, and memory may fail with age.
 */
#include "stillwake.h"
#include "sw_arithmetic.h"
#include "sw_weights.h"

/* Fused operations may change an answer by FUSED (as in replay.c) plus FUSED times its magnitude. */
#define FUSED 5e-3f

/* Computes a window from the program's scaling, so that no stored data are needed. Each value is the column's mean plus
 * i * 3/8 standard deviations, with an integer i from -5 to 5 that depends on row and column. All weights are 1, so
 * that the iterations run.
 */
static void ask(const sw_program *program, sw_input *input)
{
    const sw_weights *w = program->weights;
    for (int row = 0; row < SW_WINDOW; row++) {
        for (int c = 0; c < SW_COLUMNS; c++) {
            input->window[row][c] = w->window_mean[c] + 0.375f * (float)((7 * row + 3 * c) % 11 - 5) / w->window_factor[c];
        }
    }
    for (int i = 0; i < SW_TERMS; i++) input->weights[i] = 1.0f;
}

static int is_known(float found, float expected, int fused)
{
    const float allowed = FUSED * (1.0f + sw_abs(expected));
    return fused ? sw_abs(found - expected) <= allowed : sw_other(found, sw_to_bits(expected)) == 0u;
}

sw_status sw_known_answer_of(const sw_program *program, sw_workspace *work, sw_input *input, sw_output *output)
{
    const float *expected = program->weights->known_answer;
    const int fused = sw_float_fused();
    sw_status status = sw_input_reset_of(program, input);
    if (status != SW_OK) return status;
    ask(program, input);
    status = sw_control_step_of(program, work, input, output);
    if (status == SW_OK && (expected[0] != 0.0f || expected[1] != 0.0f) &&
        !(is_known(output->plan[0], expected[0], fused) && is_known(output->cost, expected[1], fused))) {
        status = SW_WRONG_ARITHMETIC;
    }
    (void)sw_input_reset_of(program, input);
    return status;
}
