/* The table of states: any inputs from any state, and the way out of a latched fault as a model of its own. */
#include "prove.h"

#include "sw_fail_safe.c"
#include "sw_timing.c"

/* Periods behind a fault, in which the jets could start at the earliest: those that re-arm, and one with a low request. */
#define PERIODS (SW_REARM_FRAMES + 3)
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

/* The protocol: a fault of the ECU's own, then any periods. The jets come on only after frames that were good in a row
 * since the fault, and after a request that was seen low since. `seen_low` and `good` are counted here, not there.
 */
void after_a_fault(void)
{
    sw_fail_safe fail_safe;
    sw_period_inputs inputs;
    ASSUME(fail_safe.mode <= SW_UPDATE && fail_safe.enable_request <= 1u);
    ASSUME(any_inputs(&inputs) && inputs.fault != SW_REASON_NONE);
    sw_fail_safe_next(&fail_safe, &inputs);
    int seen_low = inputs.has_request && !inputs.enable_request && fail_safe.enable_request == 0u;
    uint32_t good = inputs.usable ? 1u : 0u;
    for (int k = 0; k < PERIODS; k++) {
        sw_period_inputs next;
        ASSUME(any_inputs(&next) && next.fault == SW_REASON_NONE);
        sw_fail_safe_next(&fail_safe, &next);
        good = next.usable ? good + 1u : 0u;
        if (sw_drives_jets(fail_safe.mode)) {
            PROVE(seen_low && good >= SW_REARM_FRAMES && next.usable && next.enable_request);
            return;
        }
        if (fail_safe.mode == SW_WARMUP) return; /* re-armed by the same row; any_period has what follows */
        if (next.has_request && !next.enable_request) seen_low = 1;
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
