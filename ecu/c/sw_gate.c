/* The command gate: the last check before a jet command is sent. It does not trust the controller.
 *
 * The gate shuts the jets immediately in four cases, which it checks in this order: permission is missing, the command
 * is not a finite number, the clock has not advanced, or fresh pressures are missing. Otherwise the command is limited
 * to its range, and the change from the previous command is limited to one step. Zero is the safe state, so the step
 * limit never slows down a shut-off. This file corresponds to can_bridge/command_gate.py.
 */
#include <float.h>

#include "sw_ecu_parts.h"

/* Return the smaller or the larger number as Python does: the first number if both are equal or one is NaN. */
static double smaller(double a, double b) { return b < a ? b : a; }
static double larger(double a, double b) { return b > a ? b : a; }

static double clamp(double value, double low, double high) { return smaller(larger(value, low), high); }

static int is_finite(double value) { return value >= -DBL_MAX && value <= DBL_MAX; }

/* Returns the time between two times, without overflow. `to_ns` must not be earlier than `from_ns`. */
static uint64_t elapsed_ns(int64_t from_ns, int64_t to_ns) { return (uint64_t)to_ns - (uint64_t)from_ns; }

static sw_gated shut(uint8_t why)
{
    const sw_gated gated = {0.0, 0, why};
    return gated;
}

/* Returns the largest permitted change of the command: proportional to the time passed, at most one period. */
static double largest_change(double step_m2_per_s, int has_previous, int64_t previous_ns, int64_t now_ns)
{
    double share = 1.0;
    if (has_previous) {
        const uint64_t elapsed = elapsed_ns(previous_ns, now_ns);
        if (elapsed < (uint64_t)SW_PERIOD_NS) share = (double)elapsed / (double)SW_PERIOD_NS;
    }
    return step_m2_per_s * share;
}

/* Returns whether pressures are fresh enough. A command between zero and the last command permits older pressures. */
static int is_fresh(double flow_m2_per_s, double previous_m2_per_s, int64_t pressure_ns, int64_t now_ns)
{
    const int towards_zero = smaller(0.0, previous_m2_per_s) <= flow_m2_per_s &&
                             flow_m2_per_s <= larger(0.0, previous_m2_per_s);
    const int64_t oldest_ns = towards_zero ? SW_HELD_AGE_NS : SW_FRESH_AGE_NS;
    /* A pressure with a future time counts as stale: one of the two clocks must be wrong. */
    return pressure_ns <= now_ns && elapsed_ns(pressure_ns, now_ns) <= (uint64_t)oldest_ns;
}

sw_gated sw_gate(double flow_m2_per_s, int enable, double previous_m2_per_s, int has_previous, int64_t previous_ns,
                 int has_pressures, int64_t pressure_ns, int64_t now_ns, const sw_gate_limits *limits)
{
    const double range = limits->flow_m2_per_s;
    if (!enable) return shut(SW_GATED_NOT_ENABLED);
    if (!is_finite(flow_m2_per_s)) return shut(SW_GATED_NOT_FINITE);
    if (has_previous && now_ns <= previous_ns) return shut(SW_GATED_CLOCK);
    if (!has_pressures || !is_fresh(flow_m2_per_s, previous_m2_per_s, pressure_ns, now_ns)) {
        return shut(SW_GATED_STALE);
    }
    const double in_range = clamp(flow_m2_per_s, -range, range);
    const double step = largest_change(limits->step_m2_per_s, has_previous, previous_ns, now_ns);
    sw_gated gated = {clamp(in_range, previous_m2_per_s - step, previous_m2_per_s + step), 1, 0};
    if (in_range != flow_m2_per_s) gated.interventions = SW_GATED_RANGE;
    if (gated.flow_m2_per_s != in_range) {
        gated.interventions = (uint8_t)(gated.interventions | SW_GATED_RATE);
        /* The range is applied last, since the previous command may be outside it. */
        gated.flow_m2_per_s = clamp(gated.flow_m2_per_s, -range, range);
    }
    return gated;
}
