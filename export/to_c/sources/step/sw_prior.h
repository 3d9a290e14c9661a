/* The plan that the optimiser starts from, work->plan: the prior's, or without a prior the shifted previous one. */
#ifndef SW_PRIOR_H
#define SW_PRIOR_H

#include "stillwake.h"

void sw_start_plan(sw_workspace *work, const sw_input *input);

#endif
