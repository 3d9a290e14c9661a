/* In place of a trained estimator's: its answers come from whoever measures. */
#ifndef SW_ESTIMATOR_H
#define SW_ESTIMATOR_H

#include "sw_settings.h"

typedef struct {
    double estimates[SW_SENSORS + SW_SENSORS * (SW_SENSORS - 1) / 2][SW_SENSORS];
} sw_estimator_work;

#endif
