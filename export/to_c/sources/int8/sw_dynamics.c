/* z_{k+1} = z_k + f_dyn(z_k, a_k) over the horizon and its adjoint backwards: states in float, products in integers. */
#include "sw_norm.h"
#include "sw_parts.h"

void sw_roll_out(sw_workspace *work)
{
    sw_dynamics_tape *tape = &work->dynamics;
    sw_dynamics_scratch *s = &work->phase.dynamics;
    const float qmax = (float)SW_QMAX(SW_STATE_P);
    float state[SW_LATENT];
    for (int l = 0; l < SW_LATENT; l++) state[l] = work->z[l];
    for (int k = 0; k < SW_HORIZON; k++) {
        for (int l = 0; l < SW_STATE_P; l++) s->vector[l] = 0;
        for (int l = 0; l < SW_LATENT; l++) s->vector[l] = sw_saturated(state[l] * sw_state_inverse_scale, qmax);
        s->vector[SW_LATENT] = sw_saturated(work->plan[k] * sw_action_factor * sw_state_inverse_scale, qmax);
        sw_dots(s->sums, sw_dyn1_rows, s->vector, SW_DYN1_P, SW_STATE_P);
        tape->r1[k] = sw_norm_elu(s->sums, s->values, tape->xhat1[k], tape->hidden1[k], sw_dyn1_channel, SW_DYN1);
        sw_dots(s->sums, sw_dyn2_rows, tape->hidden1[k], SW_DYN2_P, SW_DYN1_P);
        tape->r2[k] = sw_norm_elu(s->sums, s->values, tape->xhat2[k], tape->hidden2[k], sw_dyn2_channel, SW_DYN2);
        sw_dots(s->sums, sw_dyn3_rows, tape->hidden2[k], SW_ROWS(SW_LATENT), SW_DYN2_P);
        for (int l = 0; l < SW_LATENT; l++) {
            state[l] += (float)s->sums[l] * sw_dyn3_channel[l / 8][SW_SCALE][l % 8] +
                        sw_dyn3_channel[l / 8][SW_BIAS][l % 8];
            work->latents[k][l] = state[l];
        }
    }
}

/* An adjoint times ELU' stays an integer, in a unit SW_SLOPE_PART times as large, which is small beside the sums. */
#define SW_SLOPE_PART 4

/* From dJ/dh, in s->sums, to dJ/du, in s->vector; returns the next product's unit. */
static inline float adjoint_of_layer(sw_dynamics_scratch *s, float unit, const int16_t *xhat, const int16_t *hidden,
                                     const float channel[][2][8], float largest, float r, int width)
{
    sw_gathered all = {{0}, {0}, {0}};
    for (int c = 0; c < SW_PADDED(width); c += 8) {
        float d[8];
        for (int j = 0; j < 8; j++) {
            /* ELU' in 1 / 16384, so the upper bits of 32 bits times 16 are the product over SW_SLOPE_PART. */
            const int16_t slope = (int16_t)(sw_elu_slope(hidden[c + j]) * (65536 / SW_SLOPE_PART / SW_ELU_ONE));
            d[j] = (float)(int32_t)((int64_t)s->sums[c + j] * slope >> 16);
        }
        sw_gather(&all, s->values + c, d, xhat + c, channel[c / 8][SW_ADJOINT_GAIN]);
    }
    return sw_norm_adjoint(&all, s->values, unit * (float)SW_SLOPE_PART, s->vector, xhat, channel, largest, r, width);
}

void sw_roll_out_adjoint(sw_workspace *work)
{
    sw_dynamics_tape *tape = &work->dynamics;
    sw_dynamics_scratch *s = &work->phase.dynamics;
    float adjoint[SW_LATENT] = {0};
    for (int k = SW_HORIZON - 1; k >= 0; k--) {
        for (int l = 0; l < SW_LATENT; l++) adjoint[l] += work->d_latents[k][l];
        float unit = sw_rounded_finely(s->vector, adjoint, sw_dyn3_scale, SW_LATENT);
        sw_dots(s->sums, sw_dyn3_adjoint_rows, s->vector, SW_DYN2_P, SW_LATENT_P);
        unit = adjoint_of_layer(s, unit, tape->xhat2[k], tape->hidden2[k], sw_dyn2_adjoint, sw_dyn2_largest,
                                tape->r2[k], SW_DYN2);
        sw_dots(s->sums, sw_dyn2_adjoint_rows, s->vector, SW_DYN1_P, SW_DYN2_P);
        unit = adjoint_of_layer(s, unit, tape->xhat1[k], tape->hidden1[k], sw_dyn1_adjoint, sw_dyn1_largest,
                                tape->r1[k], SW_DYN1);
        sw_dots(s->sums, sw_dyn1_adjoint_rows, s->vector, SW_ROWS(SW_LATENT + 1), SW_DYN1_P);
        for (int l = 0; l < SW_LATENT; l++) adjoint[l] += (float)s->sums[l] * unit;
        work->gradient[k] += (float)s->sums[SW_LATENT] * (unit * sw_action_factor);
    }
}
