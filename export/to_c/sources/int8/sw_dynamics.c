/* The dynamics: z_{k+1} = z_k + f_dyn(z_k, a_k) over the horizon, and their adjoint, which runs backwards. States are
 * computed in float, and layers in integers.
 */
#include "sw_networks.h"
#include "sw_norm.h"

void sw_roll_out(sw_workspace *work)
{
    const sw_weights *w = work->program.weights;
    const sw_hot *hot = work->program.hot;
    sw_dynamics_tape *tape = &work->phase.tape.dynamics;
    sw_dynamics_scratch *s = &work->phase.tape.scratch.dynamics;
    const float qmax = (float)SW_QMAX(SW_STATE_P);
    float state[SW_LATENT];
    for (int l = 0; l < SW_LATENT; l++) state[l] = work->z[l];
    for (int k = 0; k < SW_HORIZON; k++) {
        for (int l = 0; l < SW_STATE_P; l++) s->vector[l] = 0;
        for (int l = 0; l < SW_LATENT; l++) s->vector[l] = sw_saturated(state[l] * w->state_inverse_scale, qmax);
        s->vector[SW_LATENT] = sw_saturated(work->plan[k] * w->action_factor * w->state_inverse_scale, qmax);
        sw_dots(s->sums, hot->dyn1_rows, s->vector, SW_DYN1_P, SW_STATE_P);
        tape->r1[k] = sw_norm_elu(s->sums, tape->layer1[k], s->hidden, w->dyn1_channel, w->dyn1_layer, SW_DYN1);
        sw_dots(s->sums, hot->dyn2_rows, s->hidden, SW_DYN2_P, SW_DYN1_P);
        tape->r2[k] = sw_norm_elu(s->sums, tape->layer2[k], s->hidden, w->dyn2_channel, w->dyn2_layer, SW_DYN2);
        sw_dots(s->sums, hot->dyn3_rows, s->hidden, SW_ROWS(SW_LATENT), SW_DYN2_P);
        for (int l = 0; l < SW_LATENT; l++) {
            state[l] += (float)s->sums[l] * w->dyn3_channel[l / 8][SW_SCALE][l % 8] +
                        w->dyn3_channel[l / 8][SW_BIAS][l % 8];
            work->latents[k][l] = state[l];
        }
    }
}

void sw_roll_out_adjoint(sw_workspace *work)
{
    const sw_weights *w = work->program.weights;
    const sw_hot *hot = work->program.hot;
    sw_dynamics_tape *tape = &work->phase.tape.dynamics;
    sw_dynamics_scratch *s = &work->phase.tape.scratch.dynamics;
    float adjoint[SW_LATENT] = {0};
    for (int k = SW_HORIZON - 1; k >= 0; k--) {
        for (int l = 0; l < SW_LATENT; l++) adjoint[l] += work->d_latents[k][l];
        float unit = sw_rounded_finely(s->vector, adjoint, w->dyn3_scale, SW_LATENT);
        sw_dots(s->sums, hot->dyn3_adjoint_rows, s->vector, SW_DYN2_P, SW_LATENT_P);
        unit = sw_norm_adjoint(s->sums, unit, s->vector, tape->layer2[k], w->dyn2_adjoint, w->dyn2_layer,
                               tape->r2[k], SW_DYN2);
        sw_dots(s->sums, hot->dyn2_adjoint_rows, s->vector, SW_DYN1_P, SW_DYN2_P);
        unit = sw_norm_adjoint(s->sums, unit, s->vector, tape->layer1[k], w->dyn1_adjoint, w->dyn1_layer,
                               tape->r1[k], SW_DYN1);
        sw_dots(s->sums, hot->dyn1_adjoint_rows, s->vector, SW_ROWS(SW_LATENT + 1), SW_DYN1_P);
        for (int l = 0; l < SW_LATENT; l++) adjoint[l] += (float)s->sums[l] * unit;
        work->gradient[k] += (float)s->sums[SW_LATENT] * (unit * w->action_factor);
    }
}
