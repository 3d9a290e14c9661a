/* The prior of the plan: its weights and its scratch memory. SW_PRIOR_UNITS is 0 without a prior. */
#ifndef SW_PRIOR_MEMORY_H
#define SW_PRIOR_MEMORY_H

#include <stdint.h>

#include "sw_settings.h"

/* Length of a row of the past, which has the differences of the sensors' pairs and then the action. */
#define SW_PRIOR_ROW (SW_SENSORS / 2 + 1)
#define SW_PRIOR_PAST (SW_PRIOR_MEMORY * SW_PRIOR_ROW)

#if SW_PRIOR_UNITS > 0

/* Numbers of inputs. A unit's inputs are the filtered rows; its gate's inputs are the pairs' filtered sums. */
#define SW_PRIOR_INPUTS (SW_PRIOR_FILTERS * SW_PRIOR_ROW)
#define SW_PRIOR_SUMS (SW_PRIOR_FILTERS * (SW_PRIOR_ROW - 1))
/* The number of units, padded with zeros to a multiple of eight. */
#define SW_PRIOR_OUTPUTS ((SW_PRIOR_UNITS + 7) / 8 * 8)

/* The prior's members of sw_weights. For each filter, prior_filter_rows has the first row of the past that the filter
 * reads, and the number of rows. prior_filter has the rows' weights, filter by filter. For each input of a unit,
 * prior_first has one weight per scheduling variable. prior_sums has the gates' weights for the sums. prior_first and
 * prior_sums must be multiplied by scales, which are 1 in a float32 library.
 */
#define SW_PRIOR_NUMBERS                                                                        \
    SW_ALIGNED int32_t prior_filter_rows[SW_PRIOR_FILTERS][2];                                  \
    SW_ALIGNED float prior_filter[SW_PRIOR_FILTER_ROWS];                                        \
    SW_ALIGNED sw_prior_number prior_first[SW_PRIOR_OUTPUTS][SW_PRIOR_INPUTS][SW_SCHEDULED];    \
    SW_ALIGNED float prior_first_scale[SW_PRIOR_OUTPUTS][SW_SCHEDULED];                         \
    SW_ALIGNED float prior_gate[SW_PRIOR_OUTPUTS][SW_SCHEDULED];                                \
    SW_ALIGNED sw_prior_number prior_sums[SW_PRIOR_OUTPUTS][SW_PRIOR_SUMS];                     \
    SW_ALIGNED float prior_sums_scale[SW_PRIOR_OUTPUTS];                                        \
    SW_ALIGNED float prior_output[SW_PRIOR_OUTPUTS];                                            \
    SW_ALIGNED float prior_predictor[SW_PRIOR_ROW - 1][SW_PRIOR_PAST];

#else
#define SW_SCHEDULED 1
#define SW_PRIOR_INPUTS 1
#define SW_PRIOR_OUTPUTS 1
#define SW_PRIOR_NUMBERS
#endif

typedef struct {
    float rows[SW_PRIOR_MEMORY + SW_HORIZON][SW_PRIOR_ROW]; /* oldest row first: the past, then the prediction */
    float schedule[SW_SCHEDULED];
    float inputs[SW_PRIOR_INPUTS];
    float weight[SW_PRIOR_INPUTS + 1][SW_PRIOR_OUTPUTS]; /* this step's weights; the last row is loaded but not used */
    float outputs[SW_PRIOR_OUTPUTS];
    float gated[SW_PRIOR_OUTPUTS]; /* the last layer's weights multiplied by the gates */
} sw_prior_scratch;

#endif
