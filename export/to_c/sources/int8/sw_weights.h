/* The trained program, generated into sw_weights.c. Matrices are int8 with one scale an output: W[o][i] ~ scale[o]
 * q[o][i], laid out as sw_dots.h says. The adjoint has a transposed copy of its own.
 *
 * An activation is step times its int16. Forward steps are constants from calibration; an adjoint's step is found when
 * it is rounded.
 */
#ifndef SW_WEIGHTS_H
#define SW_WEIGHTS_H

#include "sw_workspace.h"

/* Zeros after every matrix, for loads ahead of their use. */
#define SW_AHEAD 16

/* ELU outputs are integers of 1 / SW_ELU_ONE between -1 and 8. */
#define SW_ELU_ONE 4096
#define SW_ELU_START (8 * SW_ELU_ONE)
#define SW_ELU_STEP (SW_ELU_ONE / 32)

/* The integer of a normed value at its bound, sqrt(n) in a layer of width n. */
#define SW_XHAT_MOST 32767.0f

/* ELU at -8, -8 + 1 / 32, .. up to 8, for sw_between. */
extern const uint32_t sw_elu_points[2 * SW_ELU_START / SW_ELU_STEP];

/* The logistic function at -16, -16 + 1 / 32, .. up to 16, in integers of 1 / SW_LOGISTIC_MOST. */
#define SW_LOGISTIC_ONE 16384
#define SW_LOGISTIC_START (16 * SW_LOGISTIC_ONE)
#define SW_LOGISTIC_STEP (SW_LOGISTIC_ONE / 32)
#define SW_LOGISTIC_MOST 32767

extern const uint32_t sw_logistic_points[2 * SW_LOGISTIC_START / SW_LOGISTIC_STEP];

/* Constants of outputs stand in eights. Of an output: value = sum scale + bias; where a norm follows, gain xhat +
 * offset is sw_elu's argument, xhat being an integer of the tape.
 */
enum { SW_SCALE, SW_BIAS, SW_GAIN, SW_OFFSET };

/* Of an output on the way back: its gain, and its row's scale as part of the matrix's largest. */
enum { SW_BACK_GAIN, SW_BACK_PART };

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
extern const int8_t sw_dyn1_back_rows[SW_STATE_P * SW_DYN1_P + SW_AHEAD];
extern const float sw_dyn1_channel[SW_DYN1_P / 8][4][8];
extern const float sw_dyn1_back[SW_DYN1_P / 8][2][8];
extern const int8_t sw_dyn2_rows[SW_DYN2_P * SW_DYN1_P + SW_AHEAD];
extern const int8_t sw_dyn2_back_rows[SW_DYN1_P * SW_DYN2_P + SW_AHEAD];
extern const float sw_dyn2_channel[SW_DYN2_P / 8][4][8];
extern const float sw_dyn2_back[SW_DYN2_P / 8][2][8];
extern const int8_t sw_dyn3_rows[SW_LATENT_P * SW_DYN2_P + SW_AHEAD];
extern const int8_t sw_dyn3_back_rows[SW_DYN2_P * SW_LATENT_P + SW_AHEAD];
extern const float sw_dyn3_channel[SW_LATENT_P / 8][2][8];
extern const float sw_dyn3_scale[SW_LATENT_P];

/* Decoder. */
extern const int8_t sw_decoder_rows[SW_DECODER_P * SW_LATENT_P + SW_AHEAD];
extern const int8_t sw_decoder_back_rows[SW_LATENT_P * SW_DECODER_P + SW_AHEAD];
extern const float sw_decoder_channel[SW_DECODER_P / 8][2][8];
extern const float sw_decoder_scale[SW_DECODER_P];
extern const int8_t sw_block_rows[SW_BLOCKS][SW_DECODER_P * SW_DECODER_P + SW_AHEAD];
extern const int8_t sw_block_back_rows[SW_BLOCKS][SW_DECODER_P * SW_DECODER_P + SW_AHEAD];
extern const float sw_block_channel[SW_BLOCKS][SW_DECODER_P / 8][4][8];
extern const float sw_block_back[SW_BLOCKS][SW_DECODER_P / 8][2][8];
extern const int8_t sw_force_rows[SW_FORCES_P * SW_DECODER_P + SW_AHEAD];
extern const int8_t sw_force_back_rows[SW_DECODER_P * SW_FORCES_P + SW_AHEAD];
extern const float sw_force_channel[SW_FORCES_P / 8][2][8];
extern const float sw_force_scale[SW_FORCES_P];

/* The largest scale of matrices whose rows have a norm behind them. */
extern const float sw_dyn1_largest;
extern const float sw_dyn2_largest;
extern const float sw_block_largest[SW_BLOCKS];

/* Integers per unit of activations: the LSTM's inputs and hidden state, layer inputs. */
extern const float sw_row_levels;
extern const float sw_cell_levels;
extern const float sw_head_levels;
extern const float sw_state_levels;
extern const float sw_decoder_levels;
extern const float sw_block_levels[SW_BLOCKS];
extern const float sw_force_levels;

/* 1 / action_std, the action's factor in the state. */
extern const float sw_action_factor;

/* Optimiser: lr / (1 - b1^i) and 1 / sqrt(1 - b2^i) of iteration i, and the default cost weights. */
extern const float sw_adam_rate[SW_ITERATIONS];
extern const float sw_adam_unbias[SW_ITERATIONS];
extern const float sw_default_weights[7];

#endif
