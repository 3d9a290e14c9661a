/* The dynamics: z_{k+1} = z_k + f_dyn(z_k, a_k) over the horizon, and their adjoint, which runs backwards. */
#include "sw_kernels.h"
#include "sw_networks.h"
#include "sw_norm.h"
#include "sw_weights.h"

void sw_roll_out(sw_workspace *work)
{
    const sw_weights *w = work->program.weights;
    sw_dynamics_tape *tape = &work->phase.tape.dynamics;
    float state[SW_LATENT + 1], change[SW_LATENT]; /* the latent state and the action */
    for (int l = 0; l < SW_LATENT; l++) state[l] = work->z[l];
    for (int k = 0; k < SW_HORIZON; k++) {
        state[SW_LATENT] = work->plan[k];
        sw_combine(tape->hidden1, w->dyn1_bias, &w->dyn1_weight[0][0], state, SW_LATENT + 1, SW_DYN1_P);
        sw_norm_elu(tape->hidden1, tape->xhat1[k], tape->slope1[k], w->dyn1_gain, w->dyn1_offset, SW_DYN1, SW_DYN1_P);
        sw_combine(tape->hidden2, w->dyn2_bias, &w->dyn2_weight[0][0], tape->hidden1, SW_DYN1, SW_DYN2_P);
        sw_norm_elu(tape->hidden2, tape->xhat2[k], tape->slope2[k], w->dyn2_gain, w->dyn2_offset, SW_DYN2, SW_DYN2_P);
        sw_dots(change, &w->dyn3_weight[0][0], tape->hidden2, SW_LATENT, SW_DYN2_P);
        for (int l = 0; l < SW_LATENT; l++) {
            state[l] += change[l] + w->dyn3_bias[l];
            work->latents[l][k] = state[l];
        }
    }
    for (int l = 0; l < SW_LATENT; l++) {
        for (int k = SW_HORIZON; k < SW_HORIZON_P; k++) work->latents[l][k] = 0.0f;
    }
}

void sw_roll_out_adjoint(sw_workspace *work)
{
    static const float nothing[SW_DYN2_P] = {0};
    const sw_weights *w = work->program.weights;
    sw_dynamics_tape *tape = &work->phase.tape.dynamics;
    float adjoint[SW_LATENT] = {0}, change[SW_LATENT + 1];
    /* sw_dots does not write the padding. */
    for (int c = SW_DYN1; c < SW_DYN1_P; c++) tape->hidden1[c] = 0.0f;
    for (int k = SW_HORIZON - 1; k >= 0; k--) {
        for (int l = 0; l < SW_LATENT; l++) adjoint[l] += work->d_latents[l][k];
        sw_combine(tape->hidden2, nothing, &w->dyn3_weight[0][0], adjoint, SW_LATENT, SW_DYN2_P);
        sw_norm_elu_adjoint(tape->hidden2, tape->xhat2[k], tape->slope2[k], SW_DYN2, SW_DYN2_P);
        sw_dots(tape->hidden1, &w->dyn2_weight[0][0], tape->hidden2, SW_DYN1, SW_DYN2_P);
        sw_norm_elu_adjoint(tape->hidden1, tape->xhat1[k], tape->slope1[k], SW_DYN1, SW_DYN1_P);
        sw_dots(change, &w->dyn1_weight[0][0], tape->hidden1, SW_LATENT + 1, SW_DYN1_P);
        for (int l = 0; l < SW_LATENT; l++) adjoint[l] += change[l];
        work->gradient[k] += change[SW_LATENT];
    }
}
