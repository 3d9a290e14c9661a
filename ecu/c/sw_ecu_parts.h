/* The parts of an ECU's control period, in the order they run. Each file implements one. */
#ifndef SW_ECU_PARTS_H
#define SW_ECU_PARTS_H

#include "sw_ecu_state.h"
#include "sw_exact.h"

/* The bus' key, behind the other arguments of what reads and writes frames; nothing where the release has none. */
#if SW_SECOC
#define SW_BY_KEY(key) , key
#else
#define SW_BY_KEY(key)
#endif

/* --- sw_inexact.c --- */

/* SW_REASON_INTERNAL where this build, or the processor as it is set now, computes in float or double otherwise than the
 * ECU's decisions need it, as sw_arithmetic looks at it and without contraction; SW_REASON_NONE.
 */
uint8_t sw_inexact(void);

/* --- sw_timing.c --- */

/* Moves on to the step at now_ns. */
void sw_timing_next(sw_timing *timing, int64_t now_ns);

/* --- sw_e2e.c: the profile of the messages in use, SW_E2E_PROFILE --- */

/* Fills the header of a message of `length` bytes in. */
void sw_e2e_protect(uint8_t *data, int length, uint16_t data_id, uint8_t counter);

/* Whether the CRC fits. */
int sw_e2e_check(const uint8_t *data, int length, uint16_t data_id);

/* The counter of a protected message. */
uint8_t sw_e2e_counter(const uint8_t *data);

/* --- sw_codec_fd.c, sw_codec_classic.c: the set of messages in use --- */

typedef struct {
    double pressure_pa[SW_SENSORS];
    uint8_t valid; /* bit i for sensor i */
    uint8_t enable_request;
    int64_t age_ns;
} sw_pressure;

typedef struct {
    int32_t flow; /* in steps of the wire */
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
    uint32_t overruns, missed, crc_errors, refused; /* limited when they are sent */
    uint32_t bus_off, tx_errors, rx_errors;
#if SW_SECOC
    uint32_t not_authentic;
#endif
} sw_ecu_status;

/* Reads SW_PRESSURE_BYTES bytes. */
void sw_parse_pressure(const uint8_t *data, sw_pressure *pressure);

#if SW_PAST > 0
typedef struct {
    double speed_m_per_s;     /* 0 where it is not known */
    double density_kg_per_m3; /* of the air; 0 where it is not known */
    uint8_t known;            /* whether the vehicle knows its speed */
    int64_t age_ns;
} sw_speed;

/* Reads SW_SPEED_BYTES bytes. */
void sw_parse_speed(const uint8_t *data, sw_speed *speed);
#endif

/* Into SW_COMMAND_BYTES and SW_STATUS_BYTES bytes with an empty header; SW_PLAN_AHEAD is JetCommand's NextPeriod. */
void sw_emit_command(uint8_t *data, const sw_jet_command *command);
void sw_emit_status(uint8_t *data, const sw_ecu_status *status);

/* --- sw_receiver.c --- */

/* A message that is received. */
typedef struct {
    uint32_t id;
    int bytes; /* that E2E protects */
    uint16_t data_id;
#if SW_SECOC
    int secured; /* bytes with freshness and MAC */
#endif
} sw_message;

/* The state after one period. Returns the newest frame that was good by itself, or NULL. */
const sw_frame *sw_receive(sw_receiver *receiver, const sw_message *message, const sw_frame *frames,
                           int count SW_BY_KEY(const sw_secoc *secoc));

/* --- sw_reception.c: from a period's frames to pressures that may be planned on, or why there are none --- */

typedef struct {
    uint8_t usable;
    uint8_t has_request; /* whether a frame came whose request is to be believed */
    uint8_t enable_request;
    uint8_t unusable_because; /* SW_REASON_ */
    uint8_t counter;          /* of the usable ones' frame */
    int64_t sampled_ns;       /* theirs */
    double cp[SW_SENSORS];    /* theirs */
#if SW_PAST > 0
    double reading[SW_SENSORS]; /* the same in units of the design speed: a resting sensor does not follow the speed */
#endif
} sw_received;

/* dynamic_pressure is in Pa at Cp = 1 at the present speed; 0 where that is not known. */
void sw_reception(sw_received *received, sw_receiver *receiver, const sw_frame *frames, int count, int64_t now_ns,
                  double dynamic_pressure SW_BY_KEY(const sw_secoc *secoc));

/* Whether what a frame carries is of now, or older by at most oldest_ns. */
int sw_is_fresh(int64_t timestamp_ns, int64_t age_ns, int64_t now_ns, int64_t oldest_ns);

/* Moves on to the step at step_ns with these frames: commands and statuses among them are another ECU's. */
void sw_other_ecu_next(sw_other_ecu *other, const sw_frame *frames, int count,
                       int64_t step_ns SW_BY_KEY(const sw_secoc *secoc));

/* --- sw_speed.c: the vehicle's speed, where a release serves a range of speeds --- */

#if SW_PAST > 0
/* Moves on by a period's frames. */
void sw_speed_next(sw_speed_state *speed, const sw_release *release, const sw_frame *frames, int count,
                   int64_t now_ns SW_BY_KEY(const sw_secoc *secoc));

/* Pa at Cp = 1; 0 without a speed. */
double sw_speed_dynamic_pressure(const sw_speed_state *speed, const sw_release *release);

/* The vehicle's speed in design speeds: within the release's range, and 1 where it is not known or too far out. */
double sw_speed_present(const sw_speed_state *speed, const sw_release *release);
#endif

/* --- sw_past.c: rows of periods read again at steps of the present speed --- */

/* Where pressures that are kept, or a command, are after a period in which they should get to `to`. */
double sw_followed(double before, double to, double share);

#if SW_PAST > 0
/* Adds this period's row, whose pressures follow those of the row before it. */
void sw_past_extend(sw_past *past, const double row[SW_COLUMNS], double speed);

void sw_past_empty(sw_past *past);

/* The window at steps of the present speed. Returns how many of its rows have come. */
uint32_t sw_past_read(const sw_past *past, double window[SW_WINDOW][SW_COLUMNS]);
#endif

/* --- sw_memory.c: window, plan and actions under way --- */

/* Adds a row for this period at a speed, in design speeds. */
void sw_memory_observed(sw_memory *memory, const double cp[SW_SENSORS], double speed);
void sw_memory_bridged(sw_memory *memory);
void sw_memory_emptied(sw_memory *memory);
void sw_memory_commanded(sw_memory *memory, double action);
void sw_memory_without_plan(sw_memory *memory);

/* The speed of the newest row, in design speeds. */
double sw_memory_speed(const sw_memory *memory);

/* Takes on another delay of the actuator: so many frozen actions, fewer than SW_HORIZON. */
void sw_memory_freeze(sw_memory *memory, int frozen);

/* Other pressures of one sensor in the rows that have come; values has a row a row of the window, or of the past. */
void sw_memory_with_column(sw_memory *memory, int sensor, const double values[SW_KEPT][SW_SENSORS]);

/* The control step's input. */
void sw_memory_input(const sw_memory *memory, const sw_calibration *calibration, sw_input *input);

/* --- sw_sensors.c --- */

void sw_sensors_start(sw_sensors *sensors);

#if SW_SENSOR_CHECK
/* Judges a period with the memory's window; cp is NULL without pressures, and `reading` has them as they came, whatever
 * the speed is. Returns the SW_REASON_ for which the ECU must switch itself off, or SW_REASON_NONE.
 */
uint8_t sw_sensors_next(sw_sensors *sensors, const sw_numbers *numbers, sw_estimator_work *work, const sw_memory *memory,
                        const double *cp, const double *reading, int64_t skipped);
#endif

/* --- sw_benefit.c --- */

#if SW_BENEFIT_CHECK
/* Judges a period with these pressures; cp is NULL without any. `speed` is the vehicle's in design speeds, `drives`
 * whether the jets could run up to now. Returns the SW_REASON_ for which the ECU must switch itself off, or
 * SW_REASON_NONE.
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
    uint8_t off_speed; /* the vehicle is slower or faster than the release is made for */
    uint8_t tests;     /* the jets must be shut to measure the wake without them */
    uint8_t fault; /* SW_REASON_, or SW_REASON_NONE */
    uint8_t updating;
} sw_period_inputs;

void sw_fail_safe_start(sw_fail_safe *fail_safe);
void sw_fail_safe_next(sw_fail_safe *fail_safe, const sw_period_inputs *inputs);

/* Latches a fault of the ECU's own that shows only in the course of the period. */
void sw_fail_safe_latch(sw_fail_safe *fail_safe, uint8_t reason);

int sw_drives_jets(uint8_t mode);
uint8_t sw_mode_on_wire(uint8_t mode);

/* --- sw_calibration.c --- */

/* The least and the greatest values; a release's own weights are within them. */
void sw_calibration_bounds(const float weights[SW_TERMS], sw_calibration *low, sw_calibration *high);

/* The number of the first value that is out of its limits, from 1; 0 if there is none. */
int sw_calibration_beyond(const sw_calibration *values, const sw_release *release);

/* A release's own in this vehicle. */
void sw_calibration_own(const sw_release *release, sw_calibration *own);

/* The gate's bounds by values within their limits, never wider than the vehicle's. */
sw_gate_limits sw_calibration_limits(const sw_calibration *values);

/* --- sw_gate.c --- */

typedef struct {
    double flow_m2_per_s;
    uint8_t enable;
    uint8_t interventions;
} sw_gated;

/* has_previous and has_pressures state whether the times next to them are any. */
sw_gated sw_gate(double flow_m2_per_s, int enable, double previous_m2_per_s, int has_previous, int64_t previous_ns,
                 int has_pressures, int64_t pressure_ns, int64_t now_ns, const sw_gate_limits *limits);

/* --- sw_frames.c --- */

/* Writes a JetCommand, and an EcuStatus of the state, as protected frames; the counters in the state move on. Returns how
 * many: none where there should be a key and is none.
 */
int sw_write_frames(sw_ecu_state *state, const sw_jet_command *command, uint32_t bundle_hash, int64_t now_ns,
                    sw_frame frames_out[SW_FRAMES_OUT] SW_BY_KEY(const sw_secoc *secoc));

#endif
