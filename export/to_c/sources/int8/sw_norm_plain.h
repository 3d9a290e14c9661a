/* The loops of sw_norm.h's forward pass in plain C. */
#ifndef SW_NORM_PLAIN_H
#define SW_NORM_PLAIN_H

#include "sw_tables.h"

/* Replaces the sums by u, and returns the sum of u. Adds the sum of u^2 to *squares. */
static inline int32_t sw_norm_sums(int32_t *restrict sums, const int32_t channel[][4][8], int64_t *squares, int width)
{
    int32_t sum = 0;
    uint64_t all = 0;
    for (int c = 0; c < SW_PADDED(width); c += 8) {
        const int32_t (*of)[8] = channel[c / 8];
        for (int j = 0; j < 8; j++) {
            const int32_t u = sw_sum(of[SW_BIAS][j], sw_scaled(sums[c + j], of[SW_SCALE][j]));
            sums[c + j] = u;
            sum = sw_sum(sum, u);
            all += (uint64_t)((int64_t)u * u);
        }
    }
    *squares = (int64_t)all;
    return sum;
}

/* Computes xhat = shift + u * factor, y = gain * xhat + offset, h = ELU(y) and ELU'(y). */
static inline void sw_norm_outputs(const int32_t *restrict u, sw_tape_eight *restrict tape, int16_t *restrict hidden,
                                   const int32_t channel[][4][8], int32_t factor, int32_t shift, int width)
{
    for (int c = 0; c < SW_PADDED(width); c += 8) {
        const int32_t (*of)[8] = channel[c / 8];
        int32_t y[8];
        for (int j = 0; j < 8; j++) {
            const int16_t xhat = (int16_t)sw_sum(shift, sw_scaled(u[c + j], factor));
            tape[c / 8].xhat[j] = xhat;
            y[j] = sw_scaled_on(of[SW_OFFSET][j], of[SW_GAIN][j], xhat);
        }
        for (int j = 0; j < 8; j++) hidden[c + j] = sw_elu(y[j]);
        for (int j = 0; j < 8; j++) tape[c / 8].slope[j] = sw_slope_of(hidden[c + j]);
    }
}

#endif
