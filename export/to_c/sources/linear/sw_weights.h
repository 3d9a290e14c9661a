/* The numbers of a linear controller; sw_weights.c, generated, defines them. Pressures in Cp, actions in U_inf W. */
#ifndef SW_WEIGHTS_H
#define SW_WEIGHTS_H

#include "stillwake.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Tables start at a cache line where the compiler can align them; only speed depends on it. */
#if defined(__GNUC__)
#define SW_ALIGNED __attribute__((aligned(64)))
#else
#define SW_ALIGNED
#endif

/* A history row by row, oldest first, without its last number, the action that is to be decided. */
#define SW_HISTORY (SW_WINDOW * SW_ROW - 1)

/* The differences and Cl a step later, and the action that the feedback wants; filled up with zeros to four at a time. */
#define SW_OUTPUTS ((SW_ROW + 1 + 3) / 4 * 4)

extern const float sw_window_mean[SW_COLUMNS];
extern const float sw_force_mean[2]; /* Cd and Cl where the model was identified */
extern const float sw_force_std[2];
extern const float sw_by_history[SW_HISTORY][SW_OUTPUTS]; /* what each number of the history adds to the outputs */
extern const float sw_by_action[SW_OUTPUTS];              /* what the action that was decided adds */
extern const float sw_default_weights[SW_TERMS];

#ifdef __cplusplus
}
#endif

#endif
