/* The front end of the plant's FMU. The front end is in C, and the plant's model is in Python. The front end checks the
 * order of calls, references, numbers and times. It passes only valid calls to pythonfmu3's binary in the same folder,
 * where every error in Python is fatal.
 */
#define _GNU_SOURCE /* for dladdr */
#include <dlfcn.h>
#include <stdlib.h>
#include <string.h>

#include "sw_fmi3_calls.h"
#include "sw_plant_settings.h"

#define BEHIND "pythonfmu.so"
#define TIME 0u

/* The functions of pythonfmu3's binary, with their names from the FMI standard. */
#define FUNCTIONS(OF)                                                                                                     \
    OF(fmi3Instance, InstantiateCoSimulation, fmi3String, fmi3String, fmi3String, fmi3Boolean, fmi3Boolean, fmi3Boolean,  \
       fmi3Boolean, const fmi3ValueReference[], size_t, fmi3InstanceEnvironment, fmi3LogMessageCallback,                  \
       fmi3IntermediateUpdateCallback)                                                                                    \
    OF(void, FreeInstance, fmi3Instance)                                                                                  \
    OF(fmi3Status, EnterInitializationMode, fmi3Instance, fmi3Boolean, fmi3Float64, fmi3Float64, fmi3Boolean,             \
       fmi3Float64)                                                                                                       \
    OF(fmi3Status, ExitInitializationMode, fmi3Instance)                                                                  \
    OF(fmi3Status, Terminate, fmi3Instance)                                                                               \
    OF(fmi3Status, Reset, fmi3Instance)                                                                                   \
    OF(fmi3Status, DoStep, fmi3Instance, fmi3Float64, fmi3Float64, fmi3Boolean, fmi3Boolean *, fmi3Boolean *,             \
       fmi3Boolean *, fmi3Float64 *)                                                                                      \
    OF(fmi3Status, GetFloat64, fmi3Instance, const fmi3ValueReference[], size_t, fmi3Float64[], size_t)                   \
    OF(fmi3Status, SetFloat64, fmi3Instance, const fmi3ValueReference[], size_t, const fmi3Float64[], size_t)             \
    OF(fmi3Status, GetFMUState, fmi3Instance, fmi3FMUState *)                                                             \
    OF(fmi3Status, SetFMUState, fmi3Instance, fmi3FMUState)                                                               \
    OF(fmi3Status, FreeFMUState, fmi3Instance, fmi3FMUState *)

#define MEMBER(ANSWER, NAME, ...) ANSWER (*NAME)(__VA_ARGS__);
typedef struct {
    FUNCTIONS(MEMBER)
} functions;

typedef struct {
    double time;
    uint32_t mode;
} memory;

typedef struct {
    memory kept;
    fmu_logger logger;
    void *library;
    functions call;
    fmi3Instance plant;
} instance;

typedef struct {
    memory kept;
    fmi3FMUState plant;
} saved;

/* Loads pythonfmu3's binary from the same folder; returns NULL on failure. */
static void *beside(void)
{
    Dl_info own;
    if (dladdr((void *)(uintptr_t)&beside, &own) == 0) return NULL;
    const char *last = strrchr(own.dli_fname, '/');
    const size_t folder = last == NULL ? 0 : (size_t)(last - own.dli_fname) + 1;
    char *path = malloc(folder + sizeof BEHIND);
    if (path == NULL) return NULL;
    (void)memcpy(path, own.dli_fname, folder);
    (void)memcpy(path + folder, BEHIND, sizeof BEHIND);
    void *library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    free(path);
    return library;
}

#define LOOK_UP(ANSWER, NAME, ...)                              \
    *(void **)&found->call.NAME = dlsym(library, "fmi3" #NAME); \
    if (found->call.NAME == NULL) return 0;

static int looked_up(instance *found, void *library)
{
    FUNCTIONS(LOOK_UP)
    return 1;
}

SW_EXPORT fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources,
                                                   fmi3Boolean visible, fmi3Boolean logging, fmi3Boolean event_mode,
                                                   fmi3Boolean early_return, const fmi3ValueReference intermediate[],
                                                   size_t count, fmi3InstanceEnvironment environment,
                                                   fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update)
{
    const fmu_logger logger = {environment, log};
    const fmi3String wrong = fmu_wrong_instance(token, SW_PLANT_TOKEN, event_mode);
    if (wrong != NULL) {
        (void)fmu_refused(&logger, wrong);
        return NULL;
    }
    instance *found = calloc(1, sizeof *found);
    if (found == NULL) return NULL;
    found->logger = logger;
    found->kept.mode = INSTANTIATED;
    found->library = beside();
    if (found->library != NULL && looked_up(found, found->library)) {
        found->plant = found->call.InstantiateCoSimulation(name, token, resources, visible, logging, event_mode, early_return,
                                                           intermediate, count, environment, log, update);
    } else {
        (void)fmu_refused(&logger, "the binary of pythonfmu3 beside this one does not load: is this program a Python?");
    }
    if (found->plant != NULL) return found;
    free(found);
    return NULL;
}

SW_EXPORT void fmi3FreeInstance(fmi3Instance fmu)
{
    instance *found = fmu;
    if (found == NULL) return;
    found->call.FreeInstance(found->plant);
    free(found);
}

/* Enters the mode that follows a call, unless the call failed. */
static fmi3Status led_to(instance *found, fmi3Status status, uint32_t mode)
{
    if (status <= fmi3Warning) found->kept.mode = mode;
    return status;
}

SW_EXPORT fmi3Status fmi3EnterInitializationMode(fmi3Instance fmu, fmi3Boolean has_tolerance, fmi3Float64 tolerance,
                                                 fmi3Float64 start, fmi3Boolean has_stop, fmi3Float64 stop)
{
    instance *found = fmu;
    const fmi3String wrong = fmu_wrong_times(start, has_stop, stop);
    FMU_ONLY_IN(INSTANTIATED, "EnterInitializationMode", "once, and after fmi3Reset");
    if (wrong != NULL) return fmu_refused(&found->logger, wrong);
    found->kept.time = start;
    return led_to(found, found->call.EnterInitializationMode(found->plant, has_tolerance, tolerance, start, has_stop, stop),
                  INITIALISING);
}

SW_EXPORT fmi3Status fmi3ExitInitializationMode(fmi3Instance fmu)
{
    instance *found = fmu;
    FMU_ONLY_IN(INITIALISING, "ExitInitializationMode", "after fmi3EnterInitializationMode");
    return led_to(found, found->call.ExitInitializationMode(found->plant), STEPPING);
}

SW_EXPORT fmi3Status fmi3Terminate(fmi3Instance fmu)
{
    instance *found = fmu;
    FMU_ONLY_IN(STEPPING, "Terminate", "once, after fmi3ExitInitializationMode");
    return led_to(found, found->call.Terminate(found->plant), TERMINATED);
}

SW_EXPORT fmi3Status fmi3Reset(fmi3Instance fmu)
{
    instance *found = fmu;
    if (found == NULL) return fmi3Error;
    found->kept.time = 0.0;
    return led_to(found, found->call.Reset(found->plant), INSTANTIATED);
}

SW_EXPORT fmi3Status fmi3DoStep(fmi3Instance fmu, fmi3Float64 point, fmi3Float64 size, fmi3Boolean no_earlier_state,
                                fmi3Boolean *event, fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *reached)
{
    instance *found = fmu;
    FMU_ONLY_IN(STEPPING, "DoStep", "after fmi3ExitInitializationMode, and not after fmi3Terminate");
    const fmi3String wrong = fmu_wrong_step(found->kept.time, point, size);
    *event = false;
    *terminate = false;
    *early = false;
    *reached = found->kept.time;
    if (wrong != NULL) return fmu_refused(&found->logger, wrong);
    const fmi3Status status =
        found->call.DoStep(found->plant, point, size, no_earlier_state, event, terminate, early, reached);
    *reached = found->kept.time;
    if (status > fmi3Warning) return status;
    found->kept.time = point + size;
    *reached = found->kept.time;
    return status;
}

/* --- Variables: all are floats --- */

SW_EXPORT fmi3Status fmi3GetFloat64(fmi3Instance fmu, const fmi3ValueReference references[], size_t count,
                                    fmi3Float64 values[], size_t size)
{
    const instance *found = fmu;
    FMU_ONLY_IN(INSTANTIATED | INITIALISING | STEPPING | TERMINATED, "GetFloat64", "of an instance");
    FMU_ONE_EACH("GetFloat64");
    for (size_t i = 0; i < count; i++) {
        if (references[i] >= SW_PLANT_VARIABLES) {
            return fmu_refused(&found->logger, "fmi3GetFloat64: a value reference is of no such variable");
        }
    }
    const fmi3Status status = found->call.GetFloat64(found->plant, references, count, values, size);
    for (size_t i = 0; i < count; i++) {
        if (references[i] == TIME) values[i] = found->kept.time;
    }
    return status;
}

SW_EXPORT fmi3Status fmi3SetFloat64(fmi3Instance fmu, const fmi3ValueReference references[], size_t count,
                                    const fmi3Float64 values[], size_t size)
{
    const instance *found = fmu;
    FMU_ONLY_IN(INSTANTIATED | INITIALISING | STEPPING, "SetFloat64", "before fmi3Terminate");
    FMU_ONE_EACH("SetFloat64");
    for (size_t i = 0; i < count; i++) {
        if (references[i] < SW_PLANT_FIRST_INPUT || references[i] > SW_PLANT_LAST_INPUT) {
            return fmu_refused(&found->logger, "fmi3SetFloat64: a value reference is of no such input");
        }
        if (!fmu_is_number(values[i])) return fmu_refused(&found->logger, "fmi3SetFloat64: a value is not a finite number");
    }
    return found->call.SetFloat64(found->plant, references, count, values, size);
}

#define NONE_GOT_OR_SET(NAME)                         \
    FMU_NONE_OF(Get##NAME, fmi3##NAME values[], size_t size) \
    FMU_NONE_OF(Set##NAME, const fmi3##NAME values[], size_t size)

NONE_GOT_OR_SET(Float32)
NONE_GOT_OR_SET(Int8)
NONE_GOT_OR_SET(UInt8)
NONE_GOT_OR_SET(Int16)
NONE_GOT_OR_SET(UInt16)
NONE_GOT_OR_SET(Int32)
NONE_GOT_OR_SET(UInt32)
NONE_GOT_OR_SET(Int64)
NONE_GOT_OR_SET(UInt64)
NONE_GOT_OR_SET(Boolean)

/* --- States, which are saved only in memory --- */

SW_EXPORT fmi3Status fmi3GetFMUState(fmi3Instance fmu, fmi3FMUState *state)
{
    const instance *found = fmu;
    saved *place = *state == NULL ? calloc(1, sizeof *place) : *state;
    if (place == NULL) return fmu_refused(&found->logger, "fmi3GetFMUState: no memory for another state");
    if (place->plant != NULL) (void)found->call.FreeFMUState(found->plant, &place->plant);
    place->kept = found->kept;
    *state = place;
    return found->call.GetFMUState(found->plant, &place->plant);
}

SW_EXPORT fmi3Status fmi3SetFMUState(fmi3Instance fmu, fmi3FMUState state)
{
    instance *found = fmu;
    const saved *from = state;
    if (from == NULL) return fmu_refused(&found->logger, "fmi3SetFMUState: this is no state of this FMU");
    const fmi3Status status = found->call.SetFMUState(found->plant, from->plant);
    if (status <= fmi3Warning) found->kept = from->kept;
    return status;
}

SW_EXPORT fmi3Status fmi3FreeFMUState(fmi3Instance fmu, fmi3FMUState *state)
{
    const instance *found = fmu;
    saved *place = *state;
    fmi3Status status = fmi3OK;
    if (place == NULL) return status;
    if (place->plant != NULL) status = found->call.FreeFMUState(found->plant, &place->plant);
    free(place);
    *state = NULL;
    return status;
}

FMU_REFUSED(SerializedFMUStateSize, fmi3Instance fmu, fmi3FMUState state, size_t *size)
FMU_REFUSED(SerializeFMUState, fmi3Instance fmu, fmi3FMUState state, fmi3Byte bytes[], size_t size)
FMU_REFUSED(DeserializeFMUState, fmi3Instance fmu, const fmi3Byte bytes[], size_t size, fmi3FMUState *state)
