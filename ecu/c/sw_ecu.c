/* The ECU's control period: it checks the stream of pressures, updates the fail-safe, extends the window, plans, passes
 * an action through the command gate, and writes the frames to send. This file corresponds to ecu/ecu.py.
 */
#include "sw_ecu.h"

#include <float.h>

#include "sw_counts.h"
#include "sw_ecu_parts.h"

/* The largest number of consecutive periods without pressures that the window bridges and in which jets may run. */
#define LONGEST_GAP (SW_HOLD_PERIODS + SW_DECAY_PERIODS)

/* The action that the ECU requests from the command gate in one period. */
typedef struct {
    double action; /* action before the gate, in U_inf W */
    uint8_t fault; /* reason why active control has no action, or SW_REASON_NONE */
} decision;

static double newest(const sw_memory *memory) { return memory->under_way[memory->frozen]; }

static double present_speed(const sw_ecu_state *state, const sw_release *release)
{
#if SW_PAST > 0
    return sw_speed_present(&state->speed, release);
#else
    (void)state;
    (void)release;
    return 1.0;
#endif
}

/* Adds this period's row to the window, or empties the window at a speed outside the release's range. */
static void with_row(sw_ecu_state *state, const sw_release *release, const double *cp)
{
    sw_memory *memory = &state->memory;
#if SW_PAST > 0
    if (state->speed.is_off) {
        sw_memory_emptied(memory);
        return;
    }
#endif
    if (cp != NULL) {
        sw_memory_observed(memory, cp, present_speed(state, release));
    } else {
        sw_memory_bridged(memory);
    }
}

/* Adds one row for each skipped period, in which the last command was in force. A clock fault empties the window. */
static void after_silence(sw_memory *memory, const sw_timing *timing)
{
    if (timing->fault == SW_REASON_CLOCK) {
        sw_memory_emptied(memory);
        return;
    }
    /* After this many rows the window is empty, and all actions in transit equal the last command. */
    const int most = LONGEST_GAP > (int)memory->frozen ? LONGEST_GAP : (int)memory->frozen;
    for (int k = 0; k <= most && k < timing->skipped; k++) {
        sw_memory_bridged(memory);
        sw_memory_commanded(memory, newest(memory));
    }
}

/* Runs the sensor check; replaces an excluded sensor's pressures by estimates. Returns the reason for a shut-off. */
static uint8_t check_sensors(sw_ecu *ecu, const double *cp, const double *reading)
{
    uint8_t fault = SW_REASON_NONE;
#if SW_SENSOR_CHECK
    const sw_sensors *sensors = &ecu->state.sensors;
    fault = sw_sensors_next(&ecu->state.sensors, &ecu->numbers, &ecu->work.estimator, &ecu->state.memory, cp, reading,
                            ecu->state.timing.skipped);
    if (sensors->set_aside >= 0) {
        sw_memory_with_column(&ecu->state.memory, sensors->set_aside, sensors->estimates);
    }
#else
    (void)ecu;
    (void)cp;
    (void)reading;
#endif
    return fault;
}

/* Runs the benefit check; uses estimates for an excluded sensor. Returns the SW_REASON_ for a shut-off. */
static uint8_t check_benefit(sw_ecu_state *state, const sw_release *release, int usable)
{
    uint8_t fault = SW_REASON_NONE;
#if SW_BENEFIT_CHECK
    const double *cp = usable ? state->memory.window[SW_WINDOW - 1] : NULL;
    const double speed = present_speed(state, release);
    fault = sw_benefit_next(&state->benefit, release, cp, speed, sw_drives_jets(state->fail_safe.mode));
#else
    (void)state;
    (void)release;
    (void)usable;
#endif
    return fault;
}

/* Updates the estimate of the air speed; the next period's speed depends on it. */
static void estimate_air_speed(sw_ecu_state *state, const sw_release *release, int usable)
{
#if SW_AIR_SPEED
    const int is_sound = usable && state->memory.rows == SW_WINDOW && state->sensors.set_aside < 0;
    const int drives = sw_drives_jets(state->fail_safe.mode);
    sw_air_speed_next(&state->speed, release, &state->memory, is_sound, drives);
#else
    (void)state;
    (void)release;
    (void)usable;
#endif
}

/* Returns BUS_OFF during bus-off, or if a bus-off began since the last step: the last frames may be lost. */
static uint8_t bus_fault(const sw_bus_health *before, const sw_bus_health *now)
{
    const int off = now->is_bus_off || now->bus_off > before->bus_off;
    return (uint8_t)(off ? SW_REASON_BUS_OFF : SW_REASON_NONE);
}

/* Copies the health without the struct's padding: states are compared as bytes, so padding must not change. */
static void remember_health(sw_bus_health *health, const sw_bus_health *now)
{
    health->is_bus_off = now->is_bus_off;
    health->bus_off = now->bus_off;
    health->tx_errors = now->tx_errors;
    health->rx_errors = now->rx_errors;
}

static uint8_t first_of(const uint8_t *reasons, int count)
{
    uint8_t first = SW_REASON_NONE;
    for (int i = count - 1; i >= 0; i--) {
        if (reasons[i] != SW_REASON_NONE) first = reasons[i];
    }
    return first;
}

static int are_finite(const float *values, int count)
{
    int finite = 1;
    for (int i = 0; i < count; i++) finite &= (values[i] >= -FLT_MAX) & (values[i] <= FLT_MAX);
    return finite;
}

/* Stores a new plan in the memory. A plan with NaN or infinity is dropped, even if the control step returns SW_OK. */
static decision planned(sw_ecu *ecu)
{
    decision due = {0.0, SW_REASON_INTERNAL};
    sw_memory_input(&ecu->state.memory, &ecu->calibration, &ecu->input);
    const sw_status status = sw_control_step_of(&ecu->numbers.program, &ecu->work.control, &ecu->input, &ecu->output);
    const int finite = are_finite(ecu->output.plan, SW_HORIZON) & are_finite(&ecu->output.forces[0][0], 2 * SW_HORIZON);
    if (status == SW_OK && finite) {
        for (int k = 0; k < SW_HORIZON; k++) ecu->state.memory.plan[k] = ecu->output.plan[k];
        const double speed = sw_memory_speed(&ecu->state.memory);
        const double wanted = (double)ecu->output.plan[ecu->state.memory.frozen] * speed;
        due.action = sw_followed(newest(&ecu->state.memory), wanted, speed * speed);
        due.fault = SW_REASON_NONE;
        ecu->trace.planned = 1;
    }
    return due;
}

/* Decides on the period's action in the present mode. The memory already contains this period's row. */
static decision decide(sw_ecu *ecu)
{
    decision due = {0.0, SW_REASON_NONE};
    switch (ecu->state.fail_safe.mode) {
    case SW_CONTROL:
        due = planned(ecu);
        break;
    case SW_HOLD:
        due.action = newest(&ecu->state.memory);
        break;
    case SW_DECAY:
        due.action = 0.5 * newest(&ecu->state.memory);
        break;
    default:
        sw_memory_without_plan(&ecu->state.memory);
        break;
    }
    return due;
}

/* Rounds a command to the message's resolution, half to even. The gate has limited it to the message's range. */
static int32_t steps_of(double flow_m2_per_s)
{
    const double exact = flow_m2_per_s / SW_FLOW_RESOLUTION;
    const int32_t whole = (int32_t)exact;
    const double rest = exact - (double)whole;
    const double least = whole % 2 == 0 ? 0.5 + 0.5 * DBL_EPSILON : 0.5; /* smallest rest that is rounded up */
    if (rest >= least) return whole + 1;
    return rest <= -least ? whole - 1 : whole;
}

/* Tells the fail-safe why the gate shut the jets. The fail-safe reports this reason on the bus. */
static void told_by_the_gate(sw_fail_safe *fail_safe, uint8_t interventions)
{
    if ((interventions & SW_GATED_NOT_FINITE) != 0) sw_fail_safe_latch(fail_safe, SW_REASON_INTERNAL);
    if ((interventions & SW_GATED_STALE) != 0) fail_safe->reason = SW_REASON_STALE;
}

/* Copies the period's pressures to state and memory, and fills in the inputs of the fail-safe. */
static void receive(sw_ecu *ecu, sw_period_inputs *inputs, const sw_frame *frames, int count, int64_t now_ns)
{
    sw_ecu_state *state = &ecu->state;
    sw_received received;
    double dynamic_pressure = SW_DYNAMIC_PRESSURE;
    uint8_t off_speed = 0;
#if SW_PAST > 0
    sw_speed_next(&state->speed, ecu->numbers.release, frames, count, now_ns SW_BY_KEY(&ecu->secoc));
    dynamic_pressure = sw_speed_dynamic_pressure(&state->speed, ecu->numbers.release);
    off_speed = state->speed.is_off;
#endif
    sw_reception(&received, &state->pressures, frames, count, now_ns, dynamic_pressure SW_BY_KEY(&ecu->secoc));
    const double *cp = received.usable && !off_speed ? received.cp : NULL;
#if SW_PAST > 0
    const double *reading = received.reading;
#else
    const double *reading = cp;
#endif
    if (received.usable) {
        state->has_pressures = 1;
        state->pressure_ns = received.sampled_ns;
        state->pressure_counter = received.counter;
    } else {
        state->missed = sw_counted(state->missed, 1);
    }
    sw_other_ecu_next(&state->other_ecu, frames, count, state->timing.step_ns SW_BY_KEY(&ecu->secoc));
    after_silence(&state->memory, &state->timing);
    with_row(state, ecu->numbers.release, cp);
    const uint8_t sensor_fault = check_sensors(ecu, cp, reading);
    const uint8_t no_benefit = check_benefit(state, ecu->numbers.release, cp != NULL);
    estimate_air_speed(state, ecu->numbers.release, cp != NULL);
    const uint8_t faults[] = {sw_inexact(), ecu->unfit, state->timing.fault,
                              bus_fault(&state->health, &ecu->surroundings.health),
                              (uint8_t)(state->other_ecu.is_there ? SW_REASON_OTHER_ECU : SW_REASON_NONE),
                              sensor_fault, no_benefit, ecu->surroundings.fault};
    inputs->usable = received.usable;
    inputs->has_request = received.has_request;
    inputs->enable_request = received.enable_request;
    inputs->unusable_because = received.unusable_because;
    inputs->window_full = state->memory.rows == SW_WINDOW;
    inputs->off_speed = off_speed;
    inputs->tests = (uint8_t)(state->benefit.tested_at > 0.0);
    inputs->fault = first_of(faults, (int)sizeof faults);
    inputs->updating = ecu->surroundings.updating;
}

/* Passes this period's action through the gate, and reports the gate's interventions to the fail-safe. */
static sw_gated act(sw_ecu *ecu, const sw_timing *before, int64_t now_ns)
{
    sw_ecu_state *state = &ecu->state;
    const decision due = decide(ecu);
    if (due.fault != SW_REASON_NONE) sw_fail_safe_latch(&state->fail_safe, due.fault);
    const sw_gated passed = sw_gate(due.action * SW_FLOW_SCALE, sw_drives_jets(state->fail_safe.mode),
                                    newest(&state->memory) * SW_FLOW_SCALE, before->has_step, before->step_ns,
                                    state->has_pressures, state->pressure_ns, now_ns, &ecu->limits);
    told_by_the_gate(&state->fail_safe, passed.interventions);
    return passed;
}

/* Checks this build against the exporter's known answer. The check uses the ECU's memory, which is not in use yet. */
static uint8_t judged(sw_ecu *ecu, const sw_numbers *numbers)
{
#ifdef SW_WITHOUT_KNOWN_ANSWER
    (void)ecu;
    (void)numbers;
    return SW_REASON_NONE;
#else
    const sw_status status = sw_known_answer_of(&numbers->program, &ecu->work.control, &ecu->input, &ecu->output);
    return status == SW_OK ? SW_REASON_NONE : SW_REASON_INTERNAL;
#endif
}

int sw_ecu_init_of(sw_ecu *ecu, const sw_numbers *numbers)
{
    sw_calibration own;
    const sw_numbers given = *numbers; /* a copy, since these may be the ECU's own numbers, which are cleared here */
    const uint8_t unfit = judged(ecu, &given);
    unsigned char *bytes = (unsigned char *)ecu;
    for (size_t i = 0; i < sizeof *ecu; i++) bytes[i] = 0; /* also clears padding, as states are compared as bytes */
    ecu->numbers = given;
    sw_calibration_own(given.release, &own);
    (void)sw_ecu_calibrate(ecu, &own);
    ecu->surroundings.fault = SW_REASON_NONE;
    ecu->state.timing.fault = SW_REASON_NONE;
    ecu->state.pressures.stream = SW_NODATA;
#if SW_PAST > 0
    ecu->state.speed.receiver.stream = SW_NODATA;
#if SW_AIR_SPEED
    ecu->state.speed.air.correction = 1.0;
#endif
#endif
#if SW_SECOC
    ecu->state.freshness.trip = 1;
#endif
    sw_fail_safe_start(&ecu->state.fail_safe);
    sw_sensors_start(&ecu->state.sensors);
    ecu->unfit = unfit;
    return unfit != SW_REASON_NONE ? (int)unfit : (int)sw_inexact();
}

#if SW_SECOC
int sw_ecu_authenticate(sw_ecu *ecu, const sw_authentication *given)
{
    ecu->secoc.is_given = 0;
    if (given->trip == 0u || sw_secoc_begin(&ecu->secoc, given->key) != 0) return 1;
    ecu->state.freshness.trip = given->trip;
    ecu->state.freshness.count = 0;
    ecu->state.pressures.verifier.freshness = given->heard_pressure;
#if SW_PAST > 0
    ecu->state.speed.receiver.verifier.freshness = given->heard_speed;
#endif
    return 0;
}
#endif

int sw_ecu_calibrate(sw_ecu *ecu, const sw_calibration *values)
{
    const int beyond = sw_calibration_beyond(values, ecu->numbers.release);
    if (beyond == 0) {
        ecu->calibration = *values;
        ecu->limits = sw_calibration_limits(values);
        sw_memory_freeze(&ecu->state.memory, (int)values->delay_steps + SW_PLAN_AHEAD);
    }
    return beyond;
}

static int could_receive(const sw_receiver *receiver)
{
    return receiver->stream <= SW_INVALID && receiver->checks <= SW_E2E_WINDOW;
}

#if SW_PAST > 0
/* Checks the speeds of a saved state that are used as divisors. */
static int could_drive(const sw_ecu_state *state)
{
    const sw_past *past = &state->memory.past;
    int sound = could_receive(&state->speed.receiver) & (past->count <= SW_PAST);
    sound &= !state->speed.known || state->speed.density > 0.0;
#if SW_AIR_SPEED
    sound &= state->speed.air.driven <= SW_AIR_FIRST_PERIOD && state->speed.air.correction > 0.0;
#endif
    for (uint32_t k = 0; k < past->count && sound; k++) sound = past->speeds[SW_PAST - 1u - k] > 0.0;
    return sound;
}
#endif

/* Checks the ranges of those values of a saved state that are an index, a shift, a divisor or a term of a sum. */
static int could_be(const sw_ecu_state *state)
{
    const sw_memory *memory = &state->memory;
    const int window = memory->rows <= SW_WINDOW && memory->frozen < SW_HORIZON;
    const int sensors = state->sensors.set_aside >= -1 && state->sensors.set_aside < SW_SENSORS;
#if SW_BENEFIT_CHECK
    const sw_benefit *counted = &state->benefit;
    const int benefit = counted->rested <= SW_PROVEN_PERIODS && counted->driven <= SW_FIRST_PERIOD &&
                        counted->doubt <= SW_BENEFIT_DOUBT && counted->waking <= SW_WAKE_PERIODS &&
                        counted->spent <= SW_PATIENCE;
#else
    const int benefit = 1;
#endif
#if SW_PAST > 0
    const int stream = could_receive(&state->pressures) & could_drive(state);
#else
    const int stream = could_receive(&state->pressures);
#endif
#if SW_SECOC
    const int counted_trip = state->freshness.trip > 0u;
#else
    const int counted_trip = 1;
#endif
    const int step = state->timing.step_ns >= -1 && state->timing.step_ns <= SW_LATEST_NS;
    const int lag = state->timing.lag_ns >= -SW_PERIOD_NS && state->timing.lag_ns <= SW_PERIOD_NS;
    return window & sensors & benefit & stream & step & lag & counted_trip & (state->fail_safe.mode <= SW_UPDATE);
}

int sw_ecu_restore(sw_ecu *ecu, const sw_ecu_state *state)
{
    if (!could_be(state) || state->memory.frozen != ecu->state.memory.frozen) return 1;
    ecu->state = *state;
    ecu->trace.action = newest(&state->memory);
    ecu->trace.interventions = 0;
    ecu->trace.planned = 0;
    return 0;
}

int sw_ecu_step(sw_ecu *ecu, int64_t now_ns, const sw_frame *frames_in, int count, sw_frame frames_out[SW_FRAMES_OUT])
{
    sw_ecu_state *state = &ecu->state;
    const sw_timing before = state->timing;
    sw_period_inputs inputs;
    ecu->trace.planned = 0;
    sw_timing_next(&state->timing, now_ns);
    state->overruns = sw_counted(state->overruns, (uint64_t)state->timing.skipped);
    receive(ecu, &inputs, frames_in, count, now_ns);
    sw_fail_safe_next(&state->fail_safe, &inputs);
    const sw_gated passed = act(ecu, &before, now_ns);
    const int32_t steps = steps_of(passed.flow_m2_per_s);
    const double action = (double)steps * SW_FLOW_RESOLUTION / SW_FLOW_SCALE; /* the action that the command causes */
    sw_memory_commanded(&state->memory, action);
    remember_health(&state->health, &ecu->surroundings.health);
    ecu->trace.action = action;
    ecu->trace.interventions = passed.interventions;

    sw_jet_command command = {0};
    command.flow = steps;
    command.mode = sw_mode_on_wire(state->fail_safe.mode);
    command.enable = passed.enable;
    /* A command has the counter of this period's pressures, or of the older pressures from which it was computed. */
    command.has_counter = state->has_pressures && (inputs.usable || sw_drives_jets(state->fail_safe.mode));
    command.pressure_counter = state->pressure_counter;
    return sw_write_frames(state, &command, ecu->numbers.release->bundle_hash, now_ns,
                           frames_out SW_BY_KEY(&ecu->secoc));
}

size_t sw_ecu_bytes(void) { return sizeof(sw_ecu); }

size_t sw_ecu_state_bytes(void) { return sizeof(sw_ecu_state); }
