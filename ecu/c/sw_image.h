/* A release as an image on flash. This build reads the parameters of an image in place.
 *
 * An image is a header of SW_IMAGE_HEADER bytes, followed by an sw_payload. The caller must check first that the image
 * is complete and signed by a trusted key.
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

/* The parameters of a release, little-endian. The as_packed checks compare their layout with the image writer's. */
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
    SW_IMAGE_OTHER_BUILD = 1, /* the image's layout or length differs from this build's layout or length */
    SW_IMAGE_MISALIGNED = 2,  /* the image's address is not a multiple of 64 bytes */
    SW_IMAGE_BAD_NUMBERS = 3  /* a number is NaN, or an index or a bound is outside its limits */
} sw_image_status;

/* SHA-256 of this build's layout: sizes and types of all parameters, and the settings that determine the layout. */
extern const uint8_t sw_layout_sha256[32];

/* Returns the addresses of a verified image's parameters, for sw_ecu_init_of. The addresses are written only if the
 * answer is SW_IMAGE_OK. This call checks every number, so that no index leads outside an array and no divisor is 0. A
 * board may then copy *numbers->program.hot to faster memory, and set the pointer to the copy.
 */
sw_image_status sw_image_open(const uint8_t *image, sw_numbers *numbers);

#ifdef __cplusplus
}
#endif

#endif
