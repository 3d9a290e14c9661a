/* The functions of FMI 3.0 for events, clocks and binaries, in an FMU that has none of these. */
#include "sw_fmi3_calls.h"

FMU_NONE_OF(GetBinary, size_t sizes[], fmi3Binary values[], size_t size)
FMU_NONE_OF(SetBinary, const size_t sizes[], const fmi3Binary values[], size_t size)
FMU_NONE_OF(GetClock, fmi3Clock values[])
FMU_NONE_OF(SetClock, const fmi3Clock values[])
FMU_NONE_OF(GetIntervalDecimal, fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[])
FMU_NONE_OF(GetIntervalFraction, fmi3UInt64 counters[], fmi3UInt64 resolutions[], fmi3IntervalQualifier qualifiers[])
FMU_REFUSED(EnterEventMode, fmi3Instance fmu)
FMU_REFUSED(EnterStepMode, fmi3Instance fmu)
FMU_REFUSED(UpdateDiscreteStates, fmi3Instance fmu, fmi3Boolean *need_update, fmi3Boolean *terminate,
        fmi3Boolean *nominals_changed, fmi3Boolean *values_changed, fmi3Boolean *next_defined, fmi3Float64 *next_time)
