/* In place of the ECU's own: an image is a header and an sw_release, and the networks are a stub. */
#ifndef SW_IMAGE_H
#define SW_IMAGE_H

#include "sw_ecu.h"

#define SW_IMAGE_HEADER 512

typedef enum { SW_IMAGE_OK, SW_IMAGE_OTHER_BUILD, SW_IMAGE_MISALIGNED } sw_image_status;

sw_image_status sw_image_open(const uint8_t *image, sw_numbers *numbers);

#endif
