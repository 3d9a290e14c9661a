/* The calls and numbers that an instance accepts, according to FMI 3.0's state machine for co-simulation. Every other
 * call returns fmi3Error with a message, and changes nothing.
 */
#ifndef SW_FMI3_CALLS_H
#define SW_FMI3_CALLS_H

#include <string.h>

#include "sw_fmi3.h"

/* Functions have the standard's parameters, even those that they do not use. */
#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif

/* The modes of an instance, as bits that can be combined. */
enum { INSTANTIATED = 1, INITIALISING = 2, STEPPING = 4, TERMINATED = 8, EVENT = 16 };

typedef struct {
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
} fmu_logger;

static inline fmi3Status fmu_refused(const fmu_logger *to, fmi3String why)
{
    if (to->log != NULL) to->log(to->environment, fmi3Error, "logStatusError", why);
    return fmi3Error;
}

/* The first lines of a function of FMI: they refuse the call if `found` is NULL, or if its mode is not in MODES. */
#define FMU_ONLY_IN(MODES, NAME, WHEN)                                                                        \
    if (found == NULL) return fmi3Error;                                                                      \
    if ((found->kept.mode & (uint32_t)(MODES)) == 0u) return fmu_refused(&found->logger, "fmi3" NAME ": only " WHEN)

/* Refuses a call that does not have exactly one number for each reference. */
#define FMU_ONE_EACH(NAME) \
    if (size != count) return fmu_refused(&found->logger, "fmi3" NAME ": must have one number for each value reference")

static inline int fmu_is_number(double value)
{
    return value >= -1.7976931348623157e308 && value <= 1.7976931348623157e308;
}

/* Returns the error in a call that creates an instance, or NULL. */
static inline fmi3String fmu_wrong_instance(fmi3String token, fmi3String own, fmi3Boolean event_mode)
{
    if (token == NULL || strcmp(token, own) != 0) {
        return "instantiationToken: is not of this FMU; read it from its modelDescription.xml";
    }
    return event_mode ? "eventModeUsed: this FMU has no event mode; pass false" : NULL;
}

/* Returns the error in an experiment's times, or NULL. */
static inline fmi3String fmu_wrong_times(double start, fmi3Boolean has_stop, double stop)
{
    if (!(start > -2e9 && start < 2e9)) return "startTime: must be a number of seconds, at most 63 years from 0";
    if (has_stop && !(stop >= start)) return "stopTime: must be a number, not before startTime";
    return NULL;
}

/* Returns the error in a step that begins at `point`, or NULL; `stands` is the instance's present time. */
static inline fmi3String fmu_wrong_step(double stands, double point, double size)
{
    const double behind_s = point - stands;
    if (!(behind_s > -1e-6 && behind_s < 1e-6)) {
        return "currentCommunicationPoint: must be where the last step ended, within a microsecond";
    }
    if (!(size >= 0.0 && size < 2e9)) return "communicationStepSize: must be 0 or more, and at most 63 years";
    return NULL;
}

/* Define a function for a type that has no variables, and a function that this kind of FMU does not support. */
#define FMU_NONE_OF(NAME, ...)                                                                                     \
    SW_EXPORT fmi3Status fmi3##NAME(fmi3Instance fmu, const fmi3ValueReference references[], size_t count,         \
                                    __VA_ARGS__)                                                                   \
    {                                                                                                              \
        return count == 0 ? fmi3OK : fmi3Error;                                                                    \
    }
#define FMU_REFUSED(NAME, ...) \
    SW_EXPORT fmi3Status fmi3##NAME(__VA_ARGS__) { return fmi3Error; }

#endif
