/* The three products that take nearly all the time of a step. Compilers vectorise them without reordering a sum,
 * because every inner loop runs over independent sums.
 *
 * Vectors are padded to whole registers (SW_LANES) with zeros. Matrices are rows of such vectors. Forward pass and
 * adjoint use the same copy of a matrix: one calls sw_combine, and the other calls sw_dots.
 */
#ifndef SW_KERNELS_H
#define SW_KERNELS_H

#include "sw_workspace.h"

/* Computes y = start + w^T x; w is (rows, columns). Eight rows at a time share one load and store of y. */
static inline void sw_combine(float *restrict y, const float *restrict start, const float *restrict w,
                              const float *restrict x, int rows, int columns)
{
    for (int c = 0; c < columns; c++) y[c] = start[c];
    for (; rows >= 8; rows -= 8, w += 8 * columns, x += 8) {
        const float *w1 = w + columns, *w2 = w1 + columns, *w3 = w2 + columns, *w4 = w3 + columns;
        const float *w5 = w4 + columns, *w6 = w5 + columns, *w7 = w6 + columns;
        const float x0 = x[0], x1 = x[1], x2 = x[2], x3 = x[3], x4 = x[4], x5 = x[5], x6 = x[6], x7 = x[7];
        for (int c = 0; c < columns; c++) {
            y[c] += ((x0 * w[c] + x1 * w1[c]) + (x2 * w2[c] + x3 * w3[c])) +
                    ((x4 * w4[c] + x5 * w5[c]) + (x6 * w6[c] + x7 * w7[c]));
        }
    }
    for (; rows > 0; rows--, w += columns, x++) {
        const float factor = x[0];
        for (int c = 0; c < columns; c++) y[c] += factor * w[c];
    }
}

#if SW_LANES != 16
#error "sw_lane_sum adds up 16 numbers"
#endif

/* Returns the sum of SW_LANES numbers, by repeatedly adding one half of the numbers to the other half. */
static inline float sw_lane_sum(float lanes[SW_LANES])
{
    for (int j = 0; j < 8; j++) lanes[j] += lanes[j + 8];
    for (int j = 0; j < 4; j++) lanes[j] += lanes[j + 4];
    for (int j = 0; j < 2; j++) lanes[j] += lanes[j + 2];
    return lanes[0] + lanes[1];
}

/* Computes y = w x; w is (rows, columns), columns a multiple of SW_LANES. Four rows at a time share the loads of x. */
static inline void sw_dots(float *restrict y, const float *restrict w, const float *restrict x, int rows, int columns)
{
    for (; rows >= 4; rows -= 4, w += 4 * columns, y += 4) {
        const float *w1 = w + columns, *w2 = w1 + columns, *w3 = w2 + columns;
        float s0[SW_LANES] = {0}, s1[SW_LANES] = {0}, s2[SW_LANES] = {0}, s3[SW_LANES] = {0};
        for (int c = 0; c < columns; c += SW_LANES) {
            for (int j = 0; j < SW_LANES; j++) {
                s0[j] += w[c + j] * x[c + j];
                s1[j] += w1[c + j] * x[c + j];
                s2[j] += w2[c + j] * x[c + j];
                s3[j] += w3[c + j] * x[c + j];
            }
        }
        y[0] = sw_lane_sum(s0);
        y[1] = sw_lane_sum(s1);
        y[2] = sw_lane_sum(s2);
        y[3] = sw_lane_sum(s3);
    }
    for (; rows > 0; rows--, w += columns, y++) {
        float s0[SW_LANES] = {0};
        for (int c = 0; c < columns; c += SW_LANES) {
            for (int j = 0; j < SW_LANES; j++) s0[j] += w[c + j] * x[c + j];
        }
        y[0] = sw_lane_sum(s0);
    }
}

/* Computes y[o][t] += sum over i of w(o, i) * x[i][t] for every output o and every step t of the horizon, where w(o, i)
 * is w[o * stride_o + i * stride_i], so that one copy serves as the matrix and as its transpose. A register holds
 * several steps of the horizon. Four outputs at a time share the loads of x.
 */
static inline void sw_product(float *restrict y, const float *restrict w, int stride_o, int stride_i,
                              const float *restrict x, int outputs, int inputs)
{
    for (; outputs >= 4; outputs -= 4, w += 4 * stride_o, y += 4 * SW_HORIZON_P) {
        for (int t = 0; t < SW_HORIZON_P; t += SW_LANES) {
            float *y0 = y + t, *y1 = y0 + SW_HORIZON_P, *y2 = y1 + SW_HORIZON_P, *y3 = y2 + SW_HORIZON_P;
            float s0[SW_LANES], s1[SW_LANES], s2[SW_LANES], s3[SW_LANES];
            for (int j = 0; j < SW_LANES; j++) s0[j] = y0[j];
            for (int j = 0; j < SW_LANES; j++) s1[j] = y1[j];
            for (int j = 0; j < SW_LANES; j++) s2[j] = y2[j];
            for (int j = 0; j < SW_LANES; j++) s3[j] = y3[j];
            for (int i = 0; i < inputs; i++) {
                const float *row = x + i * SW_HORIZON_P + t, *factors = w + i * stride_i;
                const float f0 = factors[0], f1 = factors[stride_o];
                const float f2 = factors[2 * stride_o], f3 = factors[3 * stride_o];
                for (int j = 0; j < SW_LANES; j++) {
                    s0[j] += f0 * row[j];
                    s1[j] += f1 * row[j];
                    s2[j] += f2 * row[j];
                    s3[j] += f3 * row[j];
                }
            }
            for (int j = 0; j < SW_LANES; j++) y0[j] = s0[j];
            for (int j = 0; j < SW_LANES; j++) y1[j] = s1[j];
            for (int j = 0; j < SW_LANES; j++) y2[j] = s2[j];
            for (int j = 0; j < SW_LANES; j++) y3[j] = s3[j];
        }
    }
    for (; outputs > 0; outputs--, w += stride_o, y += SW_HORIZON_P) {
        for (int t = 0; t < SW_HORIZON_P; t += SW_LANES) {
            float s0[SW_LANES];
            for (int j = 0; j < SW_LANES; j++) s0[j] = y[t + j];
            for (int i = 0; i < inputs; i++) {
                for (int j = 0; j < SW_LANES; j++) s0[j] += w[i * stride_i] * x[i * SW_HORIZON_P + t + j];
            }
            for (int j = 0; j < SW_LANES; j++) y[t + j] = s0[j];
        }
    }
}

#endif
