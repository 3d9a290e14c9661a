/* The cost's terms and gradient. Steps with equal extreme Cd share the derivative. The derivative of |Cl| at 0 is 0. */
#include "sw_cost.h"

#include "sw_math.h"
#include "sw_weights.h"

/* The statistics of a force over the horizon. */
typedef struct {
    float mean, largest, smallest;
} statistics;

static statistics over_horizon(const float *values)
{
    statistics s = {0.0f, values[0], values[0]};
    for (int k = 0; k < SW_HORIZON; k++) {
        s.mean += values[k];
        s.largest = sw_max(s.largest, values[k]);
        s.smallest = sw_min(s.smallest, values[k]);
    }
    s.mean /= (float)SW_HORIZON;
    return s;
}

void sw_cost_terms(const sw_workspace *work, float previous_action, float terms[SW_TERMS])
{
    const statistics drag = over_horizon(work->forces[0]), lift = over_horizon(work->forces[1]);
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

static float share_of(float weight, const float *values, float extreme)
{
    int ties = 0;
    for (int k = 0; k < SW_HORIZON; k++) ties += values[k] == extreme;
    return ties > 0 ? weight / (float)ties : 0.0f;
}

void sw_cost_gradient(sw_workspace *work, float previous_action, const float weights[SW_TERMS])
{
    const float *cd = work->forces[0], *cl = work->forces[1], *plan = work->plan;
    const statistics drag = over_horizon(cd), lift = over_horizon(cl);
    const float at_largest = share_of(weights[SW_DRAG_FLUCTUATION], cd, drag.largest);
    const float at_smallest = share_of(weights[SW_DRAG_FLUCTUATION], cd, drag.smallest);
    const float per_lift = weights[SW_LIFT] / (float)SW_HORIZON;
    const float by_mean_lift = weights[SW_LIFT_MEAN] * 2.0f * lift.mean / (float)SW_HORIZON;
    const float per_action = weights[SW_EFFORT] * 2.0f / (float)SW_HORIZON;
    const float per_distance = weights[SW_PRIOR] * 2.0f / (float)SW_HORIZON;
    const float per_step = weights[SW_SMOOTHNESS] * 2.0f / (float)(SW_HORIZON - 1);
    for (int k = 0; k < SW_HORIZON; k++) {
        float d_drag = weights[SW_DRAG_MEAN] / (float)SW_HORIZON, d_lift = by_mean_lift;
        if (cd[k] == drag.largest) d_drag += at_largest;
        if (cd[k] == drag.smallest) d_drag -= at_smallest;
        if (cl[k] > 0.0f) d_lift += per_lift;
        if (cl[k] < 0.0f) d_lift -= per_lift;
        work->d_forces[0][k] = d_drag;
        work->d_forces[1][k] = d_lift;
        work->gradient[k] = per_action * plan[k] + per_distance * (plan[k] - work->start[k]);
        if (k > 0) work->gradient[k] += per_step * (plan[k] - plan[k - 1]);
        if (k + 1 < SW_HORIZON) work->gradient[k] -= per_step * (plan[k + 1] - plan[k]);
    }
    work->gradient[0] += weights[SW_RATE] * 2.0f * (plan[0] - previous_action);
    for (int k = SW_HORIZON; k < SW_HORIZON_P; k++) {
        work->d_forces[0][k] = 0.0f;
        work->d_forces[1][k] = 0.0f;
    }
}
