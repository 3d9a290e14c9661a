/* (Cd, Cl) = f_dec(z) for every step of the horizon, and its adjoint; sums of residuals in float. */
#include "sw_norm.h"
#include "sw_parts.h"

/* The sum of residuals as a layer's input, saturated. */
static void round_residuals(sw_decoder_scratch *s, float levels)
{
    const float most = (float)SW_LEVELS(SW_DECODER_P);
    for (int o = 0; o < SW_DECODER_P; o++) s->vector[o] = sw_saturated(s->x[o] * levels, most);
}

static void decode_step(sw_workspace *work, int k)
{
    sw_decoder_tape *tape = &work->decoder;
    sw_decoder_scratch *s = &work->phase.decoder;
    const float most = (float)SW_LEVELS(SW_LATENT_P);
    for (int l = 0; l < SW_LATENT; l++) s->vector[l] = sw_saturated(work->latents[k][l] * sw_decoder_levels, most);
    for (int l = SW_LATENT; l < SW_LATENT_P; l++) s->vector[l] = 0;
    sw_dots(s->sums, sw_decoder_rows, s->vector, SW_DECODER_P, SW_LATENT_P);
    for (int o = 0; o < SW_DECODER_P; o++) {
        s->x[o] = (float)s->sums[o] * sw_decoder_channel[o][SW_SCALE] + sw_decoder_channel[o][SW_BIAS];
    }
    for (int b = 0; b < SW_BLOCKS; b++) {
        round_residuals(s, sw_block_levels[b]);
        sw_dots(s->sums, sw_block_rows[b], s->vector, SW_ROWS(SW_DECODER), SW_DECODER_P);
        tape->r[b][k] = sw_norm_elu(s->sums, s->values, tape->xhat[b][k], tape->elu[b][k], sw_block_channel[b],
                                    SW_DECODER, SW_DECODER_P);
        for (int o = 0; o < SW_DECODER; o++) s->x[o] += (float)tape->elu[b][k][o] * (1.0f / (float)SW_ELU_ONE);
    }
    round_residuals(s, sw_force_levels);
    sw_dots(s->sums, sw_force_rows, s->vector, SW_ROWS(2), SW_DECODER_P);
    for (int f = 0; f < 2; f++) {
        const float scaled = (float)s->sums[f] * sw_force_channel[f][SW_SCALE] + sw_force_channel[f][SW_BIAS];
        work->forces[f][k] = scaled * sw_force_std[f] + sw_force_mean[f];
    }
}

static void decode_step_adjoint(sw_workspace *work, int k)
{
    sw_decoder_tape *tape = &work->decoder;
    sw_decoder_scratch *s = &work->phase.decoder;
    const float d_forces[2] = {work->d_forces[0][k] * sw_force_std[0], work->d_forces[1][k] * sw_force_std[1]};
    float unit = sw_rounded_finely(s->vector, d_forces, sw_force_scale, 2, SW_FORCES_P);
    sw_dots(s->sums, sw_force_back_rows, s->vector, SW_ROWS(SW_DECODER), SW_FORCES_P);
    for (int o = 0; o < SW_DECODER; o++) s->x[o] = (float)s->sums[o] * unit;
    for (int b = SW_BLOCKS - 1; b >= 0; b--) {
        const int16_t *xhat = tape->xhat[b][k], *elu = tape->elu[b][k];
        sw_gathered all = {0.0f, 0.0f, 0.0f};
        for (int o = 0; o < SW_DECODER; o++) {
            s->values[o] = sw_through_elu(&all, s->x[o], xhat[o], elu[o], sw_block_back[b][o][SW_BACK_GAIN]);
        }
        unit = sw_through_norm(&all, s->values, 1.0f, s->vector, xhat, sw_block_back[b], sw_block_largest[b],
                               tape->r[b][k], SW_DECODER, SW_DECODER_P);
        sw_dots(s->sums, sw_block_back_rows[b], s->vector, SW_ROWS(SW_DECODER), SW_DECODER_P);
        for (int o = 0; o < SW_DECODER; o++) s->x[o] += (float)s->sums[o] * unit;
    }
    unit = sw_rounded_finely(s->vector, s->x, sw_decoder_scale, SW_DECODER, SW_DECODER_P);
    sw_dots(s->sums, sw_decoder_back_rows, s->vector, SW_ROWS(SW_LATENT), SW_DECODER_P);
    for (int l = 0; l < SW_LATENT; l++) work->d_latents[k][l] = (float)s->sums[l] * unit;
}

void sw_decode(sw_workspace *work)
{
    for (int k = 0; k < SW_HORIZON; k++) decode_step(work, k);
}

void sw_decode_adjoint(sw_workspace *work)
{
    for (int k = 0; k < SW_HORIZON; k++) decode_step_adjoint(work, k);
}
