/* The terms of the cost, one by one. */
#include "sw_cost.h"
#include "sw_weights.h"

void sw_cost_terms(const sw_workspace *work, float previous_action, float terms[SW_TERMS])
{
    const sw_statistics drag = sw_over_horizon(work->forces[0]), lift = sw_over_horizon(work->forces[1]);
    const float step = work->plan[0] - previous_action;
    float lift_size = 0.0f, effort = 0.0f, steps = 0.0f, distance = 0.0f;
    for (int k = 0; k < SW_HORIZON; k++) {
        lift_size += sw_abs(work->forces[1][k]);
        const float apart = work->plan[k] - work->start[k];
        effort += work->plan[k] * work->plan[k];
        distance += apart * apart;
    }
    for (int k = 0; k + 1 < SW_HORIZON; k++) {
        const float change = work->plan[k + 1] - work->plan[k];
        steps += change * change;
    }
    terms[SW_DRAG_MEAN] = drag.mean - work->program.weights->drag_reference;
    terms[SW_DRAG_FLUCTUATION] = drag.largest - drag.smallest;
    terms[SW_LIFT] = lift_size / (float)SW_HORIZON;
    terms[SW_LIFT_MEAN] = lift.mean * lift.mean;
    terms[SW_SMOOTHNESS] = steps / (float)(SW_HORIZON - 1);
    terms[SW_EFFORT] = effort / (float)SW_HORIZON;
    terms[SW_RATE] = step * step;
    terms[SW_PRIOR] = distance / (float)SW_HORIZON;
}
