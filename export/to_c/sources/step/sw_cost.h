/* The cost J = weights . terms: its terms, and its gradient. */
#ifndef SW_COST_H
#define SW_COST_H

#include "stillwake.h"

/* Computes the unweighted cost terms of work->forces and work->plan. */
void sw_cost_terms(const sw_workspace *work, float previous_action, float terms[SW_TERMS]);

/* Writes dJ/dforces to work->d_forces. Writes dJ/da, with fixed forces, to work->gradient; a is the plan. */
void sw_cost_gradient(sw_workspace *work, float previous_action, const float weights[SW_TERMS]);

#endif
