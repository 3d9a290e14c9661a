/* One control step: sensor window in, jet plan out.
 *
 * Freestanding C99. No allocation, no recursion, no library calls, no static state: everything that is written stands
 * in the caller's structures, so that several controllers may run side by side. But for a few comparisons in the cost,
 * and for the iterations, which are left out where no weight asks for any, the work of a step does not depend on the data.
 * Compile the sources as C; C++ may include this header. sw_settings.h, generated, has the sizes and the hash of the
 * program, and sw_weights.c its numbers. They need not be compiled in: with the functions that end in _of they may stand
 * anywhere in memory (sw_program.h).
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
 *     SW_PRIOR             mean (a[k] - where the optimiser started)^2
 */

/* What a control step needs to know. Actions are jet flow rates in U_inf W, pressures are Cp. */
typedef struct {
    float window[SW_WINDOW][SW_COLUMNS]; /* oldest row first; row k is Cp at step k and the action commanded at k - 1 */
    float plan[SW_HORIZON];              /* the previous step's plan as it came out; it is shifted by one step here */
    float free[SW_HORIZON];              /* 1 where the shifted plan may be changed, 0 where it is committed */
    float weights[SW_TERMS];             /* of the cost terms */
    float speed;                         /* the vehicle's, as a ratio to the design speed */
    float limit;                         /* bound on the actions, whatever the speed; the program's own is never exceeded */
} sw_input;

/* Its answer. */
typedef struct {
    float plan[SW_HORIZON];      /* actions from now on; the first one is to be commanded */
    float forces[SW_HORIZON][2]; /* predicted Cd and Cl, one to SW_HORIZON steps ahead */
    float terms[SW_TERMS];       /* unweighted cost terms of the plan */
    float cost;                  /* weights . terms */
} sw_output;

typedef enum {
    SW_OK = 0,
    SW_NOT_FINITE = 1,      /* an input or a result is not a finite number: do not command the plan */
    SW_WRONG_ARITHMETIC = 2 /* this build, or the processor as it is set now, computes otherwise; the plan is zeros */
} sw_status;

/* SW_OK, or SW_WRONG_ARITHMETIC: by a known answer whether sums, divisions, and small numbers are as IEEE 754 has them. Some
 * flags of a compiler change that (-ffast-math and its parts), and so do modes of a processor (small numbers as zero,
 * rounding). Every control step looks by itself.
 */
sw_status sw_arithmetic(void);

/* Start: an empty window, no plan, every action free, the program's cost weights and action limit, the design speed.
 * Answers as sw_arithmetic.
 */
sw_status sw_input_reset(sw_input *input);

/* Move the window on by one row: pressures Cp at the sensors, and the action commanded one step before. */
void sw_input_push(sw_input *input, const float pressures[SW_SENSORS], float previous_action);

/* One control step. The workspace needs no preparation and carries nothing from step to step. */
sw_status sw_control_step(sw_workspace *work, const sw_input *input, sw_output *output);

/* Once, at the start: a control step with all iterations on a window of the program's own, against the answer that the
 * exporter wrote beside its numbers. SW_WRONG_ARITHMETIC if it is another: to the bit, and where this build fuses
 * operations within what that changes. SW_OK as well where no answer was written. Leaves `input` as sw_input_reset.
 */
sw_status sw_known_answer(sw_workspace *work, sw_input *input, sw_output *output);

/* The same three with the numbers of any program that this library has the sizes of. */
sw_status sw_input_reset_of(const sw_program *program, sw_input *input);
sw_status sw_control_step_of(const sw_program *program, sw_workspace *work, const sw_input *input, sw_output *output);
sw_status sw_known_answer_of(const sw_program *program, sw_workspace *work, sw_input *input, sw_output *output);

/* sizeof(sw_workspace), for callers in other languages. */
size_t sw_workspace_bytes(void);

#ifdef __cplusplus
}
#endif

#endif
