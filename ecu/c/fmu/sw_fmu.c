/* The ECU as an FMU for co-simulation, FMI 3.0.
 *
 * Inside, a vehicle sends its pressures and its speed as protected frames, and reads the ECU's frames. The ECU receives
 * nothing but these messages, and it is the ECU of sw_ecu.h, bit for bit. It steps at start, start + period, and so on,
 * with the inputs of that time; a communication step of any length includes the steps that begin in it.
 *
 * This file is for a computer, not for a vehicle: the standard requires an FMU to allocate its instances and saved
 * states.
 */
#include <stdlib.h>
#include <string.h>

#include "sw_codec_bytes.h"
#include "sw_ecu.h"
#include "sw_fmi3_calls.h"
#include "sw_fmu_settings.h"

#define ALIGNMENT 64u /* largest alignment of the ECU's workspace */

typedef enum { FLOAT32, FLOAT64, INT8, UINT8, INT16, UINT16, INT32, UINT32, INT64, UINT64, BOOLEAN } kind;
enum { NO_MESSAGE, PRESSURE, SPEED, COMMAND, STATUS };

/* A variable, and its signal in the DBC. */
typedef struct {
    kind type; /* type of its get and set functions */
    int is_input;
    double first; /* value at the start */
    int message;
    int start; /* first bit */
    int bits;
    int is_signed;
    double scale;
} variable;

static const variable variables[SW_FMU_VARIABLES] = SW_FMU_TABLE;

/* The wrapper's memory; the ECU has its own. */
typedef struct {
    double values[SW_FMU_VARIABLES]; /* by value reference; 0 is the time */
    double start;
    int64_t next_ns; /* time of the ECU's next step, from the start on */
    uint32_t mode;   /* mode in FMI's state machine */
    uint8_t pressure_counter;
    uint8_t speed_counter;
} memory;

typedef struct {
    sw_ecu ecu; /* the first member, because of its alignment */
    memory kept;
    fmu_logger logger;
    void *room; /* address of the allocation */
} instance;

/* A saved state, equal in memory and as bytes. */
typedef struct {
    char token[sizeof SW_FMU_TOKEN]; /* token of the FMU that saved it */
    memory kept;
    sw_ecu_state ecu;
} saved;

/* Powers the ECU on; returns the result of sw_ecu_init. */
static int power_on(instance *fmu)
{
    (void)memset(&fmu->kept, 0, sizeof fmu->kept);
    for (int i = 0; i < SW_FMU_VARIABLES; i++) fmu->kept.values[i] = variables[i].first;
    fmu->kept.mode = INSTANTIATED;
    return sw_ecu_init(&fmu->ecu);
}

/* --- Signals: bits count from the lowest bit of the first byte on, as in the DBC --- */

static void put(uint8_t *data, uint32_t reference, int32_t steps)
{
    const variable *signal = &variables[reference];
    for (int i = 0; i < signal->bits; i++) {
        const int bit = signal->start + i;
        data[bit / 8] |= (uint8_t)((((uint32_t)steps >> i) & 1u) << (bit % 8));
    }
}

static double taken(const uint8_t *data, const variable *signal)
{
    uint32_t steps = 0;
    for (int i = 0; i < signal->bits; i++) {
        const int bit = signal->start + i;
        steps |= (((uint32_t)data[bit / 8] >> (bit % 8)) & 1u) << i;
    }
    if (signal->is_signed) return (double)sw_signed(steps, UINT32_C(1) << (signal->bits - 1)) * signal->scale;
    return (double)steps * signal->scale;
}

/* Rounds to a whole number, half to even; returns `otherwise` for a number outside the bounds, or for NaN. */
static int32_t nearest(double value, int32_t least, int32_t most, int32_t otherwise)
{
    if (!(value > (double)least - 1.0 && value < (double)most + 1.0)) return otherwise;
    const int32_t whole = (int32_t)value;
    const double rest = value - (double)whole;
    const int is_odd = whole % 2 != 0;
    int32_t found = whole;
    if (rest > 0.5 || (rest >= 0.5 && is_odd)) found = whole + 1;
    if (rest < -0.5 || (rest <= -0.5 && is_odd)) found = whole - 1;
    return found >= least && found <= most ? found : otherwise;
}

/* Converts an age to units of its signal: to the nearest, but upwards in the classic set with its few values, so that
 * no age looks fresher. An age out of range, or NaN, becomes the last value.
 */
static int32_t age_steps(double seconds)
{
    const double most_ns = (double)SW_FMU_AGE_LIMIT * (double)SW_AGE_RESOLUTION_NS;
    if (!(seconds * 1e9 < most_ns)) return SW_FMU_AGE_LIMIT;
    if (seconds <= 0.0) return 0;
    const int64_t age_ns = (int64_t)(seconds * 1e9 + 0.5);
    const int64_t up = SW_FRAMES_FD ? SW_AGE_RESOLUTION_NS / 2 : SW_AGE_RESOLUTION_NS - 1;
    return (int32_t)((age_ns + up) / SW_AGE_RESOLUTION_NS);
}

/* --- The vehicle's frames --- */

static void start_frame(sw_frame *frame, uint32_t id, int length, int64_t now_ns)
{
    (void)memset(frame, 0, sizeof *frame);
    frame->timestamp_ns = now_ns;
    frame->id = id;
    frame->is_fd = SW_FRAMES_FD;
    frame->length = (uint8_t)length;
}

static uint8_t next_counter(uint8_t counter) { return (uint8_t)((counter + 1u) % SW_E2E_COUNTERS); }

/* Writes the pressures. A pressure beyond a transducer's range is limited to its end and marked as invalid. */
static void write_pressures(memory *kept, sw_frame *frame)
{
    start_frame(frame, SW_PRESSURE_ID, SW_PRESSURE_BYTES, kept->next_ns);
    for (uint32_t i = 0; i < SW_SENSORS; i++) {
        const double steps = kept->values[SW_FMU_PRESSURE + i] / SW_PRESSURE_RESOLUTION_PA;
        const int32_t beyond = steps > 0.0 ? SW_FMU_PRESSURE_LIMIT : steps < 0.0 ? -SW_FMU_PRESSURE_LIMIT : 0;
        const int is_within = steps >= (double)-SW_FMU_PRESSURE_LIMIT && steps <= (double)SW_FMU_PRESSURE_LIMIT;
        const int is_valid = is_within && kept->values[SW_FMU_VALID + i] != 0.0;
        int32_t sent = nearest(steps, -SW_FMU_PRESSURE_LIMIT, SW_FMU_PRESSURE_LIMIT, beyond);
#if !SW_FRAMES_FD
        if (!is_valid) sent = SW_PRESSURE_INVALID;
#endif
        put(frame->data, SW_FMU_PRESSURE + i, sent);
        put(frame->data, SW_FMU_VALID + i, is_valid);
    }
    put(frame->data, SW_FMU_ENABLE_REQUEST, kept->values[SW_FMU_ENABLE_REQUEST] != 0.0);
    put(frame->data, SW_FMU_PRESSURE_AGE, age_steps(kept->values[SW_FMU_PRESSURE_AGE]));
    sw_e2e_protect(frame->data, SW_PRESSURE_BYTES, SW_PRESSURE_DATA_ID, kept->pressure_counter);
    kept->pressure_counter = next_counter(kept->pressure_counter);
}

/* Writes the speed. A speed or a density out of the signal's range is sent as unknown. */
static void write_speed(memory *kept, sw_frame *frame)
{
    const int32_t unknown = (int32_t)SW_SPEED_UNKNOWN;
    const double speed = kept->values[SW_FMU_VEHICLE_SPEED] / SW_SPEED_RESOLUTION;
    const double density = kept->values[SW_FMU_AIR_DENSITY] / SW_DENSITY_RESOLUTION;
    start_frame(frame, SW_SPEED_ID, SW_SPEED_BYTES, kept->next_ns);
    put(frame->data, SW_FMU_VEHICLE_SPEED, nearest(speed, 0, unknown - 1, unknown));
    put(frame->data, SW_FMU_AIR_DENSITY, nearest(density, 1, 255, 0));
    sw_e2e_protect(frame->data, SW_SPEED_BYTES, SW_SPEED_DATA_ID, kept->speed_counter);
    kept->speed_counter = next_counter(kept->speed_counter);
}

static void read_frame(memory *kept, const sw_frame *frame)
{
    const int message = frame->id == SW_COMMAND_ID ? COMMAND : STATUS;
    for (int i = 0; i < SW_FMU_VARIABLES; i++) {
        if (variables[i].message == message) kept->values[i] = taken(frame->data, &variables[i]);
    }
}

/* Runs one control period of the ECU with the present inputs. */
static void step(instance *fmu)
{
    memory *kept = &fmu->kept;
    sw_frame sent[2], answers[SW_FRAMES_OUT];
    int count = 0;
    if (kept->values[SW_FMU_SEND_PRESSURES] != 0.0) write_pressures(kept, &sent[count++]);
    if (kept->values[SW_FMU_SEND_SPEED] != 0.0) write_speed(kept, &sent[count++]);
    const int answered = sw_ecu_step(&fmu->ecu, kept->next_ns, sent, count, answers);
    for (int i = 0; i < answered; i++) read_frame(kept, &answers[i]);
    kept->next_ns += SW_PERIOD_NS;
}

/* --- Instances --- */

SW_EXPORT fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources,
                                                   fmi3Boolean visible, fmi3Boolean logging, fmi3Boolean event_mode,
                                                   fmi3Boolean early_return, const fmi3ValueReference intermediate[],
                                                   size_t count, fmi3InstanceEnvironment environment,
                                                   fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update)
{
    const fmu_logger logger = {environment, log};
    const fmi3String wrong = fmu_wrong_instance(token, SW_FMU_TOKEN, event_mode);
    if (wrong != NULL) {
        (void)fmu_refused(&logger, wrong);
        return NULL;
    }
    char *room = calloc(1, sizeof(instance) + ALIGNMENT);
    if (room == NULL) return NULL;
    instance *fmu = (instance *)(void *)(room + (ALIGNMENT - (uintptr_t)room % ALIGNMENT));
    fmu->logger = logger;
    fmu->room = room;
    if (power_on(fmu) == SW_REASON_NONE) return fmu;
    (void)fmu_refused(&logger, "this process's floating-point mode, or the build, changes arithmetic that the ECU rests on");
    free(room);
    return NULL;
}

SW_EXPORT void fmi3FreeInstance(fmi3Instance fmu)
{
    if (fmu != NULL) free(((instance *)fmu)->room);
}

SW_EXPORT fmi3Status fmi3EnterInitializationMode(fmi3Instance fmu, fmi3Boolean has_tolerance, fmi3Float64 tolerance,
                                                 fmi3Float64 start, fmi3Boolean has_stop, fmi3Float64 stop)
{
    instance *found = fmu;
    const fmi3String wrong = fmu_wrong_times(start, has_stop, stop);
    FMU_ONLY_IN(INSTANTIATED, "EnterInitializationMode", "once, and after fmi3Reset");
    if (wrong != NULL) return fmu_refused(&found->logger, wrong);
    found->kept.start = start;
    found->kept.values[0] = start;
    found->kept.mode = INITIALISING;
    return fmi3OK;
}

SW_EXPORT fmi3Status fmi3ExitInitializationMode(fmi3Instance fmu)
{
    instance *found = fmu;
    FMU_ONLY_IN(INITIALISING, "ExitInitializationMode", "after fmi3EnterInitializationMode");
    found->kept.mode = STEPPING;
    return fmi3OK;
}

SW_EXPORT fmi3Status fmi3Terminate(fmi3Instance fmu)
{
    instance *found = fmu;
    FMU_ONLY_IN(STEPPING, "Terminate", "once, after fmi3ExitInitializationMode");
    found->kept.mode = TERMINATED;
    return fmi3OK;
}

SW_EXPORT fmi3Status fmi3Reset(fmi3Instance fmu)
{
    if (fmu == NULL) return fmi3Error;
    (void)power_on(fmu); /* if it refuses, each step returns a reason */
    return fmi3OK;
}

SW_EXPORT fmi3Status fmi3DoStep(fmi3Instance fmu, fmi3Float64 point, fmi3Float64 size, fmi3Boolean no_earlier_state,
                                fmi3Boolean *event, fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *reached)
{
    instance *found = fmu;
    FMU_ONLY_IN(STEPPING, "DoStep", "after fmi3ExitInitializationMode, and not after fmi3Terminate");
    memory *kept = &found->kept;
    const fmi3String wrong = fmu_wrong_step(kept->values[0], point, size);
    const double until_ns = (point + size - kept->start) * 1e9;
    *event = false;
    *terminate = false;
    *early = false;
    *reached = kept->values[0];
    if (wrong != NULL) return fmu_refused(&found->logger, wrong);
    if (!(until_ns < (double)SW_LATEST_NS)) {
        return fmu_refused(&found->logger, "communicationStepSize: must end within 73 years of the start");
    }
    /* A period that begins with the next communication step, within a microsecond, belongs to that step. */
    while ((double)kept->next_ns < until_ns - 1e3) step(found);
    kept->values[0] = point + size;
    *reached = kept->values[0];
    return fmi3OK;
}

/* --- Variables --- */

#define ACCESS(NAME, KIND)                                                                                            \
    SW_EXPORT fmi3Status fmi3Get##NAME(fmi3Instance fmu, const fmi3ValueReference references[], size_t count,         \
                                       fmi3##NAME values[], size_t size)                                              \
    {                                                                                                                 \
        const instance *found = fmu;                                                                                  \
        FMU_ONLY_IN(INSTANTIATED | INITIALISING | STEPPING | TERMINATED, "Get" #NAME, "of an instance");              \
        FMU_ONE_EACH("Get" #NAME);                                                                                    \
        for (size_t i = 0; i < count; i++) {                                                                          \
            if (references[i] >= SW_FMU_VARIABLES || variables[references[i]].type != KIND) {                         \
                return fmu_refused(&found->logger, "fmi3Get" #NAME ": a value reference is of no such variable");     \
            }                                                                                                         \
        }                                                                                                             \
        for (size_t i = 0; i < count; i++) values[i] = (fmi3##NAME)found->kept.values[references[i]];                 \
        return fmi3OK;                                                                                                \
    }                                                                                                                 \
    SW_EXPORT fmi3Status fmi3Set##NAME(fmi3Instance fmu, const fmi3ValueReference references[], size_t count,         \
                                       const fmi3##NAME values[], size_t size)                                        \
    {                                                                                                                 \
        instance *found = fmu;                                                                                        \
        FMU_ONLY_IN(INSTANTIATED | INITIALISING | STEPPING, "Set" #NAME, "before fmi3Terminate");                     \
        FMU_ONE_EACH("Set" #NAME);                                                                                    \
        for (size_t i = 0; i < count; i++) {                                                                          \
            const uint32_t reference = references[i];                                                                 \
            if (reference >= SW_FMU_VARIABLES || variables[reference].type != KIND ||                                 \
                !variables[reference].is_input) {                                                                     \
                return fmu_refused(&found->logger, "fmi3Set" #NAME ": a value reference is of no such input");        \
            }                                                                                                         \
            if (!fmu_is_number((double)values[i])) {                                                                  \
                return fmu_refused(&found->logger, "fmi3Set" #NAME ": a value is not a finite number");               \
            }                                                                                                         \
        }                                                                                                             \
        for (size_t i = 0; i < count; i++) found->kept.values[references[i]] = (double)values[i];                     \
        return fmi3OK;                                                                                                \
    }

ACCESS(Float32, FLOAT32)
ACCESS(Float64, FLOAT64)
ACCESS(Int8, INT8)
ACCESS(UInt8, UINT8)
ACCESS(Int16, INT16)
ACCESS(UInt16, UINT16)
ACCESS(Int32, INT32)
ACCESS(UInt32, UINT32)
ACCESS(Int64, INT64)
ACCESS(UInt64, UINT64)
ACCESS(Boolean, BOOLEAN)

/* --- States --- */

SW_EXPORT fmi3Status fmi3GetFMUState(fmi3Instance fmu, fmi3FMUState *state)
{
    const instance *found = fmu;
    saved *place = *state == NULL ? calloc(1, sizeof *place) : *state;
    if (place == NULL) return fmu_refused(&found->logger, "fmi3GetFMUState: no memory for another state");
    (void)memcpy(place->token, SW_FMU_TOKEN, sizeof place->token);
    (void)memcpy(&place->kept, &found->kept, sizeof place->kept);
    (void)memcpy(&place->ecu, &found->ecu.state, sizeof place->ecu);
    *state = place;
    return fmi3OK;
}

SW_EXPORT fmi3Status fmi3SetFMUState(fmi3Instance fmu, fmi3FMUState state)
{
    instance *found = fmu;
    const saved *from = state;
    const memory *kept = &from->kept;
    const int is_timed = kept->next_ns >= 0 && kept->next_ns <= SW_LATEST_NS && fmu_is_number(kept->values[0]) &&
                         fmu_wrong_times(kept->start, false, 0.0) == NULL;
    const int is_a_mode = kept->mode == INSTANTIATED || kept->mode == INITIALISING || kept->mode == STEPPING ||
                          kept->mode == TERMINATED;
    if (memcmp(from->token, SW_FMU_TOKEN, sizeof from->token) != 0 || !is_timed || !is_a_mode ||
        sw_ecu_restore(&found->ecu, &from->ecu) != 0) {
        return fmu_refused(&found->logger, "fmi3SetFMUState: this is no state of this FMU");
    }
    (void)memcpy(&found->kept, kept, sizeof *kept);
    return fmi3OK;
}

SW_EXPORT fmi3Status fmi3FreeFMUState(fmi3Instance fmu, fmi3FMUState *state)
{
    free(*state);
    *state = NULL;
    return fmi3OK;
}

SW_EXPORT fmi3Status fmi3SerializedFMUStateSize(fmi3Instance fmu, fmi3FMUState state, size_t *size)
{
    *size = sizeof(saved);
    return fmi3OK;
}

SW_EXPORT fmi3Status fmi3SerializeFMUState(fmi3Instance fmu, fmi3FMUState state, fmi3Byte bytes[], size_t size)
{
    const instance *found = fmu;
    if (size < sizeof(saved)) {
        return fmu_refused(&found->logger, "fmi3SerializeFMUState: less room than fmi3SerializedFMUStateSize");
    }
    (void)memcpy(bytes, state, sizeof(saved));
    return fmi3OK;
}

SW_EXPORT fmi3Status fmi3DeserializeFMUState(fmi3Instance fmu, const fmi3Byte bytes[], size_t size, fmi3FMUState *state)
{
    const instance *found = fmu;
    if (size != sizeof(saved)) {
        return fmu_refused(&found->logger, "fmi3DeserializeFMUState: these bytes are no state of this FMU");
    }
    saved *place = *state == NULL ? malloc(sizeof *place) : *state;
    if (place == NULL) return fmu_refused(&found->logger, "fmi3DeserializeFMUState: no memory for another state");
    (void)memcpy(place, bytes, sizeof *place);
    *state = place;
    return fmi3OK;
}
