/* A release as an image on flash, of which this build reads the numbers in place.
 *
 * An image is a header of SW_IMAGE_HEADER bytes and then an sw_payload. Whether it is whole, and signed by a key that is
 * trusted, is for the caller to judge before.
 */
#ifndef SW_IMAGE_H
#define SW_IMAGE_H

#include "sw_ecu.h"
#include "sw_layout.h"
#include "sw_weights.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SW_IMAGE_HEADER 512

/* The numbers of a release: little-endian, at the places that the compiler gives them. Every compiler gives them the same
 * ones, which the image's writer knows (sw_own_layout.c compares them).
 */
typedef struct {
    sw_release release;
    sw_weights weights;
#if SW_HOT_BYTES > 0
    sw_hot hot;
#endif
#if SW_SENSOR_CHECK
    sw_estimator_weights estimator;
#endif
} sw_payload;

typedef enum {
    SW_IMAGE_OK = 0,
    SW_IMAGE_OTHER_BUILD = 1, /* its layout, or its length, is not this build's */
    SW_IMAGE_MISALIGNED = 2,  /* it does not stand at a multiple of 64 bytes */
    SW_IMAGE_BAD_NUMBERS = 3  /* one is an index or a bound that it cannot be, or no number */
} sw_image_status;

/* SHA-256 that names the layout of this build: sizes and types of all numbers, and settings that they depend on. */
extern const uint8_t sw_layout_sha256[32];

/* Where the numbers of a verified image stand, for sw_ecu_init_of. They are written only if the answer is SW_IMAGE_OK:
 * every number was looked at, once, so that none leads out of an array, and none that is divided by is 0. A board may
 * then copy *numbers->program.hot to faster memory, and point there.
 */
sw_image_status sw_image_open(const uint8_t *image, sw_numbers *numbers);

#ifdef __cplusplus
}
#endif

#endif
