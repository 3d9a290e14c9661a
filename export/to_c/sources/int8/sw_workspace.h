/* Scratch memory of a control step with int8 weights. The structure is public only because the caller provides it. */
#ifndef SW_WORKSPACE_H
#define SW_WORKSPACE_H

#include <stdint.h>

#include "sw_prior_memory.h"
#include "sw_program.h"
#include "sw_settings.h"

#if SW_LANES != 8
#error "constants of outputs stand in eights, and so do the loops over them"
#endif

/* A number of rows, rounded up to a multiple of the number of rows that sw_dots processes at a time. */
#define SW_ROWS(n) (((n) + 3) / 4 * 4)

#define SW_ROW_P SW_PADDED(SW_SENSORS + 1)
#define SW_LSTM_P SW_PADDED(SW_LSTM)
#define SW_HEAD_P SW_PADDED(SW_HEAD)
#define SW_STATE_P SW_PADDED(SW_LATENT + 1)
#define SW_LATENT_P SW_PADDED(SW_LATENT)
#define SW_FORCES_P SW_PADDED(2)
#define SW_DYN1_P SW_PADDED(SW_DYN1)
#define SW_DYN2_P SW_PADDED(SW_DYN2)
#define SW_DECODER_P SW_PADDED(SW_DECODER)
#define SW_HORIZON_P SW_HORIZON

#define SW_MAX(a, b) ((a) > (b) ? (a) : (b))
#define SW_WIDEST SW_MAX(SW_MAX(SW_DYN1_P, SW_DYN2_P), SW_STATE_P)
#define SW_LONGEST SW_MAX(SW_WIDEST, SW_MAX(SW_DECODER_P, SW_MAX(SW_LSTM_P, SW_MAX(SW_HEAD_P, SW_ROW_P))))

/* The data from a layer's forward pass that the adjoint needs (sw_norm.h), for eight outputs. */
typedef struct {
    int16_t xhat[8];
    uint8_t slope[8];
} sw_tape_eight;

typedef struct {
    sw_tape_eight layer1[SW_HORIZON][SW_DYN1_P / 8];
    sw_tape_eight layer2[SW_HORIZON][SW_DYN2_P / 8];
    float r1[SW_HORIZON];
    float r2[SW_HORIZON];
} sw_dynamics_tape;

typedef struct {
    sw_tape_eight block[SW_BLOCKS][SW_HORIZON_P][SW_DECODER_P / 8];
    float r[SW_BLOCKS][SW_HORIZON_P];
} sw_decoder_tape;

typedef struct {
    int16_t row[SW_ROW_P];
    int16_t hidden[SW_LSTM_P];
    int32_t by_row[4 * SW_LSTM_P];
    int32_t by_hidden[SW_MAX(4 * SW_LSTM_P, SW_MAX(SW_HEAD_P, SW_LATENT_P))];
    float cell[SW_LSTM_P];
    float output[SW_LSTM_P];
    int16_t vector[SW_MAX(SW_LSTM_P, SW_HEAD_P)];
} sw_encoder_scratch;

/* The decoder computes two steps together. The two steps' vectors are this distance apart, and so are their sums. */
#define SW_APART SW_MAX(SW_DECODER_P, SW_LATENT_P)

typedef struct {
    int16_t vector[2][SW_APART];
    int32_t sums[2][SW_APART];
    int32_t x[2][SW_DECODER_P]; /* the sum of residuals, or the derivative of J with respect to it */
    int16_t hidden[SW_DECODER_P];
} sw_decoder_scratch;

typedef struct {
    int32_t sums[SW_WIDEST];
    int16_t vector[SW_WIDEST];
    int16_t hidden[SW_MAX(SW_DYN1_P, SW_DYN2_P)];
} sw_dynamics_scratch;

typedef struct sw_workspace {
    sw_program program;                       /* the running program */
    float z[SW_LATENT];                       /* present latent state */
    float latents[SW_HORIZON_P][SW_LATENT];   /* latent states 1 to SW_HORIZON steps ahead */
    float forces[2][SW_HORIZON_P];            /* Cd, then Cl */
    float d_forces[2][SW_HORIZON_P];          /* dJ/d(Cd, Cl): derivatives of the cost J */
    float d_latents[SW_HORIZON_P][SW_LATENT]; /* dJ/dz through the forces alone */
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
            union {
                sw_dynamics_scratch dynamics;
                sw_decoder_scratch decoder;
            } scratch;
        } tape;
    } phase;
} sw_workspace;

#endif
