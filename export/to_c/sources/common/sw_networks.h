/* The networks of a control step, in the order of execution; each precision has its own files. */
#ifndef SW_NETWORKS_H
#define SW_NETWORKS_H

#include "sw_program.h"

struct sw_workspace;

/* Computes the latent state, work->z, from a window. */
void sw_encode(struct sw_workspace *work, const float window[SW_WINDOW][SW_COLUMNS]);

/* Computes work->latents, the states that follow work->z under work->plan. Stores the data for the adjoint. */
void sw_roll_out(struct sw_workspace *work);

/* Computes work->forces from work->latents. Stores the data for the adjoint. */
void sw_decode(struct sw_workspace *work);

/* Computes work->d_latents from work->d_forces: dJ/d(latent states), through the forces alone. */
void sw_decode_adjoint(struct sw_workspace *work);

/* Adds to work->gradient the part of dJ/da that acts through the latent states. */
void sw_roll_out_adjoint(struct sw_workspace *work);

#endif
