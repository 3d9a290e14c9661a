/* The cost J = weights . terms: its terms, and what they and their gradient need of a force over the horizon. */
#ifndef SW_COST_H
#define SW_COST_H

#include "stillwake.h"
#include "sw_math.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    float mean, largest, smallest;
} sw_statistics;

static inline sw_statistics sw_over_horizon(const float *values)
{
    sw_statistics s = {0.0f, values[0], values[0]};
    for (int k = 0; k < SW_HORIZON; k++) {
        s.mean += values[k];
        s.largest = sw_max(s.largest, values[k]);
        s.smallest = sw_min(s.smallest, values[k]);
    }
    s.mean /= (float)SW_HORIZON;
    return s;
}

/* Unweighted cost terms of work->forces and work->plan. */
void sw_cost_terms(const sw_workspace *work, float previous_action, float terms[SW_TERMS]);

#ifdef __cplusplus
}
#endif

#endif
