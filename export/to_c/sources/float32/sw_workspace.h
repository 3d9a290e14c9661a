/* The scratch memory of a control step. This structure is public only because the caller provides the memory. */
#ifndef SW_WORKSPACE_H
#define SW_WORKSPACE_H

#include "sw_prior_memory.h"
#include "sw_program.h"
#include "sw_settings.h"

#define SW_LSTM_P SW_PADDED(SW_LSTM)
#define SW_HEAD_P SW_PADDED(SW_HEAD)
#define SW_DYN1_P SW_PADDED(SW_DYN1)
#define SW_DYN2_P SW_PADDED(SW_DYN2)
#define SW_HORIZON_P SW_PADDED(SW_HORIZON)

/* The forward pass's results that the adjoint needs (sw_norm.h), and the forward pass's inputs. */
typedef struct {
    float xhat1[SW_HORIZON][SW_DYN1_P];
    float slope1[SW_HORIZON][SW_DYN1_P];
    float xhat2[SW_HORIZON][SW_DYN2_P];
    float slope2[SW_HORIZON][SW_DYN2_P];
    float hidden1[SW_DYN1_P];
    float hidden2[SW_DYN2_P];
} sw_dynamics_tape;

/* The decoder processes all steps of the horizon together: the step is the last index of every array. */
typedef struct {
    float xhat[SW_BLOCKS][SW_DECODER][SW_HORIZON_P];
    float slope[SW_BLOCKS][SW_DECODER][SW_HORIZON_P];
    float x[SW_DECODER][SW_HORIZON_P];
    float y[SW_DECODER][SW_HORIZON_P];
} sw_decoder_tape;

typedef struct {
    float gates[4 * SW_LSTM_P];
    float hidden[SW_SENSORS + 1 + SW_LSTM]; /* row of the window, then the hidden state */
    float cell[SW_LSTM_P];
    float normed[SW_LSTM_P];
    float head[SW_HEAD_P];
} sw_encoder_scratch;

typedef struct sw_workspace {
    sw_program program;                       /* the running program */
    float z[SW_LATENT];                       /* present latent state */
    float latents[SW_LATENT][SW_HORIZON_P];   /* latent states 1 to SW_HORIZON steps ahead */
    float forces[2][SW_HORIZON_P];            /* Cd, then Cl */
    float d_forces[2][SW_HORIZON_P];          /* dJ/d(Cd, Cl): derivatives of the cost J */
    float d_latents[SW_LATENT][SW_HORIZON_P]; /* dJ/dz through the forces alone */
    float limit; /* bound on an action in this control step */
    float plan[SW_HORIZON];
    float start[SW_HORIZON];    /* the optimiser's initial plan */
    float gradient[SW_HORIZON]; /* dJ/da */
    float moment1[SW_HORIZON];  /* Adam's moments m and v */
    float moment2[SW_HORIZON];
    union {
        sw_prior_scratch prior;
        sw_encoder_scratch encoder;
        struct {
            sw_dynamics_tape dynamics;
            sw_decoder_tape decoder;
        } tape;
    } phase;
} sw_workspace;

#endif
