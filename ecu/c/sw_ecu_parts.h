/* The parts of an ECU's control period, in the order of execution. Each part has its own file. */
#ifndef SW_ECU_PARTS_H
#define SW_ECU_PARTS_H

#include "sw_ecu_state.h"
#include "sw_exact.h"

/* Adds the bus key as the last argument of functions that read or write frames, if the build has a key. */
#if SW_SECOC
#define SW_BY_KEY(key) , key
#else
#define SW_BY_KEY(key)
#endif

/* --- sw_inexact.c --- */

/* Returns SW_REASON_INTERNAL if this build or the processor's present mode does not compute floats or doubles exactly
 * as the decisions need: sw_arithmetic fails, or operations are contracted. Otherwise returns SW_REASON_NONE.
 */
uint8_t sw_inexact(void);

/* --- sw_timing.c --- */

/* Updates the timing check with the step at now_ns. */
void sw_timing_next(sw_timing *timing, int64_t now_ns);

/* --- sw_e2e.c: the profile of the messages in use, SW_E2E_PROFILE --- */

/* Fills in the header of a message of `length` bytes. */
void sw_e2e_protect(uint8_t *data, int length, uint16_t data_id, uint8_t counter);

/* Returns whether the CRC is valid. */
int sw_e2e_check(const uint8_t *data, int length, uint16_t data_id);

/* Returns the counter of a protected message. */
uint8_t sw_e2e_counter(const uint8_t *data);

/* --- sw_codec_fd.c, sw_codec_classic.c: the set of messages in use --- */

typedef struct {
    double pressure_pa[SW_SENSORS];
    uint8_t valid; /* bit i for sensor i */
    uint8_t enable_request;
    int64_t age_ns;
} sw_pressure;

typedef struct {
    int32_t flow; /* in units of the message's resolution */
    uint8_t mode; /* SW_MODE_ */
    uint8_t enable;
    uint8_t has_counter;
    uint8_t pressure_counter;
} sw_jet_command;

typedef struct {
    uint8_t state;  /* SW_MODE_ */
    uint8_t reason; /* SW_REASON_ */
    uint8_t set_aside;
    uint32_t bundle_hash;
    uint32_t overruns, missed, crc_errors, refused; /* saturated when they are sent */
    uint32_t bus_off, tx_errors, rx_errors;
#if SW_SECOC
    uint32_t not_authentic;
#endif
} sw_ecu_status;

/* Reads SW_PRESSURE_BYTES bytes. */
void sw_parse_pressure(const uint8_t *data, sw_pressure *pressure);

#if SW_PAST > 0
typedef struct {
    double speed_m_per_s;     /* 0 if the speed is unknown */
    double density_kg_per_m3; /* density of the air; 0 if unknown */
    uint8_t known;            /* whether the vehicle knows its speed */
    int64_t age_ns;
} sw_speed;

/* Reads SW_SPEED_BYTES bytes. */
void sw_parse_speed(const uint8_t *data, sw_speed *speed);
#endif

/* Write SW_COMMAND_BYTES and SW_STATUS_BYTES bytes with an empty header; SW_PLAN_AHEAD is the value of NextPeriod. */
void sw_emit_command(uint8_t *data, const sw_jet_command *command);
void sw_emit_status(uint8_t *data, const sw_ecu_status *status);

/* --- sw_receiver.c --- */

/* The properties of a message that is received. */
typedef struct {
    uint32_t id;
    int bytes; /* number of the bytes that E2E protects */
    uint16_t data_id;
#if SW_SECOC
    int secured; /* number of bytes including freshness and MAC */
#endif
} sw_message;

/* Updates the receiver with the frames of one period. Returns the newest frame whose check is good, or NULL. */
const sw_frame *sw_receive(sw_receiver *receiver, const sw_message *message, const sw_frame *frames,
                           int count SW_BY_KEY(const sw_secoc *secoc));

/* --- sw_reception.c: usable pressures from a period's frames, or the reason why there are none --- */

typedef struct {
    uint8_t usable;
    uint8_t has_request; /* whether a frame arrived that may change the request */
    uint8_t enable_request;
    uint8_t unusable_because; /* SW_REASON_ */
    uint8_t counter;          /* E2E counter of the frame with the usable pressures */
    int64_t sampled_ns;       /* time at which the usable pressures were sampled */
    double cp[SW_SENSORS];    /* the usable pressures, as Cp */
#if SW_PAST > 0
    double reading[SW_SENSORS]; /* pressures divided by the dynamic pressure at the design speed */
#endif
} sw_received;

/* Evaluates a period's frames. dynamic_pressure is the dynamic pressure at the present speed, in Pa; 0 if unknown. */
void sw_reception(sw_received *received, sw_receiver *receiver, const sw_frame *frames, int count, int64_t now_ns,
                  double dynamic_pressure SW_BY_KEY(const sw_secoc *secoc));

/* Returns whether the content of a frame was sampled at most oldest_ns before now_ns, and not after now_ns. */
int sw_is_fresh(int64_t timestamp_ns, int64_t age_ns, int64_t now_ns, int64_t oldest_ns);

/* Updates the detection of another ECU at step_ns. The frames' commands and statuses all come from another ECU. */
void sw_other_ecu_next(sw_other_ecu *other, const sw_frame *frames, int count,
                       int64_t step_ns SW_BY_KEY(const sw_secoc *secoc));

/* --- sw_speed.c: the vehicle's speed, for a release that supports a range of speeds --- */

#if SW_PAST > 0
/* Updates the speed from a period's frames. */
void sw_speed_next(sw_speed_state *speed, const sw_release *release, const sw_frame *frames, int count,
                   int64_t now_ns SW_BY_KEY(const sw_secoc *secoc));

/* Returns the dynamic pressure in Pa; 0 if the speed is unknown. */
double sw_speed_dynamic_pressure(const sw_speed_state *speed, const sw_release *release);

/* Returns the speed in use / design speed, limited to the release's range; 1 if the speed on the bus is unknown or too
 * far outside that range. */
double sw_speed_present(const sw_speed_state *speed, const sw_release *release);

#if SW_AIR_SPEED
/* Updates the estimate of the air speed after a period. `is_sound`: the window is full and has this period's pressures,
 * and no sensor is excluded. `drives`: the jets were allowed to run during the past period. */
void sw_air_speed_next(sw_speed_state *speed, const sw_release *release, const sw_memory *memory, int is_sound,
                       int drives);
#endif
#endif

/* --- sw_past.c: rows of past periods, resampled at equal distances travelled --- */

/* Returns `before` moved towards `to` by this share of the difference; returns `to` for a share of 1 or more. */
double sw_followed(double before, double to, double share);

#if SW_PAST > 0
/* Filters the pressures of this period's row with the previous row's pressures, then adds the row. */
void sw_past_extend(sw_past *past, const double row[SW_COLUMNS], double speed);

void sw_past_empty(sw_past *past);

/* Fills columns `first` to `last` of the window at equal distances travelled. Returns the number of rows with data. */
uint32_t sw_past_read(const sw_past *past, double window[SW_WINDOW][SW_COLUMNS], int first, int last);
#endif

/* --- sw_memory.c: window, plan and actions in transit --- */

/* Add this period's row (with speed / design speed), bridge a period without pressures, and empty the window. */
void sw_memory_observed(sw_memory *memory, const double cp[SW_SENSORS], double speed);
void sw_memory_bridged(sw_memory *memory);
void sw_memory_emptied(sw_memory *memory);
void sw_memory_commanded(sw_memory *memory, double action);
void sw_memory_without_plan(sw_memory *memory);

/* Returns the speed of the newest row, divided by the design speed. */
double sw_memory_speed(const sw_memory *memory);

/* Changes the actuator's delay to `frozen` periods (less than SW_HORIZON); `frozen` actions are then in transit. */
void sw_memory_freeze(sw_memory *memory, int frozen);

/* Replaces a sensor's pressures in all rows with data. `values` has a row for each row of the window or the past. */
void sw_memory_with_column(sw_memory *memory, int sensor, const double values[SW_KEPT][SW_SENSORS]);

/* Fills in the input of the control step. */
void sw_memory_input(const sw_memory *memory, const sw_calibration *calibration, sw_input *input);

/* --- sw_sensors.c --- */

void sw_sensors_start(sw_sensors *sensors);

#if SW_SENSOR_CHECK
/* Checks the pressures of a period against the window in `memory`. `cp` is NULL if there are no pressures; `reading`
 * has the pressures divided by the dynamic pressure at the design speed, whatever the present speed. Returns the
 * SW_REASON_ for which the ECU must switch itself off, or SW_REASON_NONE.
 */
uint8_t sw_sensors_next(sw_sensors *sensors, const sw_numbers *numbers, sw_estimator_work *work, const sw_memory *memory,
                        const double *cp, const double *reading, int64_t skipped);
#endif

/* --- sw_benefit.c --- */

#if SW_BENEFIT_CHECK
/* Checks whether control helps. `cp` has the period's pressures; it is NULL if there are no pressures. `speed` is the
 * speed divided by the design speed; `drives` states whether the jets were allowed to run during the past period.
 * Returns the SW_REASON_ for which the ECU must switch itself off, or SW_REASON_NONE.
 */
uint8_t sw_benefit_next(sw_benefit *benefit, const sw_release *release, const double *cp, double speed, int drives);
#endif

/* --- sw_fail_safe.c --- */

typedef struct {
    uint8_t usable;
    uint8_t has_request;
    uint8_t enable_request;
    uint8_t unusable_because;
    uint8_t window_full;
    uint8_t off_speed; /* the vehicle's speed is outside the release's range */
    uint8_t tests;     /* the jets must be shut to measure the wake without them */
    uint8_t fault; /* SW_REASON_, or SW_REASON_NONE */
    uint8_t updating;
} sw_period_inputs;

void sw_fail_safe_start(sw_fail_safe *fail_safe);
void sw_fail_safe_next(sw_fail_safe *fail_safe, const sw_period_inputs *inputs);

/* Latches a fault of the ECU itself, detected during the period. */
void sw_fail_safe_latch(sw_fail_safe *fail_safe, uint8_t reason);

int sw_drives_jets(uint8_t mode);
uint8_t sw_mode_on_wire(uint8_t mode);

/* --- sw_calibration.c --- */

/* Returns the least and the greatest permitted values. These limits include the release's own `weights`. */
void sw_calibration_bounds(const float weights[SW_TERMS], sw_calibration *low, sw_calibration *high);

/* Returns the number of the first value outside its limits, counted from 1; 0 if no value is outside. */
int sw_calibration_beyond(const sw_calibration *values, const sw_release *release);

/* Returns a release's own calibration in this vehicle. */
void sw_calibration_own(const sw_release *release, sw_calibration *own);

/* Returns the gate's bounds for valid values. The bounds are never wider than the vehicle's bounds. */
sw_gate_limits sw_calibration_limits(const sw_calibration *values);

/* --- sw_gate.c --- */

typedef struct {
    double flow_m2_per_s;
    uint8_t enable;
    uint8_t interventions;
} sw_gated;

/* Limits a command. has_previous and has_pressures state whether previous_ns and pressure_ns are valid. */
sw_gated sw_gate(double flow_m2_per_s, int enable, double previous_m2_per_s, int has_previous, int64_t previous_ns,
                 int has_pressures, int64_t pressure_ns, int64_t now_ns, const sw_gate_limits *limits);

/* --- sw_frames.c --- */

/* Writes a JetCommand, and an EcuStatus of the state, as protected frames, and advances the state's counters. Returns
 * the number of frames: 0 if the build needs a key and the ECU has none.
 */
int sw_write_frames(sw_ecu_state *state, const sw_jet_command *command, uint32_t bundle_hash, int64_t now_ns,
                    sw_frame frames_out[SW_FRAMES_OUT] SW_BY_KEY(const sw_secoc *secoc));

#endif
