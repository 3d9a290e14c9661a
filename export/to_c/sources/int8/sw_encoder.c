/* The encoder: z_t = f_enc(window). An LSTM runs over the rows from a zero state. A layer norm of its last output and
 * two linear layers follow. Products are computed in integers, and all other operations in float.
 */
#include "sw_networks.h"
#include "sw_norm.h"

/* Replaces each gate's sum by the logistic function of the gate's argument or, for gate g, of twice the argument. */
static void open_gates(sw_encoder_scratch *e, const sw_weights *w)
{
    for (int c = 0; c < 4 * SW_LSTM_P; c += 8) {
        const float (*of)[8] = w->lstm_channel[c / 8];
        SW_FOUR_TIMES
        for (int k = 0; k < 8; k++) {
            const float argument = (float)e->by_row[c + k] * of[0][k] + (float)e->by_hidden[c + k] * of[1][k] + of[2][k];
            e->by_row[c + k] = sw_table_logistic(sw_cut(argument));
        }
    }
}

/* Computes the cells c = sigmoid(f) * c + sigmoid(i) * tanh(g) and the hidden state h = sigmoid(o) * tanh(c). */
static void update_cells(sw_encoder_scratch *e, const sw_weights *w)
{
    const float one = 1.0f / (float)SW_LOGISTIC_QMAX, product = one * one;
    const int32_t *enters = e->by_row, *stays = &e->by_row[SW_LSTM_P];
    const int32_t *value = &e->by_row[2 * SW_LSTM_P], *leaves = &e->by_row[3 * SW_LSTM_P];
    open_gates(e, w);
    SW_FOUR_TIMES
    for (int k = 0; k < SW_LSTM; k++) {
        const int32_t entering = enters[k] * sw_tanh_of(value[k]);
        const float c = (float)stays[k] * one * e->cell[k] + (float)entering * product;
        const int32_t argument = (int32_t)(c * (float)(2 * SW_LOGISTIC_ONE) + ((float)SW_LOGISTIC_START + 0.5f));
        e->cell[k] = c;
        e->output[k] = (float)(leaves[k] * sw_tanh_of(sw_table_logistic(argument))) * product;
        e->hidden[k] = sw_rounded(e->output[k] * w->cell_inverse_scale);
    }
}

/* Writes the normalised output of the LSTM as the next layer's input. */
static void normalise(sw_encoder_scratch *e, const sw_weights *w)
{
    const float qmax = (float)SW_QMAX(SW_LSTM_P);
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
        const float normed = (e->output[k] - mean) * r * w->encoder_gain[k] + w->encoder_offset[k];
        e->vector[k] = sw_saturated(normed * w->head_inverse_scale, qmax);
    }
}

void sw_encode(sw_workspace *work, const float window[SW_WINDOW][SW_COLUMNS])
{
    const sw_weights *w = work->program.weights;
    sw_encoder_scratch *e = &work->phase.encoder;
    const float row_qmax = (float)SW_QMAX(SW_ROW_P);
    for (int k = 0; k < SW_ROW_P; k++) e->row[k] = 0;
    for (int k = 0; k < SW_LSTM_P; k++) {
        e->hidden[k] = 0;
        e->cell[k] = 0.0f;
    }
    for (int row = SW_WINDOW - SW_ENCODER_ROWS; row < SW_WINDOW; row++) {
        for (int c = 0; c < SW_COLUMNS; c++) {
            const float scaled = (window[row][c] - w->window_mean[c]) * w->window_factor[c];
            e->row[c] = sw_saturated(scaled * w->row_inverse_scale, row_qmax);
        }
        sw_dots(e->by_row, w->lstm_input_rows, e->row, 4 * SW_LSTM_P, SW_ROW_P);
        sw_dots(e->by_hidden, w->lstm_hidden_rows, e->hidden, 4 * SW_LSTM_P, SW_LSTM_P);
        update_cells(e, w);
    }
    normalise(e, w);
    sw_dots(e->by_hidden, w->head_rows, e->vector, SW_HEAD_P, SW_LSTM_P);
    for (int k = 0; k < SW_HEAD_P; k++) {
        const float y = (float)e->by_hidden[k] * w->head_channel[k / 8][SW_SCALE][k % 8] +
                        w->head_channel[k / 8][SW_BIAS][k % 8];
        e->vector[k] = sw_elu(sw_cut(y * (float)SW_ELU_ARGUMENT_ONE + (float)SW_ELU_START));
    }
    sw_dots(e->by_hidden, w->latent_rows, e->vector, SW_LATENT_P, SW_HEAD_P);
    for (int l = 0; l < SW_LATENT; l++) {
        work->z[l] = (float)e->by_hidden[l] * w->latent_channel[l / 8][SW_SCALE][l % 8] +
                     w->latent_channel[l / 8][SW_BIAS][l % 8];
    }
}
