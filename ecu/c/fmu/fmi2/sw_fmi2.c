/* The functions of FMI 2.0 for a co-simulation. They call the functions of FMI 3.0 in the same binary. The type Real
 * becomes Float64, and Integer becomes Int32; an FMU for FMI 2.0 has no variables of other integer types.
 */
#include <stdlib.h>
#include <string.h>

#include "sw_fmi3_calls.h"

typedef void *fmi2Component;
typedef void *fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer;
typedef int fmi2Boolean;
typedef const char *fmi2String;
typedef char fmi2Byte;
typedef fmi3Status fmi2Status; /* the numbers are as in FMI 2.0; fmi2Pending is never returned */
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;

typedef struct {
    void (*logger)(void *environment, fmi2String name, fmi2Status status, fmi2String category, fmi2String message, ...);
    void *(*allocate)(size_t count, size_t size);
    void (*release)(void *place);
    void (*finished)(void *environment, fmi2Status status);
    void *environment;
} fmi2CallbackFunctions;

typedef struct {
    fmi3Instance fmu;
    fmi2CallbackFunctions calls;
    char *name;
    double start;
    double stop;
    int has_stop;
} component;

/* The functions of this binary for FMI 3.0, which the functions for FMI 2.0 call. */
fmi3Instance fmi3InstantiateCoSimulation(fmi3String, fmi3String, fmi3String, fmi3Boolean, fmi3Boolean, fmi3Boolean,
                                         fmi3Boolean, const fmi3ValueReference[], size_t, fmi3InstanceEnvironment,
                                         fmi3LogMessageCallback, fmi3IntermediateUpdateCallback);
void fmi3FreeInstance(fmi3Instance);
fmi3Status fmi3EnterInitializationMode(fmi3Instance, fmi3Boolean, fmi3Float64, fmi3Float64, fmi3Boolean, fmi3Float64);
fmi3Status fmi3ExitInitializationMode(fmi3Instance);
fmi3Status fmi3Terminate(fmi3Instance);
fmi3Status fmi3Reset(fmi3Instance);
fmi3Status fmi3DoStep(fmi3Instance, fmi3Float64, fmi3Float64, fmi3Boolean, fmi3Boolean *, fmi3Boolean *, fmi3Boolean *,
                      fmi3Float64 *);
fmi3Status fmi3GetFloat64(fmi3Instance, const fmi3ValueReference[], size_t, fmi3Float64[], size_t);
fmi3Status fmi3SetFloat64(fmi3Instance, const fmi3ValueReference[], size_t, const fmi3Float64[], size_t);
fmi3Status fmi3GetInt32(fmi3Instance, const fmi3ValueReference[], size_t, fmi3Int32[], size_t);
fmi3Status fmi3SetInt32(fmi3Instance, const fmi3ValueReference[], size_t, const fmi3Int32[], size_t);
fmi3Status fmi3GetBoolean(fmi3Instance, const fmi3ValueReference[], size_t, fmi3Boolean[], size_t);
fmi3Status fmi3SetBoolean(fmi3Instance, const fmi3ValueReference[], size_t, const fmi3Boolean[], size_t);
fmi3Status fmi3GetFMUState(fmi3Instance, fmi3FMUState *);
fmi3Status fmi3SetFMUState(fmi3Instance, fmi3FMUState);
fmi3Status fmi3FreeFMUState(fmi3Instance, fmi3FMUState *);
fmi3Status fmi3SerializedFMUStateSize(fmi3Instance, fmi3FMUState, size_t *);
fmi3Status fmi3SerializeFMUState(fmi3Instance, fmi3FMUState, fmi3Byte[], size_t);
fmi3Status fmi3DeserializeFMUState(fmi3Instance, const fmi3Byte[], size_t, fmi3FMUState *);

/* Passes a message to the environment, with the prefix fmi2 instead of fmi3 in a function's name. */
static void pass_on(fmi3InstanceEnvironment environment, fmi3Status status, fmi3String category, fmi3String message)
{
    const component *to = environment;
    const int is_named = strncmp(message, "fmi3", 4) == 0;
    if (to->calls.logger == NULL) return;
    to->calls.logger(to->calls.environment, to->name, status, category, "%s%s", is_named ? "fmi2" : "",
                     is_named ? message + 4 : message);
}

static int hex_digit(char digit)
{
    const char *digits = "0123456789abcdef0123456789ABCDEF", *found = digit == '\0' ? NULL : strchr(digits, digit);
    return found == NULL ? -1 : (int)(found - digits) % 16;
}

/* Writes the path of a file's URI, and a slash after the path. `path` has room for the URI and two characters. */
static void write_path(char *path, const char *uri)
{
    if (strncmp(uri, "file:", 5) == 0) uri += 5;
    if (strncmp(uri, "//", 2) == 0) {
        const char *slash = strchr(uri + 2, '/');
        uri = slash == NULL ? "" : slash;
    }
    char *end = path;
    while (*uri != '\0') {
        const int high = *uri == '%' ? hex_digit(uri[1]) : -1, low = high >= 0 ? hex_digit(uri[2]) : -1;
        *end++ = low >= 0 ? (char)(16 * high + low) : *uri;
        uri += low >= 0 ? 3 : 1;
    }
    if (end == path || end[-1] != '/') *end++ = '/';
    *end = '\0';
}

SW_EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
SW_EXPORT const char *fmi2GetVersion(void) { return "2.0"; }

SW_EXPORT void fmi2FreeInstance(fmi2Component fmu)
{
    component *found = fmu;
    if (found == NULL) return;
    fmi3FreeInstance(found->fmu);
    free(found->name);
    free(found);
}

SW_EXPORT fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String token, fmi2String resources,
                                        const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging)
{
    const char *uri = resources == NULL ? "" : resources, *called = name == NULL ? "" : name;
    component *found = calloc(1, sizeof *found);
    char *path = malloc(strlen(uri) + 2);
    if (found != NULL) found->name = malloc(strlen(called) + 1);
    if (found != NULL && found->name != NULL && path != NULL) {
        (void)memcpy(found->name, called, strlen(called) + 1);
        write_path(path, uri);
        if (functions != NULL) found->calls = *functions;
        if (type == fmi2CoSimulation) {
            found->fmu = fmi3InstantiateCoSimulation(name, token, path, visible != 0, logging != 0, false, false, NULL, 0,
                                                     found, pass_on, NULL);
        } else {
            pass_on(found, fmi3Error, "logStatusError", "fmi3Instantiate: this FMU is for co-simulation only");
        }
    }
    free(path);
    if (found != NULL && found->fmu != NULL) return found;
    if (found != NULL) free(found->name);
    free(found);
    return NULL;
}

/* The first lines of a function of FMI 2.0. They define the component `found`, and return an error if it is NULL. */
#define COMPONENT         \
    component *found = fmu; \
    if (found == NULL) return fmi3Error

SW_EXPORT fmi2Status fmi2SetupExperiment(fmi2Component fmu, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real start,
                                         fmi2Boolean has_stop, fmi2Real stop)
{
    COMPONENT;
    found->start = start;
    found->has_stop = has_stop != 0;
    found->stop = stop;
    return fmi3OK;
}

SW_EXPORT fmi2Status fmi2EnterInitializationMode(fmi2Component fmu)
{
    COMPONENT;
    return fmi3EnterInitializationMode(found->fmu, false, 0.0, found->start, found->has_stop != 0, found->stop);
}

SW_EXPORT fmi2Status fmi2Reset(fmi2Component fmu)
{
    COMPONENT;
    found->start = found->stop = 0.0;
    found->has_stop = 0;
    return fmi3Reset(found->fmu);
}

SW_EXPORT fmi2Status fmi2DoStep(fmi2Component fmu, fmi2Real point, fmi2Real size, fmi2Boolean no_earlier_state)
{
    fmi3Boolean event, terminate, early;
    fmi3Float64 reached;
    COMPONENT;
    return fmi3DoStep(found->fmu, point, size, no_earlier_state != 0, &event, &terminate, &early, &reached);
}

/* Functions of FMI 2.0 that have the same arguments in FMI 3.0. */
#define THE_SAME(NAME, NAME3, ARGUMENTS, ...) \
    SW_EXPORT fmi2Status fmi2##NAME ARGUMENTS \
    {                                         \
        COMPONENT;                            \
        return fmi3##NAME3(__VA_ARGS__);      \
    }

THE_SAME(ExitInitializationMode, ExitInitializationMode, (fmi2Component fmu), found->fmu)
THE_SAME(Terminate, Terminate, (fmi2Component fmu), found->fmu)
#define REFERENCES fmi2Component fmu, const fmi2ValueReference references[], size_t count
THE_SAME(GetReal, GetFloat64, (REFERENCES, fmi2Real values[]), found->fmu, references, count, values, count)
THE_SAME(SetReal, SetFloat64, (REFERENCES, const fmi2Real values[]), found->fmu, references, count, values, count)
THE_SAME(GetInteger, GetInt32, (REFERENCES, fmi2Integer values[]), found->fmu, references, count, values, count)
THE_SAME(SetInteger, SetInt32, (REFERENCES, const fmi2Integer values[]), found->fmu, references, count, values, count)
THE_SAME(GetFMUstate, GetFMUState, (fmi2Component fmu, fmi2FMUstate *state), found->fmu, state)
THE_SAME(SetFMUstate, SetFMUState, (fmi2Component fmu, fmi2FMUstate state), found->fmu, state)
THE_SAME(FreeFMUstate, FreeFMUState, (fmi2Component fmu, fmi2FMUstate *state), found->fmu, state)
THE_SAME(SerializedFMUstateSize, SerializedFMUStateSize, (fmi2Component fmu, fmi2FMUstate state, size_t *size), found->fmu,
         state, size)
THE_SAME(SerializeFMUstate, SerializeFMUState, (fmi2Component fmu, fmi2FMUstate state, fmi2Byte bytes[], size_t size),
         found->fmu, state, (fmi3Byte *)bytes, size)
THE_SAME(DeSerializeFMUstate, DeserializeFMUState,
         (fmi2Component fmu, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state), found->fmu,
         (const fmi3Byte *)bytes, size, state)

SW_EXPORT fmi2Status fmi2GetBoolean(REFERENCES, fmi2Boolean values[])
{
    COMPONENT;
    fmi3Boolean *taken = calloc(count + 1, sizeof *taken);
    if (taken == NULL) return fmi3Error;
    const fmi3Status status = fmi3GetBoolean(found->fmu, references, count, taken, count);
    for (size_t i = 0; status == fmi3OK && i < count; i++) values[i] = taken[i];
    free(taken);
    return status;
}

SW_EXPORT fmi2Status fmi2SetBoolean(REFERENCES, const fmi2Boolean values[])
{
    COMPONENT;
    fmi3Boolean *given = calloc(count + 1, sizeof *given);
    if (given == NULL) return fmi3Error;
    for (size_t i = 0; i < count; i++) given[i] = values[i] != 0;
    const fmi3Status status = fmi3SetBoolean(found->fmu, references, count, given, count);
    free(given);
    return status;
}

/* Functions that every binary must have, although this binary does not support them. */
#define NONE_OF(NAME, ...) \
    SW_EXPORT fmi2Status fmi2##NAME(REFERENCES, __VA_ARGS__) { return count == 0 ? fmi3OK : fmi3Error; }
#define REFUSED(NAME, ...) \
    SW_EXPORT fmi2Status fmi2##NAME(fmi2Component fmu, __VA_ARGS__) { return fmi3Error; }

NONE_OF(GetString, fmi2String values[])
NONE_OF(SetString, const fmi2String values[])
NONE_OF(SetRealInputDerivatives, const fmi2Integer orders[], const fmi2Real values[])
NONE_OF(GetRealOutputDerivatives, const fmi2Integer orders[], fmi2Real values[])
NONE_OF(GetDirectionalDerivative, const fmi2ValueReference knowns[], size_t known, const fmi2Real seed[],
        fmi2Real sensitivity[])
SW_EXPORT fmi2Status fmi2CancelStep(fmi2Component fmu) { return fmi3Error; }
REFUSED(GetStatus, int which, fmi2Status *value)
REFUSED(GetRealStatus, int which, fmi2Real *value)
REFUSED(GetIntegerStatus, int which, fmi2Integer *value)
REFUSED(GetBooleanStatus, int which, fmi2Boolean *value)
REFUSED(GetStringStatus, int which, fmi2String *value)

SW_EXPORT fmi2Status fmi2SetDebugLogging(fmi2Component fmu, fmi2Boolean on, size_t count, const fmi2String categories[])
{
    return fmi3OK;
}
