/* The prior of the plan: its numbers, in float in either precision, and its scratch memory. Without one SW_PRIOR_UNITS is 0.
 */
#ifndef SW_PRIOR_H
#define SW_PRIOR_H

#include <stdint.h>

#include "sw_settings.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A row of the past: the differences of the sensors' pairs, then the action. */
#define SW_PRIOR_ROW (SW_SENSORS / 2 + 1)
#define SW_PRIOR_PAST (SW_PRIOR_MEMORY * SW_PRIOR_ROW)

#if SW_PRIOR_UNITS > 0

/* Inputs of the units: the filtered rows and, where SW_PRIOR_SLOPE is 1, the same times speed - 1. */
#define SW_PRIOR_FILTERED (SW_PRIOR_FILTERS * SW_PRIOR_ROW)
#define SW_PRIOR_INPUTS ((1 + SW_PRIOR_SLOPE) * SW_PRIOR_FILTERED)
/* The units, filled up with zeros to four at a time. */
#define SW_PRIOR_OUTPUTS ((SW_PRIOR_UNITS + 3) / 4 * 4)

/* Members of sw_weights: the first row of a past that each filter reads, and how many; the rows' weights, filter by filter;
 * the layers.
 */
#define SW_PRIOR_NUMBERS                                                   \
    SW_ALIGNED int32_t prior_filter_rows[SW_PRIOR_FILTERS][2];             \
    SW_ALIGNED float prior_filter[SW_PRIOR_FILTER_ROWS];                   \
    SW_ALIGNED float prior_weight[SW_PRIOR_INPUTS][SW_PRIOR_OUTPUTS];      \
    SW_ALIGNED float prior_output[SW_PRIOR_UNITS];                         \
    SW_ALIGNED float prior_predictor[SW_PRIOR_ROW - 1][SW_PRIOR_PAST];

#else
#define SW_PRIOR_INPUTS 1
#define SW_PRIOR_OUTPUTS 1
#define SW_PRIOR_NUMBERS
#endif

typedef struct {
    float rows[SW_PRIOR_MEMORY + SW_HORIZON][SW_PRIOR_ROW]; /* oldest first: what was, then what is predicted */
    float inputs[SW_PRIOR_INPUTS];
    float outputs[SW_PRIOR_OUTPUTS];
} sw_prior_scratch;

#ifdef __cplusplus
}
#endif

#endif
