/* The ECU as an FMU for co-simulation, FMI 3.0.
 *
 * The FMU contains the ECU of sw_ecu.h, unchanged. The ECU receives only frames. The frames come from a bus terminal,
 * or from a simulated vehicle inside the FMU. With the simulated vehicle, the FMU's inputs are pressures and speed, and
 * the ECU steps at start, start + period, and so on, with the inputs at the time of the step. A communication step of
 * any length includes the ECU's steps that begin in it.
 *
 * This file is for a computer, not a vehicle: the standard requires an FMU to allocate its instances and saved states.
 */
#include <stdlib.h>
#include <string.h>

#include "sw_codec_bytes.h"
#include "sw_fmu.h"

#define ALIGNMENT 64u /* largest alignment of the ECU's workspace */

const variable fmu_variables[SW_FMU_VARIABLES] = SW_FMU_TABLE;

/* A saved state. Its serialised form has the same bytes as the state in memory. */
typedef struct {
    char token[sizeof SW_FMU_TOKEN]; /* token of the FMU that saved this state */
    fmu_memory kept;
    sw_ecu_state ecu;
} saved;

/* Powers the ECU on; returns the result of sw_ecu_init. */
static int power_on(fmu_instance *fmu)
{
    (void)memset(&fmu->kept, 0, sizeof fmu->kept);
    for (int i = 0; i < SW_FMU_VARIABLES; i++) fmu->kept.values[i] = fmu_variables[i].first;
    fmu->kept.mode = INSTANTIATED;
    return sw_ecu_init(&fmu->ecu);
}

/* --- The ECU's steps --- */

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

static void read_frame(fmu_memory *kept, const sw_frame *frame)
{
    const int message = frame->id == SW_COMMAND_ID ? COMMAND : STATUS;
    for (int i = 0; i < SW_FMU_VARIABLES; i++) {
        if (fmu_variables[i].message == message) kept->values[i] = taken(frame->data, &fmu_variables[i]);
    }
}

/* Runs one control period of the ECU. */
static void step(fmu_instance *fmu)
{
    fmu_memory *kept = &fmu->kept;
    sw_frame received[FMU_MOST_FRAMES], answers[SW_FRAMES_OUT];
    const int count = fmu_received(kept, received, &fmu->ecu.surroundings);
    const int answered = sw_ecu_step(&fmu->ecu, kept->next_ns, received, count, answers);
    for (int i = 0; i < answered; i++) read_frame(kept, &answers[i]);
    fmu_sent(kept, answers, answered);
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
    const fmi3String wrong = fmu_wrong_instance(token, SW_FMU_TOKEN, event_mode && !SW_FMU_BUS);
    if (wrong != NULL) {
        (void)fmu_refused(&logger, wrong);
        return NULL;
    }
    char *room = calloc(1, sizeof(fmu_instance) + ALIGNMENT);
    if (room == NULL) return NULL;
    fmu_instance *fmu = (fmu_instance *)(void *)(room + (ALIGNMENT - (uintptr_t)room % ALIGNMENT));
    fmu->logger = logger;
    fmu->room = room;
    fmu->has_event_mode = event_mode;
    if (power_on(fmu) == SW_REASON_NONE) return fmu;
    (void)fmu_refused(&logger, "this process's floating-point mode, or the build, changes arithmetic that the ECU rests on");
    free(room);
    return NULL;
}

SW_EXPORT void fmi3FreeInstance(fmi3Instance fmu)
{
    if (fmu != NULL) free(((fmu_instance *)fmu)->room);
}

SW_EXPORT fmi3Status fmi3EnterInitializationMode(fmi3Instance fmu, fmi3Boolean has_tolerance, fmi3Float64 tolerance,
                                                 fmi3Float64 start, fmi3Boolean has_stop, fmi3Float64 stop)
{
    fmu_instance *found = fmu;
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
    fmu_instance *found = fmu;
    FMU_ONLY_IN(INITIALISING, "ExitInitializationMode", "after fmi3EnterInitializationMode");
    const fmi3String wrong = fmu_begun(&found->kept);
    if (wrong != NULL) return fmu_refused(&found->logger, wrong);
    found->kept.mode = found->has_event_mode ? EVENT : STEPPING;
    return fmi3OK;
}

SW_EXPORT fmi3Status fmi3Terminate(fmi3Instance fmu)
{
    fmu_instance *found = fmu;
    FMU_ONLY_IN(STEPPING | EVENT, "Terminate", "once, after fmi3ExitInitializationMode");
    found->kept.mode = TERMINATED;
    return fmi3OK;
}

SW_EXPORT fmi3Status fmi3Reset(fmi3Instance fmu)
{
    if (fmu == NULL) return fmi3Error;
    (void)power_on(fmu); /* if sw_ecu_init fails, every EcuStatus has the reason */
    return fmi3OK;
}

SW_EXPORT fmi3Status fmi3DoStep(fmi3Instance fmu, fmi3Float64 point, fmi3Float64 size, fmi3Boolean no_earlier_state,
                                fmi3Boolean *event, fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *reached)
{
    fmu_instance *found = fmu;
    FMU_ONLY_IN(STEPPING, "DoStep", "after fmi3ExitInitializationMode, and not after fmi3Terminate");
    fmu_memory *kept = &found->kept;
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
    while (fmu_is_due(kept, until_ns)) step(found);
    kept->values[0] = point + size;
    *event = fmu_reached(found, until_ns) != 0;
    *reached = kept->values[0];
    return fmi3OK;
}

/* --- Variables --- */

#define ACCESS(NAME, KIND)                                                                                            \
    SW_EXPORT fmi3Status fmi3Get##NAME(fmi3Instance fmu, const fmi3ValueReference references[], size_t count,         \
                                       fmi3##NAME values[], size_t size)                                              \
    {                                                                                                                 \
        const fmu_instance *found = fmu;                                                                                  \
        FMU_ONLY_IN(~0u, "Get" #NAME, "of an instance");              \
        FMU_ONE_EACH("Get" #NAME);                                                                                    \
        for (size_t i = 0; i < count; i++) {                                                                          \
            if (references[i] >= SW_FMU_VARIABLES || fmu_variables[references[i]].type != KIND) {                         \
                return fmu_refused(&found->logger, "fmi3Get" #NAME ": a value reference is of no such variable");     \
            }                                                                                                         \
        }                                                                                                             \
        for (size_t i = 0; i < count; i++) values[i] = (fmi3##NAME)found->kept.values[references[i]];                 \
        return fmi3OK;                                                                                                \
    }                                                                                                                 \
    SW_EXPORT fmi3Status fmi3Set##NAME(fmi3Instance fmu, const fmi3ValueReference references[], size_t count,         \
                                       const fmi3##NAME values[], size_t size)                                        \
    {                                                                                                                 \
        fmu_instance *found = fmu;                                                                                        \
        FMU_ONLY_IN(~TERMINATED, "Set" #NAME, "before fmi3Terminate");                     \
        FMU_ONE_EACH("Set" #NAME);                                                                                    \
        for (size_t i = 0; i < count; i++) {                                                                          \
            const uint32_t reference = references[i];                                                                 \
            if (reference >= SW_FMU_VARIABLES || fmu_variables[reference].type != KIND ||                                 \
                fmu_variables[reference].direction == OUTPUT) {                                                                     \
                return fmu_refused(&found->logger, "fmi3Set" #NAME ": a value reference is of no such input");        \
            }                                                                                                         \
            if (fmu_variables[reference].direction == PARAMETER && found->kept.mode > INITIALISING) {                 \
                return fmu_refused(&found->logger, "fmi3Set" #NAME ": a parameter is set before the first step");     \
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
    const fmu_instance *found = fmu;
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
    fmu_instance *found = fmu;
    const saved *from = state;
    if (from == NULL) return fmu_refused(&found->logger, "fmi3SetFMUState: this is no state of this FMU");
    const fmu_memory *kept = &from->kept;
    const int is_timed = kept->next_ns >= 0 && kept->next_ns <= SW_LATEST_NS && fmu_is_number(kept->values[0]) &&
                         fmu_wrong_times(kept->start, false, 0.0) == NULL;
    const int is_a_mode = kept->mode == INSTANTIATED || kept->mode == INITIALISING || kept->mode == STEPPING ||
                          kept->mode == TERMINATED || (kept->mode == EVENT && found->has_event_mode);
    if (memcmp(from->token, SW_FMU_TOKEN, sizeof from->token) != 0 || !is_timed || !is_a_mode || !fmu_is_possible(&kept->side) ||
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
    const fmu_instance *found = fmu;
    if (state == NULL || size < sizeof(saved)) {
        return fmu_refused(&found->logger, "fmi3SerializeFMUState: no state, or less than fmi3SerializedFMUStateSize");
    }
    (void)memcpy(bytes, state, sizeof(saved));
    return fmi3OK;
}

SW_EXPORT fmi3Status fmi3DeserializeFMUState(fmi3Instance fmu, const fmi3Byte bytes[], size_t size, fmi3FMUState *state)
{
    const fmu_instance *found = fmu;
    if (size != sizeof(saved)) {
        return fmu_refused(&found->logger, "fmi3DeserializeFMUState: these bytes are no state of this FMU");
    }
    saved *place = *state == NULL ? malloc(sizeof *place) : *state;
    if (place == NULL) return fmu_refused(&found->logger, "fmi3DeserializeFMUState: no memory for another state");
    (void)memcpy(place, bytes, sizeof *place);
    *state = place;
    return fmi3OK;
}
