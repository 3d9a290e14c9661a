/* The numbers of a linear controller; sw_weights.c, generated, defines those that are compiled in. Pressures in Cp, actions in U_inf W. */
#ifndef SW_WEIGHTS_H
#define SW_WEIGHTS_H

#include "stillwake.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A history row by row, oldest first, without its last number, the action that is to be decided. */
#define SW_HISTORY (SW_WINDOW * SW_ROW - 1)

/* The differences and Cl a step later, and the action that the feedback wants; filled up with zeros to four at a time. */
#define SW_OUTPUTS ((SW_ROW + 1 + 3) / 4 * 4)

/* Read in place, wherever they stand: little-endian, no pointers, every member aligned to SW_ALIGNMENT. */
typedef struct sw_weights {
    SW_ALIGNED float window_mean[SW_COLUMNS];
    SW_ALIGNED float force_mean[2]; /* Cd and Cl where the model was identified */
    SW_ALIGNED float force_std[2];
    SW_ALIGNED float action_limit; /* largest magnitude of an action */
    SW_ALIGNED float drag_reference;
    SW_ALIGNED float by_history[SW_HISTORY][SW_OUTPUTS]; /* what each number of the history adds to the outputs */
    SW_ALIGNED float by_action[SW_OUTPUTS];              /* what the action that was decided adds */
    SW_ALIGNED float default_weights[SW_TERMS];
} sw_weights;

/* Compiled in. */
extern const sw_weights sw_own_weights;
#define SW_OWN_PROGRAM {&sw_own_weights, NULL}

#ifdef __cplusplus
}
#endif

#endif
