/* Event mode, clocks and binary variables of the bus terminal, as in FMI 3.0. */
#include <string.h>

#include "sw_fmu_bus.h"

enum { RX_CLOCK = SW_FMU_VARIABLES, RX_DATA, TX_CLOCK, TX_DATA }; /* value references */

SW_EXPORT fmi3Status fmi3EnterEventMode(fmi3Instance fmu)
{
    fmu_instance *found = fmu;
    FMU_ONLY_IN(STEPPING, "EnterEventMode", "between two steps");
    if (!found->has_event_mode) return fmu_refused(&found->logger, "fmi3EnterEventMode: eventModeUsed was false");
    found->kept.mode = EVENT;
    return fmi3OK;
}

SW_EXPORT fmi3Status fmi3EnterStepMode(fmi3Instance fmu)
{
    fmu_instance *found = fmu;
    FMU_ONLY_IN(EVENT, "EnterStepMode", "in event mode");
    found->kept.mode = STEPPING;
    return fmi3OK;
}

SW_EXPORT fmi3Status fmi3UpdateDiscreteStates(fmi3Instance fmu, fmi3Boolean *need_update, fmi3Boolean *terminate,
                                              fmi3Boolean *nominals_changed, fmi3Boolean *values_changed,
                                              fmi3Boolean *next_defined, fmi3Float64 *next_time)
{
    fmu_instance *found = fmu;
    FMU_ONLY_IN(EVENT, "UpdateDiscreteStates", "in event mode");
    fmu_side *side = &found->kept.side;
    if (side->tx_ticks) side->tx_bytes = 0;
    if (side->rx_ticks) fmu_take_operations(&found->kept);
    side->rx_ticks = side->tx_ticks = false;
    side->rx_bytes = 0;
    *need_update = *terminate = *nominals_changed = *values_changed = *next_defined = false;
    *next_time = 0.0;
    return fmi3OK;
}

SW_EXPORT fmi3Status fmi3SetClock(fmi3Instance fmu, const fmi3ValueReference references[], size_t count,
                                  const fmi3Clock values[])
{
    fmu_instance *found = fmu;
    FMU_ONLY_IN(EVENT, "SetClock", "in event mode");
    for (size_t i = 0; i < count; i++) {
        if (references[i] != RX_CLOCK && references[i] != TX_CLOCK) {
            return fmu_refused(&found->logger, "fmi3SetClock: a value reference is of no clock");
        }
    }
    for (size_t i = 0; i < count; i++) {
        if (values[i] && references[i] == RX_CLOCK) found->kept.side.rx_ticks = true;
        if (values[i] && references[i] == TX_CLOCK) found->kept.side.tx_ticks = true;
    }
    return fmi3OK;
}

/* A triggered Tx_Clock is active once in each event that sends frames. */
SW_EXPORT fmi3Status fmi3GetClock(fmi3Instance fmu, const fmi3ValueReference references[], size_t count,
                                  fmi3Clock values[])
{
    fmu_instance *found = fmu;
    FMU_ONLY_IN(EVENT | INITIALISING, "GetClock", "in event mode");
    fmu_side *side = &found->kept.side;
    for (size_t i = 0; i < count; i++) {
        if (references[i] != TX_CLOCK) return fmu_refused(&found->logger, "fmi3GetClock: only Tx_Clock can be an output");
        values[i] = !side->tx_ticks && side->tx_bytes > 0;
        if (values[i]) side->tx_ticks = true;
    }
    return fmi3OK;
}

#define INTERVAL(NAME, ...)                                                                                         \
    fmu_instance *found = fmu;                                                                                      \
    FMU_ONLY_IN(EVENT | INITIALISING, NAME, "in event mode");                                                       \
    for (size_t i = 0; i < count; i++) {                                                                            \
        if (references[i] != TX_CLOCK) return fmu_refused(&found->logger, "fmi3" NAME ": only Tx_Clock has one");   \
        qualifiers[i] = found->kept.mode == EVENT ? fmi3IntervalChanged : fmi3IntervalNotYetKnown;                  \
        __VA_ARGS__;                                                                                                \
    }                                                                                                               \
    return fmi3OK;

SW_EXPORT fmi3Status fmi3GetIntervalDecimal(fmi3Instance fmu, const fmi3ValueReference references[], size_t count,
                                            fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[])
{
    INTERVAL("GetIntervalDecimal", intervals[i] = (double)fmu_interval_ns(&found->kept) / 1e9)
}

SW_EXPORT fmi3Status fmi3GetIntervalFraction(fmi3Instance fmu, const fmi3ValueReference references[], size_t count,
                                             fmi3UInt64 counters[], fmi3UInt64 resolutions[],
                                             fmi3IntervalQualifier qualifiers[])
{
    INTERVAL("GetIntervalFraction", counters[i] = fmu_interval_ns(&found->kept); resolutions[i] = 1000000000)
}

SW_EXPORT fmi3Status fmi3GetBinary(fmi3Instance fmu, const fmi3ValueReference references[], size_t count,
                                   size_t sizes[], fmi3Binary values[], size_t size)
{
    fmu_instance *found = fmu;
    FMU_ONLY_IN(~0u, "GetBinary", "of an instance");
    FMU_ONE_EACH("GetBinary");
    const fmu_side *side = &found->kept.side;
    for (size_t i = 0; i < count; i++) {
        if (references[i] != RX_DATA && references[i] != TX_DATA) {
            return fmu_refused(&found->logger, "fmi3GetBinary: a value reference is of no such variable");
        }
        const int is_tx = references[i] == TX_DATA;
        values[i] = is_tx ? side->tx : side->rx;
        sizes[i] = !is_tx ? side->rx_bytes : side->tx_ticks ? side->tx_bytes : 0;
    }
    return fmi3OK;
}

SW_EXPORT fmi3Status fmi3SetBinary(fmi3Instance fmu, const fmi3ValueReference references[], size_t count,
                                   const size_t sizes[], const fmi3Binary values[], size_t size)
{
    fmu_instance *found = fmu;
    FMU_ONLY_IN(INSTANTIATED | INITIALISING | EVENT, "SetBinary", "before the first step and in event mode");
    FMU_ONE_EACH("SetBinary");
    for (size_t i = 0; i < count; i++) {
        if (references[i] != RX_DATA) return fmu_refused(&found->logger, "fmi3SetBinary: only Rx_Data is an input");
        if (sizes[i] > RX_BYTES) return fmu_refused(&found->logger, "fmi3SetBinary: Rx_Data has at most 8192 bytes");
    }
    for (size_t i = 0; i < count; i++) {
        if (sizes[i] > 0) (void)memcpy(found->kept.side.rx, values[i], sizes[i]);
        found->kept.side.rx_bytes = (uint32_t)sizes[i];
    }
    return fmi3OK;
}
