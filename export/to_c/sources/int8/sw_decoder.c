/* The decoder: (Cd, Cl) = f_dec(z) for every step of the horizon, and its adjoint, in integers. The steps do not depend
 * on each other, so two steps are computed at a time.
 */
#include "sw_networks.h"
#include "sw_norm.h"

/* Functions marked CALLED are not inlined: copies of them at each call would take 2 KiB of flash. */
#if defined(__GNUC__)
#define CALLED __attribute__((noinline))
#else
#define CALLED
#endif

#if defined(SW_DOTS_DSP_H)
void sw_dots_sixteens(int32_t *restrict y, const int8_t *restrict w, const int16_t *restrict x, int rows, int columns)
{
    int32_t wa, wb, xa, xb, t, u, count, bytes = 2 * columns, sixteens = columns / 16;
    SW_FOUR_ROWS(SW_SIXTEEN_COLUMNS);
}
#endif

/* Multiplies a matrix by the first vector or, if `count` is 2, by both vectors. */
static CALLED void multiply(sw_decoder_scratch *s, const int8_t *matrix, int rows, int columns, int count)
{
    if (count == 2) {
        sw_dots_two(s->sums[0], matrix, s->vector[0], rows, columns);
    } else {
        sw_dots(s->sums[0], matrix, s->vector[0], rows, columns);
    }
}

/* Saturates a layer's input. If the layer uses the full int16 range, -32768 is also allowed. */
static inline int16_t held(int32_t value)
{
    const int32_t qmax = SW_QMAX(SW_DECODER_P);
    return (int16_t)sw_held(value, qmax == SW_INT16_QMAX ? -qmax - 1 : -qmax, qmax);
}

/* Converts the sum of residuals to a layer's input. */
static void round_residuals(int16_t *restrict vector, const int32_t *restrict x, int32_t factor)
{
    SW_EIGHT_TIMES
    for (int o = 0; o < SW_DECODER_P; o++) vector[o] = held(sw_scaled(x[o], factor));
}

/* Adds a block's output, then converts the sum of residuals to a layer's input. */
static void add_residuals(int32_t *restrict x, const int16_t *restrict elu, int16_t *restrict vector, int32_t of_elu,
                          int32_t factor)
{
    SW_EIGHT_TIMES
    for (int o = 0; o < SW_DECODER_P; o++) {
        x[o] = sw_sum(x[o], elu[o] * of_elu);
        vector[o] = held(sw_scaled(x[o], factor));
    }
}

static CALLED void decode_steps(sw_workspace *work, int first, int count)
{
    const sw_weights *w = work->program.weights;
    sw_decoder_tape *tape = &work->phase.tape.decoder;
    sw_decoder_scratch *s = &work->phase.tape.scratch.decoder;
    const float qmax = (float)SW_QMAX(SW_LATENT_P);
    for (int t = 0; t < count; t++) {
        for (int l = 0; l < SW_LATENT_P; l++) s->vector[t][l] = 0;
        for (int l = 0; l < SW_LATENT; l++) {
            s->vector[t][l] = sw_saturated(work->latents[first + t][l] * w->decoder_inverse_scale, qmax);
        }
    }
    multiply(s, w->decoder_rows, SW_DECODER_P, SW_LATENT_P, count);
    for (int t = 0; t < count; t++) {
        SW_EIGHT_TIMES
        for (int o = 0; o < SW_DECODER_P; o++) {
            s->x[t][o] = sw_cut((float)s->sums[t][o] * w->decoder_channel[o / 8][SW_SCALE][o % 8] +
                                w->decoder_channel[o / 8][SW_BIAS][o % 8]);
        }
    }
    for (int t = 0; t < count; t++) round_residuals(s->vector[t], s->x[t], w->residual_factor[0]);
    for (int b = 0; b < SW_BLOCKS; b++) {
        multiply(s, w->block_rows[b], SW_DECODER_P, SW_DECODER_P, count);
        for (int t = 0; t < count; t++) {
            const int k = first + t;
            tape->r[b][k] = sw_norm_elu(s->sums[t], tape->block[b][k], s->hidden, w->block_channel[b],
                                        w->block_layer[b], SW_DECODER);
            add_residuals(s->x[t], s->hidden, s->vector[t], w->residual_of_elu, w->residual_factor[b + 1]);
        }
    }
    multiply(s, w->force_rows, SW_ROWS(2), SW_DECODER_P, count);
    for (int t = 0; t < count; t++) {
        for (int f = 0; f < 2; f++) {
            const float scaled = (float)s->sums[t][f] * w->force_channel[0][SW_SCALE][f] +
                                 w->force_channel[0][SW_BIAS][f];
            work->forces[f][first + t] = scaled * w->force_std[f] + w->force_mean[f];
        }
    }
}

/* Writes x + sums to both arrays. Returns the sums' unit, four times the coarser unit, so that no sum overflows. */
static float add_adjoints(int32_t *restrict x, float unit, int32_t *restrict sums, float unit_of_sums)
{
    const float coarser = 4.0f * sw_fmax(unit, unit_of_sums);
    const int32_t factor = coarser > 0.0f ? sw_factor(unit / coarser) : 0;
    const int32_t factor_of_sums = coarser > 0.0f ? sw_factor(unit_of_sums / coarser) : 0;
    SW_FOUR_TIMES
    for (int o = 0; o < SW_DECODER_P; o++) {
        x[o] = sw_scaled(x[o], factor) + sw_scaled(sums[o], factor_of_sums);
        sums[o] = x[o];
    }
    return coarser;
}

/* Converts x times the first layer's row scales to int16, in the finest possible unit. Returns this unit. */
static float round_adjoints(int16_t *restrict vector, int32_t *restrict x, float unit, const sw_weights *w)
{
    uint32_t bits = 0;
    SW_FOUR_TIMES
    for (int o = 0; o < SW_DECODER_P; o++) {
        x[o] = sw_scaled(x[o], w->decoder_scale[o]);
        bits |= sw_bits_of(x[o]);
    }
    const sw_fine fine = sw_fine_of((float)bits, (float)SW_QMAX(SW_DECODER_P));
    SW_FOUR_TIMES
    for (int o = 0; o < SW_DECODER_P; o++) {
        vector[o] = (int16_t)sw_scaled((int32_t)((uint32_t)x[o] << fine.shift), fine.scaled);
    }
    return fine.factor > 0.0f ? unit * w->decoder_largest / fine.factor : 0.0f;
}

static CALLED void decode_steps_adjoint(sw_workspace *work, int first, int count)
{
    const sw_weights *w = work->program.weights;
    sw_decoder_tape *tape = &work->phase.tape.decoder;
    sw_decoder_scratch *s = &work->phase.tape.scratch.decoder;
    float unit[2], unit_of_sums[2];
    for (int t = 0; t < count; t++) {
        const int k = first + t;
        const float d_forces[2] = {work->d_forces[0][k] * w->force_std[0], work->d_forces[1][k] * w->force_std[1]};
        unit[t] = sw_rounded_finely(s->vector[t], d_forces, w->force_scale, 2);
    }
    multiply(s, w->force_adjoint_rows, SW_DECODER_P, SW_FORCES_P, count);
    for (int t = 0; t < count; t++) {
        for (int o = 0; o < SW_DECODER_P; o++) s->x[t][o] = s->sums[t][o];
    }
    for (int b = SW_BLOCKS - 1; b >= 0; b--) {
        for (int t = 0; t < count; t++) {
            const int k = first + t;
            unit_of_sums[t] = sw_norm_adjoint(s->sums[t], unit[t], s->vector[t], tape->block[b][k],
                                              w->block_adjoint[b], w->block_layer[b], tape->r[b][k], SW_DECODER);
        }
        multiply(s, w->block_adjoint_rows[b], SW_DECODER_P, SW_DECODER_P, count);
        for (int t = 0; t < count; t++) unit[t] = add_adjoints(s->x[t], unit[t], s->sums[t], unit_of_sums[t]);
    }
    for (int t = 0; t < count; t++) unit[t] = round_adjoints(s->vector[t], s->x[t], unit[t], w);
    multiply(s, w->decoder_adjoint_rows, SW_ROWS(SW_LATENT), SW_DECODER_P, count);
    for (int t = 0; t < count; t++) {
        for (int l = 0; l < SW_LATENT; l++) work->d_latents[first + t][l] = (float)s->sums[t][l] * unit[t];
    }
}

void sw_decode(sw_workspace *work)
{
    for (int k = 0; k < SW_HORIZON; k += 2) decode_steps(work, k, k + 1 < SW_HORIZON ? 2 : 1);
}

void sw_decode_adjoint(sw_workspace *work)
{
    for (int k = 0; k < SW_HORIZON; k += 2) decode_steps_adjoint(work, k, k + 1 < SW_HORIZON ? 2 : 1);
}
