/* What an ECU is given, runs on, and remembers between control periods. Public only because the caller owns it. */
#ifndef SW_ECU_STATE_H
#define SW_ECU_STATE_H

#include <stdint.h>

#include "stillwake.h"
#include "sw_ecu_settings.h"
#if SW_SENSOR_CHECK
#include "sw_estimator.h"
#endif
#if SW_SECOC
#include "sw_secoc.h"
#endif

#define SW_FRAME_BYTES 64
#define SW_FRAMES_OUT 2 /* a JetCommand and an EcuStatus */

/* Hypotheses of the sensor check: each sensor may lie, each pair may be exchanged. */
#define SW_PAIRS (SW_SENSORS * (SW_SENSORS - 1) / 2)
#define SW_HYPOTHESES (SW_SENSORS + SW_PAIRS)

/* Rows of estimates that are kept: of the window, or of the past behind it where a release serves a range of speeds. */
#if SW_PAST > 0
#define SW_KEPT SW_PAST
#else
#define SW_KEPT SW_WINDOW
#endif

/* Times are in ns of one clock that never goes back, from 0 to this: 73 years. Others are a fault of the clock. */
#define SW_LATEST_NS ((int64_t)1 << 61)

/* A CAN frame; bytes beyond `length` are not read. */
typedef struct {
    int64_t timestamp_ns; /* when it was received, or handed over to be sent; of the same clock as now_ns */
    uint32_t id;
    uint8_t is_extended; /* 29 bits of identifier */
    uint8_t is_fd;
    uint8_t length;
    uint8_t data[SW_FRAME_BYTES];
} sw_frame;

/* What the ECU does in a control period; on the wire these are SW_MODE_ (sw_ecu_settings.h). */
typedef enum {
    SW_INIT,    /* no usable pressures since power-on */
    SW_STANDBY, /* the request for control stands as it did at power-on: it must fall first */
    SW_ARMED,   /* the request is low */
    SW_WARMUP,  /* control is wanted, but the window is not full, the speed not served, or whether it helps tested */
    SW_CONTROL, /* the jets follow the controller */
    SW_HOLD,    /* pressures are missing: the last command stays */
    SW_DECAY,   /* for longer: it is halved each period */
    SW_FAULT,   /* the jets are shut until good frames have come and the request rises again */
    SW_UPDATE   /* a new release is being written; a reset alone leads out */
} sw_operating_mode;

/* What the command gate had to do, bits. */
enum {
    SW_GATED_NOT_ENABLED = 1,
    SW_GATED_NOT_FINITE = 2,
    SW_GATED_CLOCK = 4,
    SW_GATED_STALE = 8,
    SW_GATED_RANGE = 16,
    SW_GATED_RATE = 32
};

typedef enum { SW_NODATA, SW_STREAM_INIT, SW_VALID, SW_INVALID } sw_stream;

/* Checks of received frames, in the order of sw_receiver.counts. */
typedef enum {
    SW_CHECK_OK,
    SW_CHECK_OK_SOME_LOST,
    SW_CHECK_REPEATED,
    SW_CHECK_WRONG_SEQUENCE,
    SW_CHECK_ERROR,
    SW_CHECK_NO_NEW_DATA,
    SW_CHECKS
} sw_check;

/* The CAN controller's error counters. */
typedef struct {
    uint8_t is_bus_off;
    uint32_t bus_off; /* how often it was, since power-on */
    uint32_t tx_errors;
    uint32_t rx_errors;
} sw_bus_health;

/* What the surroundings report to the ECU; the caller writes it before a step, never while one runs, and it stays. */
typedef struct {
    sw_bus_health health;
    uint8_t fault;    /* SW_REASON_ for which the ECU must switch itself off, or SW_REASON_NONE */
    uint8_t updating; /* a new release is to be written: shut off for good, as soon as no jet may run */
} sw_surroundings;

/* Counts stop at their largest value. */
typedef struct {
    uint8_t stream;       /* sw_stream */
    uint8_t has_counter;  /* whether a frame with a good CRC has come */
    uint8_t last_counter; /* of the latest one */
    uint8_t checks;       /* how many stand in `window`, oldest first */
    uint8_t window[SW_E2E_WINDOW];
    uint32_t counts[SW_CHECKS];
#if SW_SECOC
    sw_verifier verifier; /* in front of all that */
#endif
} sw_receiver;

typedef struct {
    uint8_t mode;   /* sw_operating_mode */
    uint8_t reason; /* SW_REASON_ */
    uint8_t enable_request;
    uint32_t misses; /* periods in a row without usable pressures */
    uint32_t good;   /* usable ones in a row */
    uint64_t lost;   /* latest SW_LOSS_WINDOW periods, a bit each and the newest lowest */
} sw_fail_safe;

typedef struct {
    uint8_t has_step;
    uint8_t fault; /* SW_REASON_, or SW_REASON_NONE */
    uint32_t off_time; /* latest SW_DEADLINE_WINDOW steps, a bit each */
    int64_t step_ns;
    int64_t lag_ns;
    int64_t skipped;
} sw_timing;

#if SW_PAST > 0
/* The rows of the latest control periods at the speeds they had; the last `count` have come, the others are zero. */
typedef struct {
    uint32_t count;
    double rows[SW_PAST][SW_COLUMNS]; /* as in the window, each in units of its own speed */
    double speeds[SW_PAST];           /* in design speeds */
} sw_past;

/* The vehicle's speed through the air. */
typedef struct {
    sw_receiver receiver; /* of the message */
    uint8_t known;        /* whether one is believed that is not too old */
    uint8_t is_off;       /* outside the release's range; once outside it has to come back by the margin */
    double ratio;         /* to the design speed; 0 if it is not known */
    double density;       /* of the air in kg/m3, with that speed */
    int64_t measured_ns;
} sw_speed_state;
#endif

typedef struct {
    uint32_t rows; /* of the window that have come, the last ones */
    uint32_t gap;  /* periods in a row without pressures */
    double window[SW_WINDOW][SW_COLUMNS];
    float plan[SW_HORIZON];
    uint32_t frozen; /* actions at the head of a plan that are under way, by the actuator's delay */
    double under_way[SW_HORIZON]; /* actions sent, oldest first, `frozen` + 1 of them; zeros behind */
#if SW_PAST > 0
    sw_past past; /* from which the window is read */
#endif
} sw_memory;

/* The sensor check; rows of the arrays are hypotheses. */
typedef struct {
    int8_t set_aside; /* the sensor that lies; -1 without one */
    uint8_t implausible;
    uint8_t judged;    /* whether `residual` holds one */
    uint8_t has_read;  /* whether `readings` hold some */
    uint32_t doubt;
    uint32_t flat[SW_SENSORS];
    double readings[SW_SENSORS];
    double residual[SW_HYPOTHESES][SW_SENSORS];
    double fast[SW_HYPOTHESES][SW_SENSORS];
    double slow[SW_HYPOTHESES][SW_SENSORS];
    double noise[SW_HYPOTHESES][SW_SENSORS];
    double score[SW_HYPOTHESES][SW_SENSORS];
    double estimates[SW_KEPT][SW_SENSORS]; /* of each sensor by the others, in the latest periods */
} sw_sensors;

/* The benefit check; suction and swing in units of the release's own wake without jets. */
typedef struct {
    uint32_t waking; /* periods with the jets shut until the wake is that without control */
    uint32_t rested; /* periods that the means without control rest on, up to SW_PROVEN_PERIODS */
    uint32_t driven; /* the same under control, up to the first that is judged */
    uint32_t doubt;
    uint32_t spent; /* periods of tests less those in which control helped, up to SW_PATIENCE */
    double resting_suction;
    double resting_swing;
    double suction;
    double swing;
    double tested_at; /* the speed at which a test began, in design speeds; 0 without a test */
} sw_benefit;

/* Whether another ECU is on the bus. */
typedef struct {
    uint8_t is_there;
    uint32_t frames;  /* of it so far */
    int64_t until_ns; /* when it counts as gone */
} sw_other_ecu;

/* Everything that is remembered from one control period to the next. */
typedef struct {
    sw_memory memory;
    sw_sensors sensors;
    sw_benefit benefit;
    sw_receiver pressures;
#if SW_PAST > 0
    sw_speed_state speed;
#endif
    sw_fail_safe fail_safe;
    sw_timing timing;
    sw_other_ecu other_ecu;
    uint8_t command_counter; /* what the next frame will carry */
    uint8_t status_counter;
    uint8_t has_pressures; /* whether usable ones have come */
    uint8_t pressure_counter; /* of the frame that brought the latest */
    int64_t pressure_ns; /* when they were sampled */
    uint32_t overruns;   /* periods left out */
    uint32_t missed;     /* steps without usable pressures */
    sw_bus_health health;
#if SW_SECOC
    sw_freshness freshness; /* of the next JetCommand and the next EcuStatus */
#endif
} sw_ecu_state;

/* What a release has besides its controller and its sensor estimator; read in place, wherever it stands. */
typedef struct {
    double fast_deviation[SW_SENSORS][SW_SENSORS]; /* of sound sensors' residuals, in Cp: sensor i without sensor j */
    double slow_deviation[SW_SENSORS][SW_SENSORS]; /* the same, of their slow means */
    double resting[SW_RESTING_SPEEDS][3]; /* the wake without jets: speed, base and swing in Cp */
    double slowest; /* of the speeds that it serves, in design speeds */
    double fastest;
    double design_speed;     /* in m/s */
    double design_density;   /* of the air in kg/m3 */
    float weights[SW_TERMS]; /* of the cost terms */
    uint32_t bundle_hash;    /* the first 32 bits of the release's digest */
    uint8_t base[SW_BASES];  /* sensors on the base */
    uint8_t pairs[SW_MIRRORED_PAIRS][2]; /* mirrored sensors */
    uint8_t reserved[SW_RELEASE_RESERVED];
} sw_release;

/* Where all numbers of a release stand: compiled in, or in an image on flash (sw_image.h). */
typedef struct {
    sw_program program;
    const sw_release *release;
#if SW_SENSOR_CHECK
    const struct sw_estimator_weights *estimator;
#endif
} sw_numbers;

/* What may be changed of a release on the vehicle, in the layout in which UDS and XCP carry it. */
typedef struct {
    float weights[SW_TERMS]; /* of the cost terms */
    float action_limit;      /* largest magnitude of an action, planned or let pass by the gate, in U_inf W */
    float command_step;      /* largest change in a control period, in U_inf W */
    uint32_t delay_steps;    /* actuator delay in control periods that is compensated */
} sw_calibration;

#if SW_SECOC
/* What a node is given of the bus' key in one power cycle. */
typedef struct {
    uint8_t key[SW_AES_BYTES];
    uint32_t trip;           /* power cycles so far, this one included: counted in lasting memory before */
    uint64_t heard_pressure; /* freshness values accepted in earlier ones; 0 for none */
    uint64_t heard_speed;    /* the same of VehicleSpeed, where the release needs it */
} sw_authentication;
#endif

/* Bounds of the command gate, in m2/s. */
typedef struct {
    double flow_m2_per_s;
    double step_m2_per_s;
} sw_gate_limits;

/* What happened in the latest step, for observers. */
typedef struct {
    double action; /* sent, in U_inf W */
    uint8_t interventions;
    uint8_t planned; /* whether `output` is of this step; it is in units of the present speed */
} sw_trace;

/* Scratch memory of the parts that take turns. */
typedef union {
#if SW_SENSOR_CHECK
    sw_estimator_work estimator;
#endif
    sw_workspace control;
} sw_ecu_work;

typedef struct {
    sw_ecu_state state; /* first, so that it can be saved and compared by itself */
    sw_surroundings surroundings;
    sw_calibration calibration; /* in force; sw_ecu_calibrate alone changes it */
    sw_gate_limits limits;      /* by it */
    uint8_t unfit;              /* SW_REASON_ why it keeps the jets shut since power-on, or SW_REASON_NONE */
    sw_trace trace;
    sw_input input;
    sw_output output;
#if SW_SECOC
    sw_secoc secoc; /* by sw_ecu_authenticate; in no state that is saved */
#endif
    sw_ecu_work work;
    sw_numbers numbers; /* what it runs; set by sw_ecu_init and sw_ecu_init_of */
} sw_ecu;

#endif
