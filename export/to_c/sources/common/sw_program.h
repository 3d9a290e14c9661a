/* Where the numbers of a trained program stand: compiled in, or in an image on flash that is read in place.
 *
 * They are structures without pointers, laid out as sw_weights.h has them, so that they may stand wherever they are
 * aligned to SW_ALIGNMENT bytes: `hot`, which every step of every roll-out reads whole, in faster memory than the others.
 */
#ifndef SW_PROGRAM_H
#define SW_PROGRAM_H

#include "sw_settings.h"

/* Columns of the window: the sensors, then the action. */
#define SW_COLUMNS (SW_SENSORS + 1)

/* A length rounded up to whole registers, or to whole pairs of words of int8 weights; what is added is zero throughout. */
#define SW_PADDED(n) (((n) + SW_LANES - 1) / SW_LANES * SW_LANES)

/* Tables start at SW_ALIGNMENT bytes where the compiler can align them: a cache line, or the words that products on a
 * Cortex-M read whole. Images are for compilers that can.
 */
#if defined(__GNUC__)
#define SW_ALIGNED __attribute__((aligned(SW_ALIGNMENT)))
#else
#define SW_ALIGNED
#endif

struct sw_weights;
struct sw_hot;

typedef struct {
    const struct sw_weights *weights;
    const struct sw_hot *hot; /* of an int8 library; others have none */
} sw_program;

#endif
