/* The encoder: z_t = f_enc(window). An LSTM runs over the rows from a zero state. A layer norm of its last output and
 * two linear layers follow.
 */
#include "sw_kernels.h"
#include "sw_math.h"
#include "sw_networks.h"
#include "sw_norm.h"
#include "sw_weights.h"

/* Computes the cells c = sigmoid(f) * c + sigmoid(i) * tanh(g) and the hidden state h = sigmoid(o) * tanh(c). */
static void update_cells(sw_encoder_scratch *e)
{
    const float *i = e->gates, *f = i + SW_LSTM_P, *g = f + SW_LSTM_P, *o = g + SW_LSTM_P;
    float *restrict normed = e->normed;
    for (int k = 0; k < SW_LSTM_P; k++) {
        const float c = sw_logistic(f[k]) * e->cell[k] + sw_logistic(i[k]) * sw_tanh(g[k]);
        e->cell[k] = c;
        normed[k] = sw_logistic(o[k]) * sw_tanh(c);
    }
    for (int k = 0; k < SW_LSTM; k++) e->hidden[SW_COLUMNS + k] = normed[k];
}

/* Computes (h - mean) / sqrt(var + eps), with gain and offset; the padding becomes zero. */
static void normalise(sw_encoder_scratch *e, const sw_weights *w)
{
    float mean = 0.0f, squares = 0.0f;
    for (int k = 0; k < SW_LSTM; k++) mean += e->normed[k];
    mean /= (float)SW_LSTM;
    for (int k = 0; k < SW_LSTM; k++) {
        const float apart = e->normed[k] - mean;
        squares += apart * apart;
    }
    const float r = sw_inverse_sqrt(squares / (float)SW_LSTM + SW_NORM_EPSILON);
    for (int k = 0; k < SW_LSTM_P; k++) {
        e->normed[k] = (e->normed[k] - mean) * r * w->encoder_gain[k] + w->encoder_offset[k];
    }
}

void sw_encode(sw_workspace *work, const float window[SW_WINDOW][SW_COLUMNS])
{
    const sw_weights *w = work->program.weights;
    sw_encoder_scratch *e = &work->phase.encoder;
    for (int k = 0; k < SW_COLUMNS + SW_LSTM; k++) e->hidden[k] = 0.0f;
    for (int k = 0; k < SW_LSTM_P; k++) e->cell[k] = 0.0f;
    for (int row = SW_WINDOW - SW_ENCODER_ROWS; row < SW_WINDOW; row++) {
        for (int c = 0; c < SW_COLUMNS; c++) {
            e->hidden[c] = (window[row][c] - w->window_mean[c]) * w->window_factor[c];
        }
        sw_combine(e->gates, w->lstm_bias, &w->lstm_weight[0][0], e->hidden, SW_COLUMNS + SW_LSTM, SW_CELLS);
        update_cells(e);
    }
    normalise(e, w);
    sw_combine(e->head, w->head_bias, &w->head_weight[0][0], e->normed, SW_LSTM, SW_HEAD_P);
    for (int k = 0; k < SW_HEAD_P; k++) {
        e->head[k] = sw_max(e->head[k], 0.0f) + (sw_exp(sw_min(e->head[k], 0.0f)) - 1.0f);
    }
    sw_dots(work->z, &w->latent_weight[0][0], e->head, SW_LATENT, SW_HEAD_P);
    for (int l = 0; l < SW_LATENT; l++) work->z[l] += w->latent_bias[l];
}
