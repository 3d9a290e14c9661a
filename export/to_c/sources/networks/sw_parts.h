/* The parts of a control step with networks, in the order they run; each file implements one. The terms of the cost are
 * in sw_cost.h.
 */
#ifndef SW_PARTS_H
#define SW_PARTS_H

#include "stillwake.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Where the optimiser starts, work->plan: the prior's plan, or without a prior the shifted previous one. */
void sw_start_plan(sw_workspace *work, const sw_input *input);

/* Latent state, work->z, from a window. */
void sw_encode(sw_workspace *work, const float window[SW_WINDOW][SW_COLUMNS]);

/* Latent states, work->latents, under work->plan from work->z; leaves the tape. */
void sw_roll_out(sw_workspace *work);

/* work->forces from work->latents; leaves the tape. */
void sw_decode(sw_workspace *work);

/* dJ/dforces, work->d_forces, and dJ/da with the forces held fixed, work->gradient. */
void sw_cost_gradient(sw_workspace *work, float previous_action, const float weights[SW_TERMS]);

/* dJ/dz through the forces alone, work->d_latents, from work->d_forces. */
void sw_decode_adjoint(sw_workspace *work);

/* Adds to work->gradient what an action does through the latent states. */
void sw_roll_out_adjoint(sw_workspace *work);

/* Projected Adam on the actions that are free; `iteration` counts from 0. */
void sw_adam_step(sw_workspace *work, const float free_actions[SW_HORIZON], int iteration);

#ifdef __cplusplus
}
#endif

#endif
