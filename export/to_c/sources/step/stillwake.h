/* The control step: it takes a window of sensor values and returns a plan for the jets.
 *
 * The code is freestanding C99, without allocation, recursion, library calls or static state. It writes only to the
 * caller's structures, so several controllers may run at the same time. The work of a step does not depend on the data,
 * with two exceptions: a few comparisons in the cost, and the iterations, which are skipped if no cost weight needs
 * them. Compile the sources as C; C++ may include this header. The generated sw_settings.h has the sizes and the hash
 * of the program; the generated sw_weights.c has its parameters. The parameters may also be elsewhere in memory
 * (sw_program.h), for the functions whose names end in _of.
 */
#ifndef STILLWAKE_H
#define STILLWAKE_H

#include <stddef.h>

#include "sw_program.h"
#include "sw_settings.h"
#include "sw_workspace.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Cost terms, in the order of every array of SW_TERMS numbers; sw_settings.h has the indices:
 *
 *     SW_DRAG_MEAN         mean Cd - drag reference
 *     SW_DRAG_FLUCTUATION  max Cd - min Cd
 *     SW_LIFT              mean |Cl|
 *     SW_LIFT_MEAN         (mean Cl)^2
 *     SW_SMOOTHNESS        mean (a[k+1] - a[k])^2
 *     SW_EFFORT            mean a^2
 *     SW_RATE              (a[0] - previous action)^2
 *     SW_PRIOR             mean (a[k] - initial plan of the optimiser)^2
 */

/* The input of a control step. Actions are jet flow rates in U_inf W, pressures are Cp. */
typedef struct {
    float window[SW_WINDOW][SW_COLUMNS]; /* oldest row first; row k: Cp at step k, action commanded at step k - 1 */
    float plan[SW_HORIZON];  /* the unchanged plan from the previous step; this step shifts it by one period */
    float free[SW_HORIZON];  /* 1 if the action of the shifted plan may change, 0 if it is committed */
    float weights[SW_TERMS]; /* weights of the cost terms */
    float speed;             /* the vehicle's speed divided by the design speed */
    float limit;             /* bound on |action| in this step; the program's own bound also applies */
} sw_input;

/* The output of a control step. */
typedef struct {
    float plan[SW_HORIZON];      /* actions from the present period on; command the first action */
    float forces[SW_HORIZON][2]; /* predicted Cd and Cl, 1 to SW_HORIZON steps ahead */
    float terms[SW_TERMS];       /* unweighted cost terms of the plan */
    float cost;                  /* weighted sum of the cost terms */
} sw_output;

typedef enum {
    SW_OK = 0,
    SW_NOT_FINITE = 1,      /* an input or a result is NaN or infinite: do not command the plan */
    SW_WRONG_ARITHMETIC = 2 /* this build or the processor's present mode does not follow IEEE 754; the plan is zeros */
} sw_status;

/* Checks with a known answer whether sums, divisions and small numbers follow IEEE 754. Returns SW_OK or
 * SW_WRONG_ARITHMETIC. Some compiler flags (-ffast-math and its parts) and processor modes (small numbers taken as
 * zero, another rounding) change the arithmetic. Every control step also makes this check.
 */
sw_status sw_arithmetic(void);

/* Resets the input: a window of mean values, a plan of zeros, every action free, the program's cost weights and action
 * limit, and the design speed. Returns the result of sw_arithmetic.
 */
sw_status sw_input_reset(sw_input *input);

/* Appends a row to the window: pressures Cp at the sensors, and the action commanded one step before. */
void sw_input_push(sw_input *input, const float pressures[SW_SENSORS], float previous_action);

/* Runs a control step. The workspace needs no preparation and holds no state between steps. */
sw_status sw_control_step(sw_workspace *work, const sw_input *input, sw_output *output);

/* Computes a window from the program's scaling, runs a control step with all iterations on it, and compares the result
 * with the exporter's answer. Call this function once at start-up. Returns SW_WRONG_ARITHMETIC if result and answer
 * differ in any bit or, in a build that fuses operations, by more than fusing explains. Otherwise, or if the exporter
 * wrote no answer, returns the step's status. Resets `input` as sw_input_reset does.
 */
sw_status sw_known_answer(sw_workspace *work, sw_input *input, sw_output *output);

/* The following three functions accept the parameters of any program whose array sizes equal those of this library. */
sw_status sw_input_reset_of(const sw_program *program, sw_input *input);
sw_status sw_control_step_of(const sw_program *program, sw_workspace *work, const sw_input *input, sw_output *output);
sw_status sw_known_answer_of(const sw_program *program, sw_workspace *work, sw_input *input, sw_output *output);

/* Returns sizeof(sw_workspace), for callers in other languages. */
size_t sw_workspace_bytes(void);

#ifdef __cplusplus
}
#endif

#endif
