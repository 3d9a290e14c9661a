/* The table of states: any inputs from any state, and the way out of a latched fault, by induction. */
#include "prove.h"

#include "sw_fail_safe.c"
#include "sw_timing.c"

#define LONGEST_NS ((int64_t)1 << 34) /* between two steps: the solver does not divide longer ones */

static int any_inputs(sw_period_inputs *inputs)
{
    return inputs->usable <= 1u && inputs->has_request <= 1u && inputs->enable_request <= 1u &&
           (!inputs->usable || (inputs->has_request && inputs->unusable_because == SW_REASON_NONE));
}

/* From any state, also one that no ECU can be in. */
void any_period(void)
{
    sw_fail_safe fail_safe;
    sw_period_inputs inputs;
    ASSUME(fail_safe.mode <= SW_UPDATE);
    const sw_fail_safe before = fail_safe;
    sw_fail_safe_next(&fail_safe, &inputs);
    PROVE(fail_safe.mode <= SW_UPDATE);
    (void)sw_mode_on_wire(fail_safe.mode);
    const int drives = sw_drives_jets(fail_safe.mode);
    if (before.mode == SW_UPDATE) PROVE(fail_safe.mode == SW_UPDATE); /* a reset alone leads out */
    if (inputs.fault != SW_REASON_NONE) PROVE(!drives);
    if (fail_safe.mode == SW_CONTROL) PROVE(inputs.usable && inputs.window_full && !inputs.off_speed && !inputs.tests);
    if (fail_safe.misses > SW_HOLD_PERIODS + SW_DECAY_PERIODS) PROVE(!drives);
    if (drives) PROVE(fail_safe.enable_request);
    /* Out of a fault lead good frames and a request that was low and rises now. */
    if (before.mode == SW_FAULT && fail_safe.mode != SW_FAULT && fail_safe.mode != SW_UPDATE) {
        PROVE(inputs.usable && inputs.fault == SW_REASON_NONE);
        PROVE(!before.enable_request && fail_safe.enable_request);
        PROVE(fail_safe.good >= SW_REARM_FRAMES);
    }
    if (drives && !sw_drives_jets(before.mode) && before.mode != SW_WARMUP) {
        PROVE(!before.enable_request || before.mode == SW_ARMED);
    }
}

void any_latch(void)
{
    sw_fail_safe fail_safe;
    const uint8_t reason = nondet_uchar();
    ASSUME(fail_safe.mode <= SW_UPDATE && reason != SW_REASON_NONE);
    sw_fail_safe_latch(&fail_safe, reason);
    PROVE(!sw_drives_jets(fail_safe.mode));
    PROVE(fail_safe.mode == SW_FAULT || fail_safe.mode == SW_UPDATE);
    PROVE(fail_safe.good == 0u);
}

/* The protocol, for any number of periods: what was counted from a fault on, here and not there, and how far the
 * fail-safe may count itself. It holds when a fault is entered, stays through each period, and leads out by a request that
 * was seen low, at the fault or later, and by frames that were good in a row since the ECU's latest own fault.
 */
typedef struct {
    int seen_low;
    uint32_t good; /* SW_REARM_FRAMES at most */
} witness;

static uint32_t at_most_rearm(uint32_t count) { return count < SW_REARM_FRAMES ? count : SW_REARM_FRAMES; }

static int is_latched(const sw_fail_safe *fail_safe, const witness *seen)
{
    return (fail_safe->mode == SW_FAULT || fail_safe->mode == SW_UPDATE) && seen->good <= SW_REARM_FRAMES &&
           fail_safe->enable_request <= 1u && (fail_safe->enable_request || seen->seen_low) && at_most_rearm(fail_safe->good) <= seen->good;
}

void into_a_fault(void)
{
    sw_fail_safe fail_safe;
    sw_period_inputs inputs;
    ASSUME(fail_safe.mode < SW_FAULT && fail_safe.enable_request <= 1u && any_inputs(&inputs));
    const int was_low = !fail_safe.enable_request;
    if (nondet_int()) {
        sw_fail_safe_next(&fail_safe, &inputs);
        const witness seen = {inputs.has_request && !inputs.enable_request, inputs.usable};
        if (inputs.fault != SW_REASON_NONE) PROVE(fail_safe.mode == SW_FAULT || fail_safe.mode == SW_UPDATE);
        if (fail_safe.mode == SW_FAULT) PROVE(is_latched(&fail_safe, &seen));
    } else {
        const witness seen = {was_low, 0};
        ASSUME(inputs.fault != SW_REASON_NONE);
        sw_fail_safe_latch(&fail_safe, inputs.fault);
        PROVE(is_latched(&fail_safe, &seen));
    }
}

void out_of_a_fault(void)
{
    sw_fail_safe fail_safe;
    sw_period_inputs inputs;
    witness seen;
    ASSUME(is_latched(&fail_safe, &seen) && any_inputs(&inputs));
    const int had_seen_low = seen.seen_low;
    sw_fail_safe_next(&fail_safe, &inputs);
    if (!inputs.usable) {
        seen.good = 0;
    } else if (inputs.fault != SW_REASON_NONE) {
        seen.good = 1;
    } else {
        seen.good = at_most_rearm(seen.good + 1u);
    }
    if (inputs.has_request && !inputs.enable_request) seen.seen_low = 1;
    if (fail_safe.mode != SW_FAULT && fail_safe.mode != SW_UPDATE) {
        PROVE(had_seen_low && seen.good >= SW_REARM_FRAMES && inputs.fault == SW_REASON_NONE);
        PROVE(inputs.usable && inputs.has_request && inputs.enable_request);
    } else {
        PROVE(is_latched(&fail_safe, &seen));
    }
}

/* The steps' times: no clock, however wrong, leads out of a number's range. */
void any_clock(void)
{
    sw_timing timing;
    const int64_t now_ns = nondet_long();
    ASSUME(timing.step_ns >= -1 && timing.step_ns <= SW_LATEST_NS);
    ASSUME(timing.lag_ns >= -SW_PERIOD_NS && timing.lag_ns <= SW_PERIOD_NS);
    ASSUME(now_ns <= timing.step_ns || now_ns > SW_LATEST_NS || now_ns - timing.step_ns < LONGEST_NS);
    sw_timing_next(&timing, now_ns);
    PROVE(timing.step_ns >= -1 && timing.step_ns <= SW_LATEST_NS);
    PROVE(timing.lag_ns >= -SW_PERIOD_NS && timing.lag_ns <= SW_PERIOD_NS);
    PROVE(timing.skipped >= 0);
    if (now_ns < 0 || now_ns > SW_LATEST_NS) PROVE(timing.fault == SW_REASON_CLOCK);
}
