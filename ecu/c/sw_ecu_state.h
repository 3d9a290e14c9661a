/* The inputs, parameters and state of an ECU. They are public only because the caller provides the memory. */
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

/* Hypotheses of the sensor check: each sensor may read wrongly, and each pair of sensors may be exchanged. */
#define SW_PAIRS (SW_SENSORS * (SW_SENSORS - 1) / 2)
#define SW_HYPOTHESES (SW_SENSORS + SW_PAIRS)

/* Number of stored rows of estimates: the window's rows, or the past's rows in a release for a range of speeds. */
#if SW_PAST > 0
#define SW_KEPT SW_PAST
#else
#define SW_KEPT SW_WINDOW
#endif

/* Times, in ns, must be from 0 to this limit (73 years) and must always rise; otherwise there is a clock fault. */
#define SW_LATEST_NS ((int64_t)1 << 61)

/* A CAN frame; bytes beyond `length` are not read. */
typedef struct {
    int64_t timestamp_ns; /* time when received or handed over for sending, on the clock of now_ns */
    uint32_t id;
    uint8_t is_extended; /* has a 29-bit identifier */
    uint8_t is_fd;
    uint8_t length;
    uint8_t data[SW_FRAME_BYTES];
} sw_frame;

/* The operating mode in a control period; on the bus it has a number SW_MODE_ (sw_ecu_settings.h). */
typedef enum {
    SW_INIT,    /* no usable pressures since power-on */
    SW_STANDBY, /* the request has been high since power-on, and must first become low */
    SW_ARMED,   /* control is not requested */
    SW_WARMUP,  /* control is requested, but the window is not full, the speed is out of range, or a test runs */
    SW_CONTROL, /* the jets follow the controller */
    SW_HOLD,    /* pressures are missing: the last command is held */
    SW_DECAY,   /* pressures are missing longer than in HOLD: the command is halved each period */
    SW_FAULT,   /* the jets are shut until good frames arrive and the request rises again */
    SW_UPDATE   /* a new release is being written; only a reset ends this mode */
} sw_operating_mode;

/* Interventions of the command gate, as bits. */
enum {
    SW_GATED_NOT_ENABLED = 1,
    SW_GATED_NOT_FINITE = 2,
    SW_GATED_CLOCK = 4,
    SW_GATED_STALE = 8,
    SW_GATED_RANGE = 16,
    SW_GATED_RATE = 32
};

typedef enum { SW_NODATA, SW_STREAM_INIT, SW_VALID, SW_INVALID } sw_stream;

/* Results of the check of a received frame, in the order of sw_receiver.counts. */
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
    uint32_t bus_off; /* number of bus-off events since power-on */
    uint32_t tx_errors;
    uint32_t rx_errors;
} sw_bus_health;

/* The conditions around the ECU. The caller writes them between two steps. They apply until the next change. */
typedef struct {
    sw_bus_health health;
    uint8_t fault;    /* SW_REASON_ for which the ECU must switch itself off, or SW_REASON_NONE */
    uint8_t updating; /* a new release is being written: as soon as no jet may run, the ECU is off until a reset */
} sw_surroundings;

/* The state of a receiver. Counts saturate at their largest value. */
typedef struct {
    uint8_t stream;       /* sw_stream */
    uint8_t has_counter;  /* whether a frame with a valid CRC has arrived */
    uint8_t last_counter; /* counter of the latest frame with a valid CRC */
    uint8_t checks;       /* number of checks in `window`, whose oldest check comes first */
    uint8_t window[SW_E2E_WINDOW];
    uint32_t counts[SW_CHECKS];
#if SW_SECOC
    sw_verifier verifier; /* state of the authentication, which precedes the E2E check */
#endif
} sw_receiver;

typedef struct {
    uint8_t mode;   /* sw_operating_mode */
    uint8_t reason; /* SW_REASON_ */
    uint8_t enable_request;
    uint32_t misses; /* consecutive periods without usable pressures */
    uint32_t good;   /* consecutive periods with usable pressures */
    uint64_t lost;   /* one bit for each of the latest SW_LOSS_WINDOW periods, 1 if lost; bit 0: newest period */
} sw_fail_safe;

typedef struct {
    uint8_t has_step;
    uint8_t fault; /* SW_REASON_, or SW_REASON_NONE */
    uint32_t off_time; /* one bit per step, 1 if it was early or late; bit 0: latest step */
    int64_t step_ns;
    int64_t lag_ns;
    int64_t skipped;
} sw_timing;

#if SW_PAST > 0
/* The rows of the latest control periods and their speeds. The last `count` rows have data; the other rows are zero. */
typedef struct {
    uint32_t count;
    double rows[SW_PAST][SW_COLUMNS]; /* rows as in the window, each made dimensionless with its period's speed */
    double speeds[SW_PAST];           /* speed of each row, divided by the design speed */
} sw_past;

#if SW_AIR_SPEED
/* The estimate of the air speed. */
typedef struct {
    uint32_t driven;               /* periods under control, up to SW_AIR_FIRST_PERIOD */
    double correction;             /* speed in use divided by the speed on the bus */
    double means[SW_AIR_FEATURES]; /* running means of the features */
} sw_air_speed;
#endif

/* The vehicle's speed through the air. */
typedef struct {
    sw_receiver receiver; /* receiver of VehicleSpeed */
    uint8_t known;        /* whether the latest accepted speed is not too old */
    uint8_t is_off;       /* whether the speed left the range by more than the margin and has not returned */
    double ratio;         /* speed divided by the design speed; 0 if unknown */
    double density;       /* density of the air in kg/m3, from the same frame */
    int64_t measured_ns;
#if SW_AIR_SPEED
    sw_air_speed air;
#endif
} sw_speed_state;
#endif

typedef struct {
    uint32_t rows; /* number of the window's rows with data; these are the newest rows */
    uint32_t gap;  /* consecutive periods without pressures */
    double window[SW_WINDOW][SW_COLUMNS];
    float plan[SW_HORIZON];
    uint32_t frozen; /* number of a plan's actions that are in transit to a delayed actuator */
    double under_way[SW_HORIZON]; /* the latest `frozen` + 1 sent actions, oldest first; then zeros */
#if SW_PAST > 0
    sw_past past; /* past rows from which the window is resampled */
#endif
} sw_memory;

/* The state of the sensor check. In an array with SW_HYPOTHESES rows, each row belongs to a hypothesis. */
typedef struct {
    int8_t set_aside; /* number of the excluded sensor; -1 if none is excluded */
    uint8_t implausible;
    uint8_t judged;   /* whether `residual` has values */
    uint8_t has_read; /* whether `readings` has values */
    uint32_t doubt;
    uint32_t flat[SW_SENSORS];
    double readings[SW_SENSORS];
    double residual[SW_HYPOTHESES][SW_SENSORS];
    double fast[SW_HYPOTHESES][SW_SENSORS];
    double slow[SW_HYPOTHESES][SW_SENSORS];
    double noise[SW_HYPOTHESES][SW_SENSORS];
    double score[SW_HYPOTHESES][SW_SENSORS];
    double estimates[SW_KEPT][SW_SENSORS]; /* estimates from the other sensors' pressures in the latest periods */
} sw_sensors;

/* The state of the benefit check; suction and swing are divided by their values in the release's wake without jets. */
typedef struct {
    uint32_t waking; /* number of periods with shut jets that are still needed until the wake has recovered */
    uint32_t rested; /* number of measured periods without control, outside tests; counts up to SW_PROVEN_PERIODS */
    uint32_t driven; /* number of measured periods under control; counts up to SW_FIRST_PERIOD */
    uint32_t doubt;
    uint32_t spent; /* periods in tests minus periods in which control helped, from 0 to SW_PATIENCE */
    double resting_suction;
    double resting_swing;
    double suction;
    double swing;
    double tested_at; /* speed / design speed at the beginning of the test; 0 if no test runs */
} sw_benefit;

/* The detection of another ECU on the bus. */
typedef struct {
    uint8_t is_there;
    uint32_t frames;  /* number of the other ECU's frames so far */
    int64_t until_ns; /* time from which the other ECU counts as gone if it sends no further frame */
} sw_other_ecu;

/* The whole state from one control period to the next. */
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
    uint8_t command_counter; /* counter of the next JetCommand */
    uint8_t status_counter;
    uint8_t has_pressures;    /* whether usable pressures have arrived */
    uint8_t pressure_counter; /* counter of the frame with the latest usable pressures */
    int64_t pressure_ns;      /* time at which the latest usable pressures were sampled */
    uint32_t overruns;        /* number of skipped periods */
    uint32_t missed;          /* number of steps without usable pressures */
    sw_bus_health health;
#if SW_SECOC
    sw_freshness freshness; /* freshness of the next JetCommand and the next EcuStatus */
#endif
} sw_ecu_state;

/* The parameters of a release that belong neither to its controller nor to its sensor estimator; read in place. */
typedef struct {
    double fast_deviation[SW_SENSORS][SW_SENSORS]; /* [j][i]: rms in Cp of healthy sensor i's residual, j left out */
    double slow_deviation[SW_SENSORS][SW_SENSORS]; /* as fast_deviation, for the slow means of the residuals */
    double resting[SW_RESTING_SPEEDS][3]; /* wake without jets: speed / design speed, base Cp, swing (Cp) */
    double slowest;                       /* lowest speed in the release's range, divided by the design speed */
    double fastest;
    double design_speed;     /* in m/s */
    double design_density;   /* density of the air, in kg/m3 */
    float weights[SW_TERMS]; /* weights of the cost terms */
    float air_speed[SW_AIR_WEIGHTS]; /* weights of the air-speed estimate; one 0 if there is no estimate */
    uint32_t bundle_hash;    /* the first 32 bits of the release's digest */
    uint8_t base[SW_BASES];  /* sensors on the base */
    uint8_t pairs[SW_MIRRORED_PAIRS][2]; /* pairs of mirrored sensors */
    uint8_t reserved[SW_RELEASE_RESERVED];
} sw_release;

/* The addresses of all parameters of a release: compiled in, or in an image on flash (sw_image.h). */
typedef struct {
    sw_program program;
    const sw_release *release;
#if SW_SENSOR_CHECK
    const struct sw_estimator_weights *estimator;
#endif
} sw_numbers;

/* The values of a release that may be changed on the vehicle, in the layout of UDS and XCP. */
typedef struct {
    float weights[SW_TERMS]; /* weights of the cost terms */
    float action_limit;      /* largest magnitude of an action, in the plan and after the gate, in U_inf W */
    float command_step;      /* largest change of a command in a control period, in U_inf W */
    uint32_t delay_steps;    /* compensated delay of the actuator, in control periods */
} sw_calibration;

#if SW_SECOC
/* The data that a node needs to use the bus key in one power cycle. */
typedef struct {
    uint8_t key[SW_AES_BYTES];
    uint32_t trip;           /* number of power cycles, including this one; already counted in non-volatile memory */
    uint64_t heard_pressure; /* last stored freshness value of a Pressure accepted in an earlier power cycle, or 0 */
    uint64_t heard_speed;    /* the same for a VehicleSpeed; used only if the release needs the speed */
} sw_authentication;
#endif

/* Bounds of the command gate, in m2/s. */
typedef struct {
    double flow_m2_per_s;
    double step_m2_per_s;
} sw_gate_limits;

/* The record of the latest step, for observers. */
typedef struct {
    double action; /* sent action, in U_inf W */
    uint8_t interventions;
    uint8_t planned; /* whether `output` is from this step; its actions are relative to the present speed */
} sw_trace;

/* Scratch memory of parts that never run at the same time. */
typedef union {
#if SW_SENSOR_CHECK
    sw_estimator_work estimator;
#endif
    sw_workspace control;
} sw_ecu_work;

typedef struct {
    sw_ecu_state state; /* the part that is saved and compared as bytes; sw_ecu_restore restores it */
    sw_surroundings surroundings;
    sw_calibration calibration; /* values in force; only sw_ecu_calibrate changes these values */
    sw_gate_limits limits;      /* bounds of the gate that follow from the calibration */
    uint8_t unfit;              /* SW_REASON_ for which the jets stay shut until the next init, or SW_REASON_NONE */
    sw_trace trace;
    sw_input input;
    sw_output output;
#if SW_SECOC
    sw_secoc secoc; /* set by sw_ecu_authenticate; not part of a saved state */
#endif
    sw_ecu_work work;
    sw_numbers numbers; /* parameters of the running release; set by sw_ecu_init and sw_ecu_init_of */
} sw_ecu;

#endif
