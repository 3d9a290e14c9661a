/* The command gate: whatever the controller asks for, and whatever the clocks show. */
#include "prove.h"

#include "sw_gate.c"

/* Limits as sw_calibration.c makes them (calibration.c proves it), and a command before that was within the range. */
void any_command(void)
{
    sw_gate_limits limits;
    const double flow = nondet_double(), before = nondet_double();
    const int enable = nondet_int(), has_previous = nondet_int(), has_pressures = nondet_int();
    const int64_t previous_ns = nondet_long(), pressure_ns = nondet_long(), now_ns = nondet_long();
    ASSUME(limits.flow_m2_per_s >= 0.0 && limits.flow_m2_per_s <= SW_GATE_FLOW);
    ASSUME(limits.step_m2_per_s >= 0.0 && limits.step_m2_per_s <= SW_GATE_STEP);
    ASSUME(before >= -SW_GATE_FLOW && before <= SW_GATE_FLOW);
    const double range = limits.flow_m2_per_s;
    const sw_gated passed =
        sw_gate(flow, enable, before, has_previous, previous_ns, has_pressures, pressure_ns, now_ns, &limits);
    PROVE(passed.flow_m2_per_s >= -range && passed.flow_m2_per_s <= range);
    if (passed.flow_m2_per_s != 0.0) {
        PROVE(enable && passed.enable && has_pressures);
        PROVE(flow >= -DBL_MAX && flow <= DBL_MAX);
        PROVE(pressure_ns <= now_ns && (uint64_t)now_ns - (uint64_t)pressure_ns <= (uint64_t)SW_HELD_AGE_NS);
        PROVE(!has_previous || now_ns > previous_ns);
    }
}

/* A sum of doubles of which one is not negative lies on its side of the other one; largest_step needs no more of sums. */
void any_sum(void)
{
    const double before = nondet_double(), step = nondet_double();
    ASSUME(before >= -SW_GATE_FLOW && before <= SW_GATE_FLOW && step >= 0.0 && step <= SW_GATE_STEP);
    PROVE(before - step <= before && before + step >= before);
}

/* No further from the command before it, if that was in the range, than one step: a period or more after it, or first. */
void largest_step(void)
{
    sw_gate_limits limits;
    const double flow = nondet_double(), before = nondet_double();
    const int64_t pressure_ns = nondet_long(), now_ns = nondet_long();
    const double range = limits.flow_m2_per_s, step = limits.step_m2_per_s;
    ASSUME(range >= 0.0 && range <= SW_GATE_FLOW && step >= 0.0 && step <= SW_GATE_STEP);
    ASSUME(before >= -range && before <= range);
    const double change = largest_change(step, 0, 0, now_ns);
    ASSUME(before - change <= before && before + change >= before); /* any_sum */
    const sw_gated passed = sw_gate(flow, 1, before, 0, 0, 1, pressure_ns, now_ns, &limits);
    if (passed.enable) PROVE(passed.flow_m2_per_s <= before + change && passed.flow_m2_per_s >= before - change);
}

/* Whatever the time, the change is no greater than the vehicle's step. */
void shorter_time(void)
{
    const double change = largest_change(SW_GATE_STEP, nondet_int(), nondet_long(), nondet_long());
    PROVE(change >= 0.0 && change <= SW_GATE_STEP);
}

/* Too old for a new command: none that leads away from zero. */
void old_pressures(void)
{
    const sw_gate_limits limits = {SW_GATE_FLOW, SW_GATE_STEP};
    const double flow = nondet_double(), before = nondet_double();
    const int64_t pressure_ns = nondet_long(), now_ns = nondet_long();
    ASSUME(before >= -SW_GATE_FLOW && before <= SW_GATE_FLOW);
    ASSUME(pressure_ns >= 0 && now_ns >= 0 && now_ns <= ((int64_t)1 << 61) && now_ns - pressure_ns > SW_FRESH_AGE_NS);
    const sw_gated passed = sw_gate(flow, 1, before, 0, 0, 1, pressure_ns, now_ns, &limits);
    if (before >= 0.0) PROVE(passed.flow_m2_per_s >= 0.0 && passed.flow_m2_per_s <= before);
    if (before <= 0.0) PROVE(passed.flow_m2_per_s <= 0.0 && passed.flow_m2_per_s >= before);
}
