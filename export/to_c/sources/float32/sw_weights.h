/* The parameters of a trained controller. The generated sw_weights.c defines the parameters that are compiled in. The
 * comment at a matrix states its rows and columns: (inputs, outputs) or (outputs, inputs). Matrices before a norm are
 * centred (sw_norm.h).
 */
#ifndef SW_WEIGHTS_H
#define SW_WEIGHTS_H

#include "sw_workspace.h"

#define SW_CELLS (4 * SW_LSTM_P)

typedef float sw_prior_number; /* type of the prior's matrices (sw_prior_memory.h) */

/* The parameters are read in place: little-endian, no pointers, every member aligned to SW_ALIGNMENT. */
typedef struct sw_weights {
    /* Scaling: the encoder reads (value - mean) * factor for each column; a force is mean + std * output. */
    SW_ALIGNED float window_mean[SW_SENSORS + 1];
    SW_ALIGNED float window_factor[SW_SENSORS + 1];
    SW_ALIGNED float force_mean[2];
    SW_ALIGNED float force_std[2];
    SW_ALIGNED float action_limit; /* largest magnitude of an action, in U_inf W */

    /* Encoder. LSTM gates are in the order i, f, g, o. The LSTM matrix has rows for inputs, then hidden state. */
    SW_ALIGNED float lstm_weight[SW_SENSORS + 1 + SW_LSTM][SW_CELLS];
    SW_ALIGNED float lstm_bias[SW_CELLS];
    SW_ALIGNED float encoder_gain[SW_LSTM_P];
    SW_ALIGNED float encoder_offset[SW_LSTM_P];
    SW_ALIGNED float head_weight[SW_LSTM][SW_HEAD_P]; /* (inputs, outputs) */
    SW_ALIGNED float head_bias[SW_HEAD_P];
    SW_ALIGNED float latent_weight[SW_LATENT][SW_HEAD_P]; /* (outputs, inputs) */
    SW_ALIGNED float latent_bias[SW_LATENT];

    /* Dynamics. The last row of the first layer belongs to the action, in U_inf W. */
    SW_ALIGNED float dyn1_weight[SW_LATENT + 1][SW_DYN1_P]; /* (inputs, outputs), centred */
    SW_ALIGNED float dyn1_bias[SW_DYN1_P];
    SW_ALIGNED float dyn1_gain[SW_DYN1_P];
    SW_ALIGNED float dyn1_offset[SW_DYN1_P];
    SW_ALIGNED float dyn2_weight[SW_DYN1][SW_DYN2_P]; /* (inputs, outputs), centred */
    SW_ALIGNED float dyn2_bias[SW_DYN2_P];
    SW_ALIGNED float dyn2_gain[SW_DYN2_P];
    SW_ALIGNED float dyn2_offset[SW_DYN2_P];
    SW_ALIGNED float dyn3_weight[SW_LATENT][SW_DYN2_P]; /* (outputs, inputs) */
    SW_ALIGNED float dyn3_bias[SW_LATENT];

    /* Decoder; its matrices are not padded. */
    SW_ALIGNED float decoder_weight[SW_DECODER][SW_LATENT]; /* (outputs, inputs) */
    SW_ALIGNED float decoder_bias[SW_DECODER];
    SW_ALIGNED float block_weight[SW_BLOCKS][SW_DECODER][SW_DECODER]; /* (outputs, inputs), centred */
    SW_ALIGNED float block_bias[SW_BLOCKS][SW_DECODER];
    SW_ALIGNED float block_gain[SW_BLOCKS][SW_DECODER];
    SW_ALIGNED float block_offset[SW_BLOCKS][SW_DECODER];
    SW_ALIGNED float force_weight[2][SW_DECODER]; /* (outputs, inputs) */
    SW_ALIGNED float force_bias[2];

    /* Cost and optimiser; adam_rate is lr / (1 - b1^i) and adam_unbias 1 / sqrt(1 - b2^i) in Adam's iteration i. */
    SW_ALIGNED float drag_reference;
    SW_ALIGNED float adam_rate[SW_ITERATIONS];
    SW_ALIGNED float adam_unbias[SW_ITERATIONS];
    SW_ALIGNED float adam_epsilon;
    SW_ALIGNED float default_weights[SW_TERMS];
    SW_ALIGNED float known_answer[2]; /* expected action and cost in sw_known_answer.c; zeros if unknown */
    SW_PRIOR_NUMBERS
} sw_weights;

/* The parameters that are compiled in. */
extern const sw_weights sw_own_weights;
#define SW_OWN_PROGRAM {&sw_own_weights, NULL}

#endif
