/* The decoder: (Cd, Cl) = f_dec(z) for all steps of the horizon, and its adjoint. Each step has separate norms. */
#include "sw_kernels.h"
#include "sw_math.h"
#include "sw_networks.h"
#include "sw_norm.h"
#include "sw_weights.h"

static void fill(float rows[][SW_HORIZON_P], const float *values, int count)
{
    for (int o = 0; o < count; o++) {
        for (int t = 0; t < SW_HORIZON_P; t++) rows[o][t] = values[o];
    }
}

/* Computes x += ELU(LN(u)), with u in tape->y. */
static void block_forward(sw_decoder_tape *tape, const sw_weights *w, int b)
{
    float r[SW_HORIZON_P] = {0};
    for (int o = 0; o < SW_DECODER; o++) {
        for (int t = 0; t < SW_HORIZON_P; t++) r[t] += tape->y[o][t] * tape->y[o][t];
    }
    for (int t = 0; t < SW_HORIZON_P; t++) r[t] = sw_inverse_sqrt(r[t] / (float)SW_DECODER + SW_NORM_EPSILON);
    for (int o = 0; o < SW_DECODER; o++) {
        const float gain = w->block_gain[b][o], offset = w->block_offset[b][o];
        float *restrict xhat = tape->xhat[b][o], *restrict slope = tape->slope[b][o], *restrict x = tape->x[o];
        const float *u = tape->y[o];
        for (int t = 0; t < SW_HORIZON_P; t++) {
            const float normed = r[t] * u[t];
            const float y = gain * normed + offset;
            const float below = sw_exp(sw_min(y, 0.0f));
            xhat[t] = normed;
            slope[t] = below * (gain * r[t]);
            x[t] += sw_max(y, 0.0f) + (below - 1.0f);
        }
    }
}

/* Computes dJ/du into tape->y from dJ/dx in tape->x. */
static void block_adjoint(sw_decoder_tape *tape, int b)
{
    float along[SW_HORIZON_P] = {0};
    for (int o = 0; o < SW_DECODER; o++) {
        const float *xhat = tape->xhat[b][o], *slope = tape->slope[b][o], *d = tape->x[o];
        float *restrict y = tape->y[o];
        for (int t = 0; t < SW_HORIZON_P; t++) {
            y[t] = d[t] * slope[t];
            along[t] += y[t] * xhat[t];
        }
    }
    for (int t = 0; t < SW_HORIZON_P; t++) along[t] /= (float)SW_DECODER;
    for (int o = 0; o < SW_DECODER; o++) {
        for (int t = 0; t < SW_HORIZON_P; t++) tape->y[o][t] -= along[t] * tape->xhat[b][o][t];
    }
}

void sw_decode(sw_workspace *work)
{
    const sw_weights *w = work->program.weights;
    sw_decoder_tape *tape = &work->phase.tape.decoder;
    fill(tape->x, w->decoder_bias, SW_DECODER);
    sw_product(&tape->x[0][0], &w->decoder_weight[0][0], SW_LATENT, 1, &work->latents[0][0], SW_DECODER, SW_LATENT);
    for (int b = 0; b < SW_BLOCKS; b++) {
        fill(tape->y, w->block_bias[b], SW_DECODER);
        sw_product(&tape->y[0][0], &w->block_weight[b][0][0], SW_DECODER, 1, &tape->x[0][0], SW_DECODER, SW_DECODER);
        block_forward(tape, w, b);
    }
    fill(work->forces, w->force_bias, 2);
    sw_product(&work->forces[0][0], &w->force_weight[0][0], SW_DECODER, 1, &tape->x[0][0], 2, SW_DECODER);
    for (int f = 0; f < 2; f++) {
        for (int t = 0; t < SW_HORIZON_P; t++) {
            work->forces[f][t] = work->forces[f][t] * w->force_std[f] + w->force_mean[f];
        }
    }
}

void sw_decode_adjoint(sw_workspace *work)
{
    static const float nothing[SW_DECODER + SW_LATENT] = {0};
    const sw_weights *w = work->program.weights;
    sw_decoder_tape *tape = &work->phase.tape.decoder;
    for (int f = 0; f < 2; f++) {
        for (int t = 0; t < SW_HORIZON_P; t++) work->d_forces[f][t] *= w->force_std[f];
    }
    fill(tape->x, nothing, SW_DECODER);
    sw_product(&tape->x[0][0], &w->force_weight[0][0], 1, SW_DECODER, &work->d_forces[0][0], SW_DECODER, 2);
    for (int b = SW_BLOCKS - 1; b >= 0; b--) {
        block_adjoint(tape, b);
        sw_product(&tape->x[0][0], &w->block_weight[b][0][0], 1, SW_DECODER, &tape->y[0][0], SW_DECODER, SW_DECODER);
    }
    fill(work->d_latents, nothing, SW_LATENT);
    sw_product(&work->d_latents[0][0], &w->decoder_weight[0][0], 1, SW_LATENT, &tape->x[0][0], SW_LATENT, SW_DECODER);
}
