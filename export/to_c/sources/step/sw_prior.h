/* Computes the optimiser's initial plan, work->plan: the prior's plan; without a prior, the shifted previous plan. */
#ifndef SW_PRIOR_H
#define SW_PRIOR_H

#include "stillwake.h"

void sw_start_plan(sw_workspace *work, const sw_input *input);

#endif
