/* The parameters of a trained controller. The generated sw_weights.c defines the compiled-in parameters. Matrices are
 * int8 with one scale for each output, W[o][i] ~ scale[o] * q[o][i]. sw_dots.h states their layout. SW_AHEAD zeros
 * follow each matrix, because weights are loaded ahead of their use. The adjoint has a transposed copy of each matrix.
 *
 * An activation is a scale times an int16. The scales of the forward pass are constants from a calibration. The scale
 * of an adjoint is computed when the adjoint is rounded.
 */
#ifndef SW_WEIGHTS_H
#define SW_WEIGHTS_H

#include "sw_workspace.h"

/* Tables: position of the argument 0, and distance between points, in units of the tables' integer argument. */
#define SW_ELU_START (SW_ELU_RANGE * SW_ELU_ARGUMENT_ONE)
#define SW_ELU_STEP (SW_ELU_ARGUMENT_ONE / SW_POINTS_PER_UNIT)
#define SW_LOGISTIC_START (SW_LOGISTIC_RANGE * SW_LOGISTIC_ONE)
#define SW_LOGISTIC_STEP (SW_LOGISTIC_ONE / SW_POINTS_PER_UNIT)

/* Tables for sw_between (sw_tables.h), which are the same for every program. */
extern const uint32_t sw_elu_points[2 * SW_ELU_START / SW_ELU_STEP];
extern const uint32_t sw_logistic_points[2 * SW_LOGISTIC_START / SW_LOGISTIC_STEP];

/* Constants of outputs, grouped in eights: value = sum * scale + bias. Before a norm all constants are integers: the
 * value is sw_scaled(sum, scale) + bias in the layer's unit, and the argument of sw_elu is sw_scaled_on(offset, gain,
 * xhat). Here xhat is the integer on the tape. SW_XHAT_QMAX represents sqrt(n), the largest xhat for a layer's width n.
 */
enum { SW_SCALE, SW_BIAS, SW_GAIN, SW_OFFSET };

/* Constants of an output in the adjoint: its gain relative to the layer's largest gain, in units of 1 / 2^22, and its
 * row's scale relative to the matrix's largest scale, in units of 1 / 2^23.
 */
enum { SW_ADJOINT_GAIN, SW_ADJOINT_SCALE };

/* Constants of a layer with a norm: epsilon in the layer's unit, and the unit of the adjoint. */
enum { SW_LAYER_EPSILON, SW_LAYER_ADJOINT };

typedef int8_t sw_prior_number; /* type of the prior's matrices (sw_prior_memory.h) */

/* The parameters are read in place: little-endian, no pointers, every member aligned to SW_ALIGNMENT. */
typedef struct sw_weights {
    /* Scaling: the encoder reads (value - mean) * factor for each column; a force is mean + std * output. */
    SW_ALIGNED float window_mean[SW_SENSORS + 1];
    SW_ALIGNED float window_factor[SW_SENSORS + 1];
    SW_ALIGNED float force_mean[2];
    SW_ALIGNED float force_std[2];
    SW_ALIGNED float action_limit;  /* largest magnitude of an action, in U_inf W */
    SW_ALIGNED float action_factor; /* 1 / action_std, by which the action is multiplied */

    /* Encoder. LSTM gates are in the order i, f, g, o. An inverse scale is the number of integers per unit of an
     * activation. The activations are the LSTM's inputs and hidden state here, and a layer's inputs elsewhere.
     */
    SW_ALIGNED int8_t lstm_input_rows[4 * SW_LSTM_P * SW_ROW_P + SW_AHEAD];
    SW_ALIGNED int8_t lstm_hidden_rows[4 * SW_LSTM_P * SW_LSTM_P + SW_AHEAD];
    SW_ALIGNED float lstm_channel[4 * SW_LSTM_P / 8][3][8]; /* input scale, hidden scale and bias of table arguments */
    SW_ALIGNED float encoder_gain[SW_LSTM_P];
    SW_ALIGNED float encoder_offset[SW_LSTM_P];
    SW_ALIGNED int8_t head_rows[SW_HEAD_P * SW_LSTM_P + SW_AHEAD];
    SW_ALIGNED float head_channel[SW_HEAD_P / 8][2][8];
    SW_ALIGNED int8_t latent_rows[SW_LATENT_P * SW_HEAD_P + SW_AHEAD];
    SW_ALIGNED float latent_channel[SW_LATENT_P / 8][2][8];
    SW_ALIGNED float row_inverse_scale;
    SW_ALIGNED float cell_inverse_scale;
    SW_ALIGNED float head_inverse_scale;

    /* Dynamics; their matrices are in sw_hot. */
    SW_ALIGNED int32_t dyn1_channel[SW_DYN1_P / 8][4][8];
    SW_ALIGNED int32_t dyn1_adjoint[SW_DYN1_P / 8][2][8];
    SW_ALIGNED float dyn1_layer[2];
    SW_ALIGNED int32_t dyn2_channel[SW_DYN2_P / 8][4][8];
    SW_ALIGNED int32_t dyn2_adjoint[SW_DYN2_P / 8][2][8];
    SW_ALIGNED float dyn2_layer[2];
    SW_ALIGNED float dyn3_channel[SW_LATENT_P / 8][2][8];
    SW_ALIGNED float dyn3_scale[SW_LATENT_P];
    SW_ALIGNED float state_inverse_scale;

    /* Decoder. The sum of residuals has a separate unit. In this unit, residual_of_elu is one integer step of an ELU's
     * output; sw_scaled with residual_factor converts the sum to the inputs of the blocks and of the last layer.
     */
    SW_ALIGNED int8_t decoder_rows[SW_DECODER_P * SW_LATENT_P + SW_AHEAD];
    SW_ALIGNED int8_t decoder_adjoint_rows[SW_LATENT_P * SW_DECODER_P + SW_AHEAD];
    SW_ALIGNED float decoder_channel[SW_DECODER_P / 8][2][8];
    SW_ALIGNED int32_t decoder_scale[SW_DECODER_P]; /* an output's scale / the largest scale, in units of 1 / 2^31 */
    SW_ALIGNED float decoder_largest;
    SW_ALIGNED int8_t block_rows[SW_BLOCKS][SW_DECODER_P * SW_DECODER_P + SW_AHEAD];
    SW_ALIGNED int8_t block_adjoint_rows[SW_BLOCKS][SW_DECODER_P * SW_DECODER_P + SW_AHEAD];
    SW_ALIGNED int32_t block_channel[SW_BLOCKS][SW_DECODER_P / 8][4][8];
    SW_ALIGNED int32_t block_adjoint[SW_BLOCKS][SW_DECODER_P / 8][2][8];
    SW_ALIGNED float block_layer[SW_BLOCKS][2];
    SW_ALIGNED int8_t force_rows[SW_FORCES_P * SW_DECODER_P + SW_AHEAD];
    SW_ALIGNED int8_t force_adjoint_rows[SW_DECODER_P * SW_FORCES_P + SW_AHEAD];
    SW_ALIGNED float force_channel[SW_FORCES_P / 8][2][8];
    SW_ALIGNED float force_scale[SW_FORCES_P];
    SW_ALIGNED float decoder_inverse_scale;
    SW_ALIGNED int32_t residual_of_elu;
    SW_ALIGNED int32_t residual_factor[SW_BLOCKS + 1];

    /* Cost and optimiser; adam_rate is lr / (1 - b1^i) and adam_unbias 1 / sqrt(1 - b2^i) in Adam's iteration i. */
    SW_ALIGNED float drag_reference;
    SW_ALIGNED float adam_rate[SW_ITERATIONS];
    SW_ALIGNED float adam_unbias[SW_ITERATIONS];
    SW_ALIGNED float adam_epsilon;
    SW_ALIGNED float default_weights[SW_TERMS];
    SW_ALIGNED float known_answer[2]; /* expected action and cost in sw_known_answer.c; zeros if unknown */
    SW_PRIOR_NUMBERS
} sw_weights;

/* Matrices that every step of a roll-out reads completely. The first layer's last column is for action / action_std. */
typedef struct sw_hot {
    SW_ALIGNED int8_t dyn1_rows[SW_DYN1_P * SW_STATE_P + SW_AHEAD];
    SW_ALIGNED int8_t dyn1_adjoint_rows[SW_STATE_P * SW_DYN1_P + SW_AHEAD];
    SW_ALIGNED int8_t dyn2_rows[SW_DYN2_P * SW_DYN1_P + SW_AHEAD];
    SW_ALIGNED int8_t dyn2_adjoint_rows[SW_DYN1_P * SW_DYN2_P + SW_AHEAD];
    SW_ALIGNED int8_t dyn3_rows[SW_LATENT_P * SW_DYN2_P + SW_AHEAD];
    SW_ALIGNED int8_t dyn3_adjoint_rows[SW_DYN2_P * SW_LATENT_P + SW_AHEAD];
} sw_hot;

/* The parameters that are compiled in. */
extern const sw_weights sw_own_weights;
extern const sw_hot sw_own_hot;
#define SW_OWN_PROGRAM {&sw_own_weights, &sw_own_hot}

#endif
