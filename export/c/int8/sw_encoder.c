/* z_t = f_enc(window): LSTM over the rows from a zero state, layer norm of its last output, two linear layers. Products
 * in integers, the rest in float.
 */
#include "sw_norm.h"
#include "sw_parts.h"

static inline float gate(const sw_encoder_scratch *e, int number, int k)
{
    const int c = number * SW_LSTM_P + k;
    return (float)e->by_row[c] * sw_lstm_channel[c][0] + (float)e->by_hidden[c] * sw_lstm_channel[c][1] +
           sw_lstm_channel[c][2];
}

/* c = sigmoid(f) c + sigmoid(i) tanh(g), h = sigmoid(o) tanh(c). */
static void update_cells(sw_encoder_scratch *e)
{
    for (int k = 0; k < SW_LSTM; k++) {
        const float c = sw_logistic(gate(e, 1, k)) * e->cell[k] + sw_logistic(gate(e, 0, k)) * sw_tanh(gate(e, 2, k));
        e->cell[k] = c;
        e->output[k] = sw_logistic(gate(e, 3, k)) * sw_tanh(c);
        e->hidden[k] = sw_rounded(e->output[k] * sw_cell_levels);
    }
}

/* The normed output of the LSTM as the next layer's input. */
static void normalise(sw_encoder_scratch *e)
{
    const float most = (float)SW_LEVELS(SW_LSTM_P);
    float mean = 0.0f, squares = 0.0f;
    for (int k = 0; k < SW_LSTM; k++) mean += e->output[k];
    mean /= (float)SW_LSTM;
    for (int k = 0; k < SW_LSTM; k++) {
        const float apart = e->output[k] - mean;
        squares += apart * apart;
    }
    const float r = sw_inverse_sqrt(squares / (float)SW_LSTM + SW_NORM_EPSILON);
    for (int k = 0; k < SW_LSTM_P; k++) e->vector[k] = 0;
    for (int k = 0; k < SW_LSTM; k++) {
        const float normed = (e->output[k] - mean) * r * sw_encoder_gain[k] + sw_encoder_offset[k];
        e->vector[k] = sw_saturated(normed * sw_head_levels, most);
    }
}

void sw_encode(sw_workspace *work, const float window[SW_WINDOW][SW_COLUMNS])
{
    sw_encoder_scratch *e = &work->phase.encoder;
    const float row_most = (float)SW_LEVELS(SW_ROW_P);
    for (int k = 0; k < SW_ROW_P; k++) e->row[k] = 0;
    for (int k = 0; k < SW_LSTM_P; k++) {
        e->hidden[k] = 0;
        e->cell[k] = 0.0f;
    }
    for (int row = 0; row < SW_WINDOW; row++) {
        for (int c = 0; c < SW_COLUMNS; c++) {
            const float scaled = (window[row][c] - sw_window_mean[c]) * sw_window_factor[c];
            e->row[c] = sw_saturated(scaled * sw_row_levels, row_most);
        }
        sw_dots(e->by_row, sw_lstm_input_rows, e->row, 4 * SW_LSTM_P, SW_ROW_P);
        sw_dots(e->by_hidden, sw_lstm_hidden_rows, e->hidden, 4 * SW_LSTM_P, SW_LSTM_P);
        update_cells(e);
    }
    normalise(e);
    sw_dots(e->by_hidden, sw_head_rows, e->vector, SW_HEAD_P, SW_LSTM_P);
    for (int k = 0; k < SW_HEAD_P; k++) {
        const float y = (float)e->by_hidden[k] * sw_head_channel[k][SW_SCALE] + sw_head_channel[k][SW_BIAS];
        e->vector[k] = sw_elu((int32_t)(y * (float)SW_ELU_ONE) + SW_ELU_START);
    }
    sw_dots(e->by_hidden, sw_latent_rows, e->vector, SW_LATENT_P, SW_HEAD_P);
    for (int l = 0; l < SW_LATENT; l++) {
        work->z[l] = (float)e->by_hidden[l] * sw_latent_channel[l][SW_SCALE] + sw_latent_channel[l][SW_BIAS];
    }
}
