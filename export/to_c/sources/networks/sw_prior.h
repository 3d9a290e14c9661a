/* The prior of the plan: its numbers, in float in either precision, and its scratch memory. Without one SW_PRIOR_UNITS is 0.
 */
#ifndef SW_PRIOR_H
#define SW_PRIOR_H

#include "sw_settings.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A row of the past: the differences of the sensors' pairs, then the action. */
#define SW_PRIOR_ROW (SW_SENSORS / 2 + 1)
#define SW_PRIOR_PAST (SW_PRIOR_MEMORY * SW_PRIOR_ROW)

#if SW_PRIOR_UNITS > 0

/* Products with a past: the units' arguments, then the next differences; filled up with zeros to four at a time. */
#define SW_PRIOR_OUTPUTS ((SW_PRIOR_UNITS + SW_SENSORS / 2 + 3) / 4 * 4)

extern const float sw_prior_weight[SW_PRIOR_PAST][SW_PRIOR_OUTPUTS]; /* what each number of a past adds */
extern const float sw_prior_output[SW_PRIOR_UNITS];

#else
#define SW_PRIOR_OUTPUTS 1
#endif

typedef struct {
    float rows[SW_PRIOR_MEMORY + SW_HORIZON][SW_PRIOR_ROW]; /* oldest first: what was, then what is predicted */
    float outputs[SW_PRIOR_OUTPUTS];
} sw_prior_scratch;

#ifdef __cplusplus
}
#endif

#endif
