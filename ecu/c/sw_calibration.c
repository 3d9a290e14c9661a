/* The calibration: the values of a release that may be changed between two control periods, their limits, and the
 * command gate's bounds that follow from the values. This file corresponds to ecu/calibrating.py.
 */
#include "sw_ecu_parts.h"

static const sw_calibration greatest = SW_GREATEST_CALIBRATION;

/* Returns whether the value is within the limits; NaN is within no limits. */
static int is_within(float value, float low, float high) { return value >= low && value <= high; }

void sw_calibration_bounds(const float weights[SW_TERMS], sw_calibration *low, sw_calibration *high)
{
    static const sw_calibration least = SW_LEAST_CALIBRATION;
    *low = least;
    *high = greatest;
    for (int i = 0; i < SW_TERMS; i++) {
        /* The limit rises to the release's own weight if this weight is greater. */
        if (weights[i] > high->weights[i]) high->weights[i] = weights[i];
    }
}

int sw_calibration_beyond(const sw_calibration *values, const sw_release *release)
{
    sw_calibration low, high;
    sw_calibration_bounds(release->weights, &low, &high);
    for (int i = 0; i < SW_TERMS; i++) {
        if (!is_within(values->weights[i], low.weights[i], high.weights[i])) return i + 1;
    }
    if (!is_within(values->action_limit, low.action_limit, high.action_limit)) return SW_TERMS + 1;
    if (!is_within(values->command_step, low.command_step, high.command_step)) return SW_TERMS + 2;
    return values->delay_steps <= high.delay_steps ? 0 : SW_TERMS + 3;
}

void sw_calibration_own(const sw_release *release, sw_calibration *own)
{
    *own = greatest; /* the jets' limits come from the vehicle, not from the release */
    for (int i = 0; i < SW_TERMS; i++) own->weights[i] = release->weights[i];
    own->delay_steps = SW_DELAY_STEPS;
}

sw_gate_limits sw_calibration_limits(const sw_calibration *values)
{
    sw_gate_limits limits = {SW_GATE_FLOW, SW_GATE_STEP}; /* the vehicle's bounds, as doubles */
    if (values->action_limit < greatest.action_limit) {
        /* Rounds the range down to a multiple of the resolution. 1e-6 exceeds the rounding error of a multiple. */
        const double steps = (double)values->action_limit * SW_FLOW_SCALE / SW_FLOW_RESOLUTION + 1e-6;
        limits.flow_m2_per_s = (double)(int32_t)steps * SW_FLOW_RESOLUTION;
    }
    if (values->command_step < greatest.command_step) {
        limits.step_m2_per_s = (double)values->command_step * SW_FLOW_SCALE;
    }
    return limits;
}
