/* The trained program, generated into sw_weights.c. Matrices are stored with their shorter side, or their inputs, as
 * rows, so that rows are long; what feeds a norm is centred (sw_norm.h).
 */
#ifndef SW_WEIGHTS_H
#define SW_WEIGHTS_H

#include "sw_workspace.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SW_CELLS (4 * SW_LSTM_P)

/* Scaling: (value - mean) factor of a window's columns, and physical forces = mean + std scaled. */
extern const float sw_window_mean[SW_SENSORS + 1];
extern const float sw_window_factor[SW_SENSORS + 1];
extern const float sw_force_mean[2];
extern const float sw_force_std[2];

/* Encoder. LSTM gates in the order i, f, g, o; its rows are the inputs, then the hidden state. */
extern const float sw_lstm_weight[SW_SENSORS + 1 + SW_LSTM][SW_CELLS];
extern const float sw_lstm_bias[SW_CELLS];
extern const float sw_encoder_gain[SW_LSTM_P];
extern const float sw_encoder_offset[SW_LSTM_P];
extern const float sw_head_weight[SW_LSTM][SW_HEAD_P]; /* (inputs, outputs) */
extern const float sw_head_bias[SW_HEAD_P];
extern const float sw_latent_weight[SW_LATENT][SW_HEAD_P]; /* (outputs, inputs) */
extern const float sw_latent_bias[SW_LATENT];

/* Dynamics. The last row of the first layer belongs to the action, in U_inf W. */
extern const float sw_dyn1_weight[SW_LATENT + 1][SW_DYN1_P]; /* (inputs, outputs), centred */
extern const float sw_dyn1_bias[SW_DYN1_P];
extern const float sw_dyn1_gain[SW_DYN1_P];
extern const float sw_dyn1_offset[SW_DYN1_P];
extern const float sw_dyn2_weight[SW_DYN1][SW_DYN2_P]; /* (inputs, outputs), centred */
extern const float sw_dyn2_bias[SW_DYN2_P];
extern const float sw_dyn2_gain[SW_DYN2_P];
extern const float sw_dyn2_offset[SW_DYN2_P];
extern const float sw_dyn3_weight[SW_LATENT][SW_DYN2_P]; /* (outputs, inputs) */
extern const float sw_dyn3_bias[SW_LATENT];

/* Decoder, not padded. */
extern const float sw_decoder_weight[SW_DECODER][SW_LATENT]; /* (outputs, inputs) */
extern const float sw_decoder_bias[SW_DECODER];
extern const float sw_block_weight[SW_BLOCKS][SW_DECODER][SW_DECODER]; /* (outputs, inputs), centred */
extern const float sw_block_bias[SW_BLOCKS][SW_DECODER];
extern const float sw_block_gain[SW_BLOCKS][SW_DECODER];
extern const float sw_block_offset[SW_BLOCKS][SW_DECODER];
extern const float sw_force_weight[2][SW_DECODER]; /* (outputs, inputs) */
extern const float sw_force_bias[2];

/* Optimiser: lr / (1 - b1^i) and 1 / sqrt(1 - b2^i) of iteration i, and the default cost weights. */
extern const float sw_adam_rate[SW_ITERATIONS];
extern const float sw_adam_unbias[SW_ITERATIONS];
extern const float sw_default_weights[SW_TERMS];

#ifdef __cplusplus
}
#endif

#endif
