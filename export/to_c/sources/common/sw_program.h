/* The addresses of a trained controller's parameters, compiled in, or in a flash image that is read in place.
 *
 * The parameters are structures without pointers, laid out as in sw_weights.h, so they may be at any address that is
 * aligned to SW_ALIGNMENT bytes. `hot` may be in faster memory than the other structures, because every step of a
 * roll-out reads all of `hot`.
 */
#ifndef SW_PROGRAM_H
#define SW_PROGRAM_H

#include "sw_settings.h"

/* Number of columns of the window: the sensors, then the action. */
#define SW_COLUMNS (SW_SENSORS + 1)

/* A length rounded up to full registers or, for int8 weights, to full pairs of words. The padding is zero. */
#define SW_PADDED(n) (((n) + SW_LANES - 1) / SW_LANES * SW_LANES)

/* Tables are aligned to SW_ALIGNMENT bytes if the compiler supports alignment. SW_ALIGNMENT is the size of a cache
 * line, or for int8 the size of a vector register. Images need a compiler that supports alignment.
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
    const struct sw_hot *hot; /* matrices of the dynamics in an int8 library; NULL for float32 */
} sw_program;

#endif
