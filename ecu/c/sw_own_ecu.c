/* The ECU of the compiled-in release. */
#include <stddef.h>

#include "sw_ecu.h"
#include "sw_weights.h"

/* Compilation fails here if the compiler's layout differs from the image writer's layout. */
typedef char as_packed[SW_RELEASE_AS_PACKED ? 1 : -1];

int sw_ecu_init(sw_ecu *ecu)
{
    static const sw_release release = SW_RELEASE;
#if SW_SENSOR_CHECK
    const sw_numbers own = {SW_OWN_PROGRAM, &release, &sw_own_estimator};
#else
    const sw_numbers own = {SW_OWN_PROGRAM, &release};
#endif
    return sw_ecu_init_of(ecu, &own);
}
