/* Layer norm and ELU as one, and their adjoint, between integer products.
 *
 * Forwards, h = ELU(y) with y = gain xhat + offset and xhat = r (u - mean u), r = 1 / sqrt(var u + eps). The tape keeps
 * xhat, which cannot exceed sqrt(n) and so needs no calibration, and h, both as int16, and r. Backwards, with
 * t = ELU'(y) gain dJ/dh, it is dJ/du = r (t - mean t - xhat mean(t xhat)), and ELU' = min(h, 0) + 1.
 */
#ifndef SW_NORM_H
#define SW_NORM_H

#include "sw_integer.h"
#include "sw_weights.h"

#define SW_NORM_EPSILON 1e-5f

/* From the sums of a product to xhat and h; returns r. `values` is scratch, `levels` the integers per unit of h. */
static inline float sw_norm_elu(const int32_t *restrict sums, float *restrict values, int16_t *restrict xhat,
                                int16_t *restrict hidden, const float channel[][4], float levels, int width, int padded)
{
    const float most = (float)SW_LEVELS(padded);
    float sum = 0.0f, squares = 0.0f;
    for (int c = 0; c < width; c++) {
        const float u = (float)sums[c] * channel[c][SW_SCALE] + channel[c][SW_BIAS];
        values[c] = u;
        sum += u;
        squares += u * u;
    }
    const float mean = sum / (float)width;
    const float r = sw_inverse_sqrt(sw_max(squares / (float)width - mean * mean, 0.0f) + SW_NORM_EPSILON);
    const float per_xhat = 32767.0f * sw_inverse_sqrt((float)width);
    const float shift = -mean * r;
    for (int c = 0; c < width; c++) {
        const float normed = values[c] * r + shift;
        const float y = normed * channel[c][SW_GAIN] + channel[c][SW_OFFSET];
        const float h = sw_max(y, 0.0f) + (sw_exp(sw_min(y, 0.0f)) - 1.0f);
        xhat[c] = sw_rounded(normed * per_xhat);
        hidden[c] = sw_rounded(sw_min(h * levels, most));
    }
    for (int c = width; c < padded; c++) {
        xhat[c] = 0;
        hidden[c] = 0;
    }
    return r;
}

/* From dJ/dh, in `d`, to dJ/du times the scales of the rows in front, as int16 for the transposed product. Returns what
 * that product's sums have to be multiplied by. `unit` is what a 1 in `d` stands for.
 */
static inline float sw_norm_elu_adjoint(float *restrict d, float unit, int16_t *restrict vector,
                                        const int16_t *restrict xhat, const int16_t *restrict hidden,
                                        const float back[][2], float largest, float r, float levels, int width,
                                        int padded)
{
    const float per_level = 1.0f / levels;
    const float most = (float)SW_LEVELS(padded);
    float sum = 0.0f, along = 0.0f, peak = 0.0f;
    for (int c = 0; c < width; c++) {
        const float slope = sw_min((float)hidden[c] * per_level, 0.0f) + 1.0f;
        const float t = d[c] * (slope * back[c][SW_BACK_GAIN]);
        d[c] = t;
        sum += t;
        along += t * (float)xhat[c];
        peak = sw_max(peak, sw_abs(t));
    }
    /* xhat's integers are 32767 / sqrt(n) a unit, so this is mean(t xhat) for a xhat in integers. */
    const float project = along * (1.0f / (32767.0f * 32767.0f));
    const float mean = sum / (float)width;
    /* No result exceeds this, whatever xhat is; the bound costs a bit or two and saves a pass. */
    const float bound = peak + sw_abs(mean) + 32767.0f * sw_abs(project);
    const float factor = bound > 1e-30f ? most / bound : 0.0f;
    for (int c = 0; c < width; c++) {
        vector[c] = sw_rounded((d[c] - mean - (float)xhat[c] * project) * (back[c][SW_BACK_PART] * factor));
    }
    for (int c = width; c < padded; c++) vector[c] = 0;
    return factor > 0.0f ? unit * r * largest / factor : 0.0f;
}

/* Values times scales as int16, as fine as their largest allows; returns what one integer stands for. */
static inline float sw_rounded_finely(int16_t *restrict vector, const float *restrict values,
                                      const float *restrict scales, int width, int padded)
{
    float peak = 0.0f;
    for (int c = 0; c < width; c++) peak = sw_max(peak, sw_abs(values[c] * scales[c]));
    const float factor = peak > 1e-30f ? (float)SW_LEVELS(padded) / peak : 0.0f;
    for (int c = 0; c < width; c++) vector[c] = sw_rounded(values[c] * scales[c] * factor);
    for (int c = width; c < padded; c++) vector[c] = 0;
    return factor > 0.0f ? 1.0f / factor : 0.0f;
}

#endif
