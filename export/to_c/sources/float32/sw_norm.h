/* The layer norm and ELU in one function, and their adjoint.
 *
 * A matrix before a norm is stored centred: its mean over the outputs is subtracted, so that the norm's input u has
 * mean zero. The norm is then xhat = r * u with r = 1 / sqrt(mean(u^2) + eps), and h = ELU(y) with y = gain * xhat +
 * offset. The adjoint needs xhat and slope = ELU'(y) * gain * r: with t = slope * dJ/dh, it is dJ/du = t - xhat *
 * mean(t * xhat). This dJ/du lacks the subtraction of its mean, which the centred matrix already contains.
 *
 * Padding stays zero, because u, gain and offset are zero in the padding.
 */
#ifndef SW_NORM_H
#define SW_NORM_H

#include "sw_kernels.h"
#include "sw_math.h"

/* Computes h from u, in place in `hidden`, and xhat and slope; `width` is the length without padding. */
static inline void sw_norm_elu(float *restrict hidden, float *restrict xhat, float *restrict slope,
                               const float *restrict gain, const float *restrict offset, int width, int padded)
{
    float squares[SW_LANES] = {0};
    for (int c = 0; c < padded; c += SW_LANES) {
        for (int j = 0; j < SW_LANES; j++) squares[j] += hidden[c + j] * hidden[c + j];
    }
    const float r = sw_inverse_sqrt(sw_lane_sum(squares) / (float)width + SW_NORM_EPSILON);
    for (int c = 0; c < padded; c++) {
        const float normed = r * hidden[c];
        const float y = gain[c] * normed + offset[c];
        const float below = sw_exp(sw_min(y, 0.0f));
        xhat[c] = normed;
        slope[c] = below * (gain[c] * r);
        hidden[c] = sw_max(y, 0.0f) + (below - 1.0f);
    }
}

/* Computes dJ/du from dJ/dh, in place in `d`. */
static inline void sw_norm_elu_adjoint(float *restrict d, const float *restrict xhat, const float *restrict slope,
                                       int width, int padded)
{
    float products[SW_LANES] = {0};
    for (int c = 0; c < padded; c += SW_LANES) {
        for (int j = 0; j < SW_LANES; j++) {
            d[c + j] *= slope[c + j];
            products[j] += d[c + j] * xhat[c + j];
        }
    }
    const float along = sw_lane_sum(products) / (float)width;
    for (int c = 0; c < padded; c++) d[c] -= along * xhat[c];
}

#endif
