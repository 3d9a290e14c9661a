/* sw_dots.h for Arm processors with the dot-product instructions (Cortex-A75 and later).
 *
 * One instruction multiplies a tile by four 8-bit numbers and adds the products in each row of the tile. A number of
 * the vector has 16 bits: x = 256 * high + low + 128 with high and low between -128 and 127. Three products are
 * therefore needed: with high, with low, and with ones. Sums are exact in any order.
 */
#ifndef SW_DOTS_NEON_H
#define SW_DOTS_NEON_H

#include <arm_neon.h>

#include "sw_workspace.h"

static inline void sw_dots(int32_t *restrict y, const int8_t *restrict w, const int16_t *restrict x, int rows,
                           int columns)
{
    /* The positions of the bytes of eight numbers, in the tiles' order. */
    static const uint8_t high_bytes[8] = {1, 5, 3, 7, 9, 13, 11, 15}, low_bytes[8] = {0, 4, 2, 6, 8, 12, 10, 14};
    const uint8x8_t of_high = vld1_u8(high_bytes), of_low = vld1_u8(low_bytes);
    const int8x16_t ones = vdupq_n_s8(1);
    int8x8_t high[SW_LONGEST / 8], low[SW_LONGEST / 8];
    for (int c = 0; c < columns; c += 8) {
        const uint8x16_t eight = vreinterpretq_u8_s16(vld1q_s16(x + c));
        high[c / 8] = vreinterpret_s8_u8(vqtbl1_u8(eight, of_high));
        low[c / 8] = vreinterpret_s8_u8(veor_u8(vqtbl1_u8(eight, of_low), vdup_n_u8(0x80)));
    }
    for (; rows > 0; rows -= 4, y += 4) {
        int32x4_t by_high = vdupq_n_s32(0), by_low = vdupq_n_s32(0), by_ones = vdupq_n_s32(0);
        for (int c = 0; c < columns; c += 8, w += 32) {
            const int8x16_t tile = vld1q_s8(w), next = vld1q_s8(w + 16);
            by_high = vdotq_lane_s32(vdotq_lane_s32(by_high, tile, high[c / 8], 0), next, high[c / 8], 1);
            by_low = vdotq_lane_s32(vdotq_lane_s32(by_low, tile, low[c / 8], 0), next, low[c / 8], 1);
            by_ones = vdotq_s32(vdotq_s32(by_ones, tile, ones), next, ones);
        }
        vst1q_s32(y, vaddq_s32(vaddq_s32(vshlq_n_s32(by_high, 8), by_low), vshlq_n_s32(by_ones, 7)));
    }
}

#endif
