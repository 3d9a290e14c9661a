/* From an image to the numbers in it. */
#include "sw_image.h"

#define LENGTH 8 /* of the whole image, 4 bytes */
#define LAYOUT 48

#define BOUNDARY 64u /* of all members' alignments the largest */

const uint8_t sw_layout_sha256[32] = SW_LAYOUT_SHA256;

static uint32_t length_of(const uint8_t *image)
{
    const uint8_t *field = &image[LENGTH];
    return (uint32_t)field[0] | ((uint32_t)field[1] << 8) | ((uint32_t)field[2] << 16) | ((uint32_t)field[3] << 24);
}

sw_image_status sw_image_open(const uint8_t *image, sw_numbers *numbers)
{
    /* Behind the numbers stands a text of their layout, for tools. */
    uint32_t differing = length_of(image) < SW_IMAGE_HEADER + sizeof(sw_payload) ? 1u : 0u;
    for (int i = 0; i < 32; i++) differing |= (uint32_t)image[LAYOUT + i] ^ (uint32_t)sw_layout_sha256[i];
    if (differing != 0u) return SW_IMAGE_OTHER_BUILD;
    if ((uintptr_t)image % BOUNDARY != 0u) return SW_IMAGE_MISALIGNED;
    const sw_payload *payload = (const sw_payload *)(const void *)&image[SW_IMAGE_HEADER];
    numbers->program.weights = &payload->weights;
#if SW_HOT_BYTES > 0
    numbers->program.hot = &payload->hot;
#else
    numbers->program.hot = NULL;
#endif
    numbers->release = &payload->release;
#if SW_SENSOR_CHECK
    numbers->estimator = &payload->estimator;
#endif
    return SW_IMAGE_OK;
}
