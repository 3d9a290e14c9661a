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

/* The larger of two numbers, neither of which is a NaN. */
static inline float sw_larger(float a, float b)
{
#if defined(__ARM_FEATURE_NUMERIC_MAXMIN)
    return __builtin_fmaxf(a, b);
#else
    return sw_max(a, b);
#endif
}

/* ELU(y) in integers of 1 / SW_ELU_ONE, from y in the same unit plus SW_ELU_START: a straight line between points 1 / 32
 * apart, which is off by half an integer at most. From -8 on downwards and from 8 on upwards it stays.
 */
static inline int16_t sw_elu(int32_t y)
{
    const int32_t held = y < 0 ? 0 : y > 2 * SW_ELU_START - 1 ? 2 * SW_ELU_START - 1 : y;
    const int16_t *point = sw_elu_points[held / SW_ELU_STEP];
    return (int16_t)(point[0] + point[1] * (held % SW_ELU_STEP) / SW_ELU_STEP);
}

/* From the sums of a product to xhat and h; returns r. `values` is scratch. */
static inline float sw_norm_elu(const int32_t *restrict sums, float *restrict values, int16_t *restrict xhat,
                                int16_t *restrict hidden, const float channel[][4], int width, int padded)
{
    float sum = 0.0f, squares = 0.0f;
    for (int c = 0; c < width; c++) {
        const float u = (float)sums[c] * channel[c][SW_SCALE] + channel[c][SW_BIAS];
        values[c] = u;
        sum += u;
        squares += u * u;
    }
    const float mean = sum / (float)width;
    const float r = sw_inverse_sqrt(sw_larger(squares / (float)width - mean * mean, 0.0f) + SW_NORM_EPSILON);
    const float per_xhat = 32767.0f * sw_inverse_sqrt((float)width);
    const float shift = -mean * r;
    for (int c = 0; c < width; c++) {
        const float normed = values[c] * r + shift;
        xhat[c] = sw_rounded(normed * per_xhat);
        hidden[c] = sw_elu((int32_t)(normed * channel[c][SW_GAIN] + channel[c][SW_OFFSET]));
    }
    for (int c = width; c < padded; c++) {
        xhat[c] = 0;
        hidden[c] = 0;
    }
    return r;
}

/* What the first pass of the adjoint gathers over t = ELU'(y) gain dJ/dh. */
typedef struct {
    float sum, along, peak; /* of t, of t xhat, and the largest |t| */
} sw_gathered;

/* t of one output, gathered. */
static inline float sw_through_elu(sw_gathered *all, float d, int16_t xhat, int16_t hidden, float gain)
{
    const int32_t slope = SW_ELU_ONE + (hidden < 0 ? hidden : 0);
    const float t = d * ((float)slope * gain);
    all->sum += t;
    all->along += t * (float)xhat;
    all->peak = sw_larger(all->peak, sw_abs(t));
    return t;
}

/* From t, in `values`, to dJ/du times the scales of the rows in front, as int16 for the transposed product. Returns what
 * that product's sums have to be multiplied by. `unit` is what a 1 in dJ/dh stands for.
 */
static inline float sw_through_norm(const sw_gathered *all, const float *restrict values, float unit,
                                    int16_t *restrict vector, const int16_t *restrict xhat, const float back[][2],
                                    float largest, float r, int width, int padded)
{
    const float most = (float)SW_LEVELS(padded);
    /* xhat's integers are 32767 / sqrt(n) a unit, so this is mean(t xhat) for a xhat in integers. */
    const float project = all->along * (1.0f / (32767.0f * 32767.0f));
    const float mean = all->sum / (float)width;
    /* No result exceeds this, whatever xhat is; the bound costs a bit or two and saves a pass. */
    const float bound = all->peak + sw_abs(mean) + 32767.0f * sw_abs(project);
    const float factor = bound > 1e-30f ? most / bound : 0.0f;
    const float centre = -mean * factor, slant = -project * factor;
    for (int c = 0; c < width; c++) {
        vector[c] = sw_rounded((values[c] * factor + ((float)xhat[c] * slant + centre)) * back[c][SW_BACK_PART]);
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
