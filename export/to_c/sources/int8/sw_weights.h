/* The trained program, generated into sw_weights.c. Matrices are int8 with one scale an output, W[o][i] ~ scale[o]
 * q[o][i]. They are laid out as in sw_dots.h, and SW_AHEAD zeros follow each for loads ahead of their use. The adjoint
 * has a transposed copy of its own.
 *
 * An activation is scale times its int16. Forward scales are constants from calibration; an adjoint's scale is found
 * when it is rounded.
 */
#ifndef SW_WEIGHTS_H
#define SW_WEIGHTS_H

#include "sw_workspace.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Tables: where the argument 0 stands, and the distance between points, in integers of the argument. */
#define SW_ELU_START (SW_ELU_RANGE * SW_ELU_ARGUMENT_ONE)
#define SW_ELU_STEP (SW_ELU_ARGUMENT_ONE / SW_POINTS_PER_UNIT)
#define SW_LOGISTIC_START (SW_LOGISTIC_RANGE * SW_LOGISTIC_ONE)
#define SW_LOGISTIC_STEP (SW_LOGISTIC_ONE / SW_POINTS_PER_UNIT)

/* Tables for sw_between (sw_tables.h). */
extern const uint32_t sw_elu_points[2 * SW_ELU_START / SW_ELU_STEP];
extern const uint32_t sw_logistic_points[2 * SW_LOGISTIC_START / SW_LOGISTIC_STEP];

/* Constants of outputs stand in eights. Of an output: value = sum scale + bias. Where a norm follows all are integers:
 * the value, in a unit of its layer, is sw_scaled(sum, scale) + bias, and sw_scaled_on(offset, gain, xhat) is sw_elu's
 * argument, xhat being an integer of the tape, SW_XHAT_QMAX at its bound, sqrt(n) in a layer of width n.
 */
enum { SW_SCALE, SW_BIAS, SW_GAIN, SW_OFFSET };

/* Of an output in the adjoint: its gain as part of the layer's largest, in 1 / 2^22, and its row's scale as part of the
 * matrix's largest, in 1 / 2^23.
 */
enum { SW_ADJOINT_GAIN, SW_ADJOINT_SCALE };

/* Of a layer with a norm: epsilon in its unit, and the unit of its adjoint. */
enum { SW_LAYER_EPSILON, SW_LAYER_ADJOINT };

/* Scaling: (value - mean) factor of a window's columns, and physical forces = mean + std scaled. */
extern const float sw_window_mean[SW_SENSORS + 1];
extern const float sw_window_factor[SW_SENSORS + 1];
extern const float sw_force_mean[2];
extern const float sw_force_std[2];

/* Encoder. LSTM gates in the order i, f, g, o. */
extern const int8_t sw_lstm_input_rows[4 * SW_LSTM_P * SW_ROW_P + SW_AHEAD];
extern const int8_t sw_lstm_hidden_rows[4 * SW_LSTM_P * SW_LSTM_P + SW_AHEAD];
extern const float sw_lstm_channel[4 * SW_LSTM_P / 8][3][8]; /* input scale, hidden scale, bias of a table's argument */
extern const float sw_encoder_gain[SW_LSTM_P];
extern const float sw_encoder_offset[SW_LSTM_P];
extern const int8_t sw_head_rows[SW_HEAD_P * SW_LSTM_P + SW_AHEAD];
extern const float sw_head_channel[SW_HEAD_P / 8][2][8];
extern const int8_t sw_latent_rows[SW_LATENT_P * SW_HEAD_P + SW_AHEAD];
extern const float sw_latent_channel[SW_LATENT_P / 8][2][8];

/* Dynamics. The last column of the first layer belongs to the action over its standard deviation. */
extern const int8_t sw_dyn1_rows[SW_DYN1_P * SW_STATE_P + SW_AHEAD];
extern const int8_t sw_dyn1_adjoint_rows[SW_STATE_P * SW_DYN1_P + SW_AHEAD];
extern const int32_t sw_dyn1_channel[SW_DYN1_P / 8][4][8];
extern const int32_t sw_dyn1_adjoint[SW_DYN1_P / 8][2][8];
extern const float sw_dyn1_layer[2];
extern const int8_t sw_dyn2_rows[SW_DYN2_P * SW_DYN1_P + SW_AHEAD];
extern const int8_t sw_dyn2_adjoint_rows[SW_DYN1_P * SW_DYN2_P + SW_AHEAD];
extern const int32_t sw_dyn2_channel[SW_DYN2_P / 8][4][8];
extern const int32_t sw_dyn2_adjoint[SW_DYN2_P / 8][2][8];
extern const float sw_dyn2_layer[2];
extern const int8_t sw_dyn3_rows[SW_LATENT_P * SW_DYN2_P + SW_AHEAD];
extern const int8_t sw_dyn3_adjoint_rows[SW_DYN2_P * SW_LATENT_P + SW_AHEAD];
extern const float sw_dyn3_channel[SW_LATENT_P / 8][2][8];
extern const float sw_dyn3_scale[SW_LATENT_P];

/* Decoder. */
extern const int8_t sw_decoder_rows[SW_DECODER_P * SW_LATENT_P + SW_AHEAD];
extern const int8_t sw_decoder_adjoint_rows[SW_LATENT_P * SW_DECODER_P + SW_AHEAD];
extern const float sw_decoder_channel[SW_DECODER_P / 8][2][8];
extern const int32_t sw_decoder_scale[SW_DECODER_P]; /* as part of the largest, in 1 / 2^31 */
extern const float sw_decoder_largest;
extern const int8_t sw_block_rows[SW_BLOCKS][SW_DECODER_P * SW_DECODER_P + SW_AHEAD];
extern const int8_t sw_block_adjoint_rows[SW_BLOCKS][SW_DECODER_P * SW_DECODER_P + SW_AHEAD];
extern const int32_t sw_block_channel[SW_BLOCKS][SW_DECODER_P / 8][4][8];
extern const int32_t sw_block_adjoint[SW_BLOCKS][SW_DECODER_P / 8][2][8];
extern const float sw_block_layer[SW_BLOCKS][2];
extern const int8_t sw_force_rows[SW_FORCES_P * SW_DECODER_P + SW_AHEAD];
extern const int8_t sw_force_adjoint_rows[SW_DECODER_P * SW_FORCES_P + SW_AHEAD];
extern const float sw_force_channel[SW_FORCES_P / 8][2][8];
extern const float sw_force_scale[SW_FORCES_P];

/* Inverse scales, integers per unit, of activations: the LSTM's inputs and hidden state, layer inputs. */
extern const float sw_row_inverse_scale;
extern const float sw_cell_inverse_scale;
extern const float sw_head_inverse_scale;
extern const float sw_state_inverse_scale;
extern const float sw_decoder_inverse_scale;

/* The decoder's sum of residuals has a unit of its own: what an ELU's 1 is in it, and factors for sw_scaled that make it
 * the input of each block and of the last layer.
 */
extern const int32_t sw_residual_of_elu;
extern const int32_t sw_residual_factor[SW_BLOCKS + 1];

/* 1 / action_std, the action's factor in the state. */
extern const float sw_action_factor;

/* Optimiser: lr / (1 - b1^i) and 1 / sqrt(1 - b2^i) of iteration i, and the default cost weights. */
extern const float sw_adam_rate[SW_ITERATIONS];
extern const float sw_adam_unbias[SW_ITERATIONS];
extern const float sw_default_weights[SW_TERMS];

#ifdef __cplusplus
}
#endif

#endif
