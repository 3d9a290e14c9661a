/* Functions of FMI 3.0 that no FMU of this project supports. A binary must have most of these functions, although
 * modelDescription.xml states that they are not supported. Functions of types without variables accept only empty calls.
 */
#include "sw_fmi3_calls.h"

SW_EXPORT const char *fmi3GetVersion(void) { return "3.0"; }

SW_EXPORT fmi3Status fmi3SetDebugLogging(fmi3Instance fmu, fmi3Boolean on, size_t count, const fmi3String categories[])
{
    return fmi3OK;
}

FMU_NONE_OF(GetString, fmi3String values[], size_t size)
FMU_NONE_OF(SetString, const fmi3String values[], size_t size)
FMU_NONE_OF(GetShiftDecimal, fmi3Float64 shifts[])
FMU_NONE_OF(GetShiftFraction, fmi3UInt64 counters[], fmi3UInt64 resolutions[])
FMU_NONE_OF(SetIntervalDecimal, const fmi3Float64 intervals[])
FMU_NONE_OF(SetIntervalFraction, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
FMU_NONE_OF(SetShiftDecimal, const fmi3Float64 shifts[])
FMU_NONE_OF(SetShiftFraction, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
FMU_NONE_OF(GetOutputDerivatives, const fmi3Int32 orders[], fmi3Float64 values[], size_t size)
FMU_NONE_OF(GetDirectionalDerivative, const fmi3ValueReference knowns[], size_t known, const fmi3Float64 seed[],
            size_t seeds, fmi3Float64 sensitivity[], size_t size)
FMU_NONE_OF(GetAdjointDerivative, const fmi3ValueReference knowns[], size_t known, const fmi3Float64 seed[], size_t seeds,
            fmi3Float64 sensitivity[], size_t size)

FMU_REFUSED(EnterConfigurationMode, fmi3Instance fmu)
FMU_REFUSED(ExitConfigurationMode, fmi3Instance fmu)
FMU_REFUSED(EvaluateDiscreteStates, fmi3Instance fmu)
FMU_REFUSED(EnterContinuousTimeMode, fmi3Instance fmu)
FMU_REFUSED(GetNumberOfVariableDependencies, fmi3Instance fmu, fmi3ValueReference reference, size_t *count)
FMU_REFUSED(GetVariableDependencies, fmi3Instance fmu, fmi3ValueReference dependent, size_t elements[],
        fmi3ValueReference independents[], size_t of_independents[], fmi3DependencyKind kinds[], size_t count)
FMU_REFUSED(CompletedIntegratorStep, fmi3Instance fmu, fmi3Boolean no_earlier_state, fmi3Boolean *enter_event_mode,
        fmi3Boolean *terminate)
FMU_REFUSED(SetTime, fmi3Instance fmu, fmi3Float64 time)
FMU_REFUSED(SetContinuousStates, fmi3Instance fmu, const fmi3Float64 states[], size_t count)
FMU_REFUSED(GetContinuousStates, fmi3Instance fmu, fmi3Float64 states[], size_t count)
FMU_REFUSED(GetContinuousStateDerivatives, fmi3Instance fmu, fmi3Float64 derivatives[], size_t count)
FMU_REFUSED(GetNominalsOfContinuousStates, fmi3Instance fmu, fmi3Float64 nominals[], size_t count)
FMU_REFUSED(GetNumberOfContinuousStates, fmi3Instance fmu, size_t *count)
FMU_REFUSED(GetEventIndicators, fmi3Instance fmu, fmi3Float64 indicators[], size_t count)
FMU_REFUSED(GetNumberOfEventIndicators, fmi3Instance fmu, size_t *count)
FMU_REFUSED(ActivateModelPartition, fmi3Instance fmu, fmi3ValueReference clock, fmi3Float64 time)

SW_EXPORT fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources,
                                                    fmi3Boolean visible, fmi3Boolean logging,
                                                    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log)
{
    return NULL;
}

SW_EXPORT fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources,
                                                         fmi3Boolean visible, fmi3Boolean logging,
                                                         fmi3InstanceEnvironment environment,
                                                         fmi3LogMessageCallback log, fmi3ClockUpdateCallback update,
                                                         fmi3LockPreemptionCallback lock,
                                                         fmi3UnlockPreemptionCallback unlock)
{
    return NULL;
}
