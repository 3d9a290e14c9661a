/* Layer norm and ELU in one function, and their adjoint, between integer products; all vectors are integers.
 *
 * Forwards, h = ELU(y) with y = gain * xhat + offset, xhat = r * (u - mean(u)), r = 1 / sqrt(var(u) + eps). The tape
 * stores xhat as int16, ELU' as uint8, and r; xhat cannot exceed sqrt(n) and so needs no calibration. Backwards, with t
 * = ELU'(y) * gain * dJ/dh, the adjoint is dJ/du = r * (t - mean(t) - xhat * mean(t * xhat)), and ELU' = min(h, 0) + 1.
 *
 * A norm does not depend on its input's unit, so u is an integer, and each layer has a unit for u, which is as fine as
 * the layer's largest sum allows. Only values that exist once per layer are float. Constants are grouped in eights, for
 * processors that process eight at a time. The constants of the padding are zero, so padding has no effect.
 */
#ifndef SW_NORM_H
#define SW_NORM_H

#include "sw_dots.h"
#include "sw_tables.h"
#include "sw_weights.h"

/* Functions marked SW_ONCE are not inlined, because their unrolled loops would enlarge the caller's stack. */
#if defined(__ARM_FEATURE_DSP) && defined(__thumb2__)
#include "sw_norm_dsp.h"
#define SW_ONCE static __attribute__((noinline, unused))
#else
#include "sw_norm_plain.h"
#define SW_ONCE static inline
#endif

/* Computes xhat, h and ELU' from the sums of a product; returns r. The sums are overwritten. */
static inline float sw_norm_elu(int32_t *restrict sums, sw_tape_eight *restrict tape, int16_t *restrict hidden,
                                const int32_t channel[][4][8], const float layer[2], int width)
{
    int64_t squares = 0;
    const int32_t sum = sw_norm_sums(sums, channel, &squares, width);
    const float mean = (float)sum / (float)width;
    const float variance = sw_float_of(squares) / (float)width - mean * mean;
    const float r = sw_inverse_sqrt(sw_fmax(variance, 0.0f) + layer[SW_LAYER_EPSILON]);
    const float per_unit = r * (SW_XHAT_QMAX * sw_inverse_sqrt((float)width));
    sw_norm_outputs(sums, tape, hidden, channel, sw_factor(per_unit), sw_cut(-mean * per_unit), width);
    return r;
}

/* A scale for rounding numbers within a bound to integers within `top`. `factor` is top / bound, and `scaled` is the
 * same factor for a number that is first shifted left by `shift`, so that sw_scaled loses no digit.
 */
typedef struct {
    float factor;
    int32_t scaled, shift;
} sw_fine;

static inline sw_fine sw_fine_of(float bound, float top)
{
    sw_fine fine = {0.0f, 0, 0};
    const int32_t exponent = (int32_t)(sw_to_bits(bound) >> 23) - 127;
    fine.shift = sw_held(29 - exponent, 0, 29);
    fine.factor = bound < 1.0f ? 0.0f : top / bound;
    fine.scaled = sw_factor(fine.factor * sw_from_bits((uint32_t)(127 - fine.shift) << 23));
    return fine;
}

/* Returns a number that is not negative unchanged; for a negative number, returns its magnitude minus 1. */
static inline uint32_t sw_bits_of(int32_t value) { return (uint32_t)(value ^ (value >> 31)); }

/* Computes dJ/du from dJ/dh; `sums` has dJ/dh in units of `unit`, and is overwritten. Writes dJ/du times the row scales
 * of the matrix before the norm, as int16 for the transposed product. Returns the factor for the product's sums.
 */
SW_ONCE float sw_norm_adjoint(int32_t *restrict sums, float unit, int16_t *restrict vector,
                              const sw_tape_eight *restrict tape, const int32_t channel[][2][8],
                              const float layer[2], float r, int width)
{
    const float one = 512.0f; /* 2^32 / 2^23: 2^23 represents 1 in a scale, but 2^32 represents 1 in sw_scaled */
    const float top = (float)SW_QMAX(SW_PADDED(width)) * one;
    int64_t sum = 0, along = 0;
    uint32_t bits = 0;
    for (int c = 0; c < SW_PADDED(width); c += 8) {
        const int32_t *gain = channel[c / 8][SW_ADJOINT_GAIN];
        SW_EIGHT_TIMES
        for (int j = 0; j < 8; j++) {
            const int32_t value = sw_scaled(sums[c + j], gain[j] * tape[c / 8].slope[j] + gain[j]);
            sums[c + j] = value;
            sum += value;
            along += (int64_t)value * tape[c / 8].xhat[j];
            bits |= sw_bits_of(value);
        }
    }
    /* The tape has X = xhat * SW_XHAT_QMAX / sqrt(n) as an integer, so project * X equals xhat * mean(t * xhat). */
    const float project = sw_float_of(along) * (1.0f / (SW_XHAT_QMAX * SW_XHAT_QMAX));
    const float mean = sw_float_of(sum) / (float)width;
    /* This bound holds for any xhat. It costs one or two bits of precision, but saves a pass over the numbers. */
    const sw_fine fine = sw_fine_of((float)bits + sw_abs(mean) + SW_XHAT_QMAX * sw_abs(project), top);
    const int32_t centre = (int32_t)(-mean * fine.factor), slant = (int32_t)(-project * fine.factor * 65536.0f);
    for (int c = 0; c < SW_PADDED(width); c += 8) {
        const int32_t *scale = channel[c / 8][SW_ADJOINT_SCALE];
        SW_EIGHT_TIMES
        for (int j = 0; j < 8; j++) {
            const int32_t near = centre + sw_scaled((int32_t)((uint32_t)sums[c + j] << fine.shift), fine.scaled);
            vector[c + j] = (int16_t)sw_scaled(sw_scaled_on(near, slant, tape[c / 8].xhat[j]), scale[j]);
        }
    }
    return fine.factor > 0.0f ? unit * r * layer[SW_LAYER_ADJOINT] * one / fine.factor : 0.0f;
}

/* Converts values times scales to int16, in the finest possible unit; returns this unit. */
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
