/* (Cd, Cl) = f_dec(z) for every step of the horizon, and its adjoint; sums of residuals in float. No step waits for
 * another, so they are taken two at a time.
 */
#include "sw_norm.h"
#include "sw_parts.h"

/* Products for the first one or for both of the vectors. */
static void multiply(sw_decoder_scratch *s, const int8_t *w, int rows, int columns, int count)
{
    if (count == 2) {
        sw_dots_two(s->sums[0], w, s->vector[0], rows, columns);
    } else {
        sw_dots(s->sums[0], w, s->vector[0], rows, columns);
    }
}

/* The sum of residuals as a layer's input, saturated. */
static void round_residuals(int16_t *restrict vector, const float *restrict x, float inverse_scale)
{
    const float qmax = (float)SW_QMAX(SW_DECODER_P);
    for (int o = 0; o < SW_DECODER_P; o++) vector[o] = sw_saturated(x[o] * inverse_scale, qmax);
}

/* The same after a block's output has been added. */
static void add_residuals(float *restrict x, const int16_t *restrict elu, int16_t *restrict vector, float inverse_scale)
{
    const float qmax = (float)SW_QMAX(SW_DECODER_P);
    for (int o = 0; o < SW_DECODER_P; o++) {
        x[o] += (float)elu[o] * (1.0f / (float)SW_ELU_ONE);
        vector[o] = sw_saturated(x[o] * inverse_scale, qmax);
    }
}

static void decode_steps(sw_workspace *work, int first, int count)
{
    sw_decoder_tape *tape = &work->decoder;
    sw_decoder_scratch *s = &work->phase.decoder;
    const float qmax = (float)SW_QMAX(SW_LATENT_P);
    for (int t = 0; t < count; t++) {
        for (int l = 0; l < SW_LATENT_P; l++) s->vector[t][l] = 0;
        for (int l = 0; l < SW_LATENT; l++) {
            s->vector[t][l] = sw_saturated(work->latents[first + t][l] * sw_decoder_inverse_scale, qmax);
        }
    }
    multiply(s, sw_decoder_rows, SW_DECODER_P, SW_LATENT_P, count);
    for (int t = 0; t < count; t++) {
        for (int o = 0; o < SW_DECODER_P; o++) {
            s->x[t][o] = (float)s->sums[t][o] * sw_decoder_channel[o / 8][SW_SCALE][o % 8] +
                         sw_decoder_channel[o / 8][SW_BIAS][o % 8];
        }
    }
    for (int t = 0; t < count; t++) round_residuals(s->vector[t], s->x[t], sw_block_inverse_scale[0]);
    for (int b = 0; b < SW_BLOCKS; b++) {
        const float inverse_scale = b + 1 < SW_BLOCKS ? sw_block_inverse_scale[b + 1] : sw_force_inverse_scale;
        multiply(s, sw_block_rows[b], SW_DECODER_P, SW_DECODER_P, count);
        for (int t = 0; t < count; t++) {
            const int k = first + t;
            tape->r[b][k] = sw_norm_elu(s->sums[t], s->values, tape->xhat[b][k], tape->elu[b][k], sw_block_channel[b],
                                        SW_DECODER);
            add_residuals(s->x[t], tape->elu[b][k], s->vector[t], inverse_scale);
        }
    }
    multiply(s, sw_force_rows, SW_ROWS(2), SW_DECODER_P, count);
    for (int t = 0; t < count; t++) {
        for (int f = 0; f < 2; f++) {
            const float scaled = (float)s->sums[t][f] * sw_force_channel[0][SW_SCALE][f] +
                                 sw_force_channel[0][SW_BIAS][f];
            work->forces[f][first + t] = scaled * sw_force_std[f] + sw_force_mean[f];
        }
    }
}

static void decode_steps_adjoint(sw_workspace *work, int first, int count)
{
    sw_decoder_tape *tape = &work->decoder;
    sw_decoder_scratch *s = &work->phase.decoder;
    float unit[2];
    for (int t = 0; t < count; t++) {
        const int k = first + t;
        const float d_forces[2] = {work->d_forces[0][k] * sw_force_std[0], work->d_forces[1][k] * sw_force_std[1]};
        unit[t] = sw_rounded_finely(s->vector[t], d_forces, sw_force_scale, 2);
    }
    multiply(s, sw_force_adjoint_rows, SW_DECODER_P, SW_FORCES_P, count);
    for (int t = 0; t < count; t++) {
        for (int o = 0; o < SW_DECODER_P; o++) s->x[t][o] = (float)s->sums[t][o] * unit[t];
    }
    for (int b = SW_BLOCKS - 1; b >= 0; b--) {
        for (int t = 0; t < count; t++) {
            const int16_t *xhat = tape->xhat[b][first + t], *elu = tape->elu[b][first + t];
            sw_gathered all = {{0}, {0}, {0}};
            for (int o = 0; o < SW_DECODER_P; o += 8) {
                float d[8];
                for (int j = 0; j < 8; j++) {
                    d[j] = s->x[t][o + j] * ((float)sw_elu_slope(elu[o + j]) * (1.0f / (float)SW_ELU_ONE));
                }
                sw_gather(&all, s->values + o, d, xhat + o, sw_block_adjoint[b][o / 8][SW_ADJOINT_GAIN]);
            }
            unit[t] = sw_norm_adjoint(&all, s->values, 1.0f, s->vector[t], xhat, sw_block_adjoint[b],
                                      sw_block_largest[b], tape->r[b][first + t], SW_DECODER);
        }
        multiply(s, sw_block_adjoint_rows[b], SW_DECODER_P, SW_DECODER_P, count);
        for (int t = 0; t < count; t++) {
            for (int o = 0; o < SW_DECODER_P; o++) s->x[t][o] += (float)s->sums[t][o] * unit[t];
        }
    }
    for (int t = 0; t < count; t++) {
        unit[t] = sw_rounded_finely(s->vector[t], s->x[t], sw_decoder_scale, SW_DECODER);
    }
    multiply(s, sw_decoder_adjoint_rows, SW_ROWS(SW_LATENT), SW_DECODER_P, count);
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
