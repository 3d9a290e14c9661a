/* The networks of a control step, in the order they run; each precision has them in files of their own. */
#ifndef SW_NETWORKS_H
#define SW_NETWORKS_H

#include "sw_program.h"

struct sw_workspace;

/* Latent state, work->z, from a window. */
void sw_encode(struct sw_workspace *work, const float window[SW_WINDOW][SW_COLUMNS]);

/* Latent states, work->latents, under work->plan from work->z; leaves the tape. */
void sw_roll_out(struct sw_workspace *work);

/* work->forces from work->latents; leaves the tape. */
void sw_decode(struct sw_workspace *work);

/* dJ/dz through the forces alone, work->d_latents, from work->d_forces. */
void sw_decode_adjoint(struct sw_workspace *work);

/* Adds to work->gradient what an action does through the latent states. */
void sw_roll_out_adjoint(struct sw_workspace *work);

#endif
