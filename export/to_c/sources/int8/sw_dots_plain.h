/* sw_dots.h in plain C. */
#ifndef SW_DOTS_PLAIN_H
#define SW_DOTS_PLAIN_H

#include "sw_workspace.h"

/* The vector is first copied into the tiles' order, so that compilers can vectorise the loop over the tiles. */
static inline void sw_dots(int32_t *restrict y, const int8_t *restrict w, const int16_t *restrict x, int rows,
                           int columns)
{
    int16_t in_order[4 * SW_DOTS_COLUMNS];
    for (int c = 0; c < columns; c += 4) {
        for (int r = 0; r < 4; r++) {
            in_order[4 * c + 4 * r] = x[c];
            in_order[4 * c + 4 * r + 1] = x[c + 2];
            in_order[4 * c + 4 * r + 2] = x[c + 1];
            in_order[4 * c + 4 * r + 3] = x[c + 3];
        }
    }
    for (; rows > 0; rows -= 4, y += 4, w += 4 * columns) {
        int32_t sums[32] = {0};
        for (int c = 0; c < 4 * columns; c += 32) {
            for (int j = 0; j < 32; j++) sums[j] += w[c + j] * in_order[c + j];
        }
        for (int j = 0; j < 16; j++) sums[j] += sums[j + 16];
        for (int r = 0; r < 4; r++) {
            y[r] = (sums[4 * r] + sums[4 * r + 1]) + (sums[4 * r + 2] + sums[4 * r + 3]);
        }
    }
}

#endif
