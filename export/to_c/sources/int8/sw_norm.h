/* Layer norm and ELU as one, and their adjoint, between integer products.
 *
 * Forwards, h = ELU(y) with y = gain xhat + offset and xhat = r (u - mean u), r = 1 / sqrt(var u + eps). The tape keeps
 * xhat, which cannot exceed sqrt(n) and so needs no calibration, and h, both as int16, and r. Backwards, with
 * t = ELU'(y) gain dJ/dh, it is dJ/du = r (t - mean t - xhat mean(t xhat)), and ELU' = min(h, 0) + 1.
 *
 * Everything runs in eights: a channel's constants stand beside those of the next seven, and sums are eight sums,
 * because one core waits for the last addition, and another adds up eight at a time. Padding has zeros for constants,
 * which leave no trace.
 */
#ifndef SW_NORM_H
#define SW_NORM_H

#include "sw_dots.h"
#include "sw_tables.h"
#include "sw_weights.h"

static inline float sw_sum_of(const float eight[8])
{
    return ((eight[0] + eight[1]) + (eight[2] + eight[3])) + ((eight[4] + eight[5]) + (eight[6] + eight[7]));
}

/* From the sums of a product to xhat and h; returns r. Sums and values are scratch afterwards. */
static inline float sw_norm_elu(int32_t *restrict sums, float *restrict values, int16_t *restrict xhat,
                                int16_t *restrict hidden, const float channel[][4][8], int width)
{
    float sum[8] = {0}, squares[8] = {0};
    for (int c = 0; c < SW_PADDED(width); c += 8) {
        const float (*of)[8] = channel[c / 8];
        for (int j = 0; j < 8; j++) {
            const float u = (float)sums[c + j] * of[SW_SCALE][j] + of[SW_BIAS][j];
            values[c + j] = u;
            sum[j] += u;
            squares[j] += u * u;
        }
    }
    const float mean = sw_sum_of(sum) / (float)width;
    const float variance = sw_sum_of(squares) / (float)width - mean * mean;
    const float r = sw_inverse_sqrt(sw_fmax(variance, 0.0f) + SW_NORM_EPSILON);
    const float factor = r * (SW_XHAT_QMAX * sw_inverse_sqrt((float)width)), shift = -mean * factor;
    for (int c = 0; c < SW_PADDED(width); c += 8) {
        const float (*of)[8] = channel[c / 8];
        for (int j = 0; j < 8; j++) {
            const float normed = values[c + j] * factor + shift;
            xhat[c + j] = sw_rounded(normed);
            sums[c + j] = (int32_t)(normed * of[SW_GAIN][j] + of[SW_OFFSET][j]);
        }
    }
    for (int c = 0; c < SW_PADDED(width); c++) hidden[c] = sw_elu(sums[c]);
    return r;
}

/* ELU' in integers of 1 / SW_ELU_ONE, from h. */
static inline int32_t sw_elu_slope(int32_t h) { return SW_ELU_ONE + (h < 0 ? h : 0); }

/* What the first pass of the adjoint gathers over t = ELU'(y) gain dJ/dh: sums of t and of t xhat, the largest |t|. */
typedef struct {
    float sum[8], along[8], peak[8];
} sw_gathered;

/* Eight t from as many ELU'(y) dJ/dh, gathered. */
static inline void sw_gather(sw_gathered *all, float t[8], const float d[8], const int16_t xhat[8], const float gain[8])
{
    for (int j = 0; j < 8; j++) {
        t[j] = d[j] * gain[j];
        all->sum[j] += t[j];
        all->along[j] += t[j] * (float)xhat[j];
        all->peak[j] = sw_fmax(all->peak[j], sw_abs(t[j]));
    }
}

/* From t, in `values`, to dJ/du times the scales of the rows in front, as int16 for the transposed product. Returns
 * what that product's sums have to be multiplied by. `unit` is what a 1 in dJ/dh stands for.
 */
static inline float sw_norm_adjoint(const sw_gathered *all, const float *restrict values, float unit,
                                    int16_t *restrict vector, const int16_t *restrict xhat, const float channel[][2][8],
                                    float largest, float r, int width)
{
    const float qmax = (float)SW_QMAX(SW_PADDED(width));
    /* xhat's integers are SW_XHAT_QMAX / sqrt(n) a unit, so this is mean(t xhat) for a xhat in integers. */
    const float project = sw_sum_of(all->along) * (1.0f / (SW_XHAT_QMAX * SW_XHAT_QMAX));
    const float mean = sw_sum_of(all->sum) / (float)width;
    float peak = all->peak[0];
    for (int j = 1; j < 8; j++) peak = sw_fmax(peak, all->peak[j]);
    /* No result exceeds this, whatever xhat is; the bound costs a bit or two and saves a pass. */
    const float bound = peak + sw_abs(mean) + SW_XHAT_QMAX * sw_abs(project);
    const float factor = bound > 1e-30f ? qmax / bound : 0.0f;
    const float centre = -mean * factor, slant = -project * factor;
    for (int c = 0; c < SW_PADDED(width); c += 8) {
        for (int j = 0; j < 8; j++) {
            const float d = values[c + j] * factor + ((float)xhat[c + j] * slant + centre);
            vector[c + j] = sw_rounded(d * channel[c / 8][SW_ADJOINT_SCALE][j]);
        }
    }
    return factor > 0.0f ? unit * r * largest / factor : 0.0f;
}

/* Values times scales as int16, as fine as their largest allows; returns what one integer stands for. */
static inline float sw_rounded_finely(int16_t *restrict vector, const float *restrict values,
                                      const float *restrict scales, int width)
{
    float peak = 0.0f;
    for (int c = 0; c < width; c++) peak = sw_fmax(peak, sw_abs(values[c] * scales[c]));
    const float factor = peak > 1e-30f ? (float)SW_QMAX(SW_PADDED(width)) / peak : 0.0f;
    for (int c = 0; c < width; c++) vector[c] = sw_rounded(values[c] * scales[c] * factor);
    for (int c = width; c < SW_PADDED(width); c++) vector[c] = 0;
    return factor > 0.0f ? 1.0f / factor : 0.0f;
}

#endif
