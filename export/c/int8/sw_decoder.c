/* (Cd, Cl) = f_dec(z), four steps of the horizon at a time, and its adjoint; sums of residuals in float. */
#include "sw_norm.h"
#include "sw_parts.h"

/* The four rows x as int16, saturated. */
static void round_rows(sw_decoder_scratch *s, float levels)
{
    const float most = (float)SW_LEVELS(SW_DECODER_P);
    for (int j = 0; j < 4; j++) {
        for (int o = 0; o < SW_DECODER_P; o++) s->vector[j][o] = sw_saturated(s->x[j][o] * levels, most);
    }
}

static void decode_four(sw_workspace *work, int k)
{
    sw_decoder_tape *tape = &work->decoder;
    sw_decoder_scratch *s = &work->phase.decoder;
    const float most = (float)SW_LEVELS(SW_LATENT_P);
    for (int j = 0; j < 4; j++) {
        for (int l = 0; l < SW_LATENT; l++) {
            s->vector[j][l] = sw_saturated(work->latents[k + j][l] * sw_decoder_levels, most);
        }
        for (int l = SW_LATENT; l < SW_LATENT_P; l++) s->vector[j][l] = 0;
    }
    sw_product(&s->sums[0][0], sw_decoder_rows, &s->vector[0][0], SW_DECODER_P, SW_LATENT_P, SW_DECODER_ROW);
    for (int j = 0; j < 4; j++) {
        for (int o = 0; o < SW_DECODER_P; o++) {
            s->x[j][o] = (float)s->sums[j][o] * sw_decoder_channel[o][SW_SCALE] + sw_decoder_channel[o][SW_BIAS];
        }
    }
    for (int b = 0; b < SW_BLOCKS; b++) {
        const float per_level = 1.0f / sw_elu_levels[b];
        round_rows(s, sw_block_levels[b]);
        sw_product(&s->sums[0][0], sw_block_rows[b], &s->vector[0][0], SW_DECODER_P, SW_DECODER_P, SW_DECODER_ROW);
        for (int j = 0; j < 4; j++) {
            int16_t *elu = tape->elu[b][k + j];
            tape->r[b][k + j] = sw_norm_elu(s->sums[j], s->values, tape->xhat[b][k + j], elu, sw_block_channel[b],
                                            sw_elu_levels[b], SW_DECODER, SW_DECODER_P);
            for (int o = 0; o < SW_DECODER; o++) s->x[j][o] += (float)elu[o] * per_level;
        }
    }
    round_rows(s, sw_force_levels);
    sw_product(&s->sums[0][0], sw_force_rows, &s->vector[0][0], 2, SW_DECODER_P, SW_DECODER_ROW);
    for (int j = 0; j < 4; j++) {
        for (int f = 0; f < 2; f++) {
            const float scaled = (float)s->sums[j][f] * sw_force_channel[f][SW_SCALE] + sw_force_channel[f][SW_BIAS];
            work->forces[f][k + j] = scaled * sw_force_std[f] + sw_force_mean[f];
        }
    }
}

static void decode_four_adjoint(sw_workspace *work, int k)
{
    sw_decoder_tape *tape = &work->decoder;
    sw_decoder_scratch *s = &work->phase.decoder;
    float unit[4];
    for (int j = 0; j < 4; j++) {
        const float d[2] = {work->d_forces[0][k + j] * sw_force_std[0], work->d_forces[1][k + j] * sw_force_std[1]};
        unit[j] = sw_rounded_finely(s->vector[j], d, sw_force_scale, 2, 2);
    }
    sw_product_transposed(&s->sums[0][0], sw_force_rows, &s->vector[0][0], 2, SW_DECODER_P, SW_DECODER_ROW);
    for (int j = 0; j < 4; j++) {
        for (int o = 0; o < SW_DECODER_P; o++) s->x[j][o] = (float)s->sums[j][o] * unit[j];
    }
    for (int b = SW_BLOCKS - 1; b >= 0; b--) {
        for (int j = 0; j < 4; j++) {
            for (int o = 0; o < SW_DECODER; o++) s->values[o] = s->x[j][o];
            unit[j] = sw_norm_elu_adjoint(s->values, 1.0f, s->vector[j], tape->xhat[b][k + j], tape->elu[b][k + j],
                                          sw_block_back[b], sw_block_largest[b], tape->r[b][k + j], sw_elu_levels[b],
                                          SW_DECODER, SW_DECODER_P);
        }
        sw_product_transposed(&s->sums[0][0], sw_block_rows[b], &s->vector[0][0], SW_DECODER_P, SW_DECODER_P,
                              SW_DECODER_ROW);
        for (int j = 0; j < 4; j++) {
            for (int o = 0; o < SW_DECODER_P; o++) s->x[j][o] += (float)s->sums[j][o] * unit[j];
        }
    }
    for (int j = 0; j < 4; j++) {
        unit[j] = sw_rounded_finely(s->vector[j], s->x[j], sw_decoder_scale, SW_DECODER, SW_DECODER_P);
    }
    sw_product_transposed(&s->sums[0][0], sw_decoder_rows, &s->vector[0][0], SW_DECODER_P, SW_LATENT_P, SW_DECODER_ROW);
    for (int j = 0; j < 4; j++) {
        for (int l = 0; l < SW_LATENT; l++) work->d_latents[k + j][l] = (float)s->sums[j][l] * unit[j];
    }
}

void sw_decode(sw_workspace *work)
{
    for (int k = 0; k < SW_HORIZON_P; k += 4) decode_four(work, k);
}

void sw_decode_adjoint(sw_workspace *work)
{
    for (int k = 0; k < SW_HORIZON_P; k += 4) decode_four_adjoint(work, k);
}
