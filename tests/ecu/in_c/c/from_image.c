#include "sw_image.h"
int start(sw_ecu *ecu, const uint8_t *image);
void places(const sw_ecu *ecu, const void **found);
int start(sw_ecu *ecu, const uint8_t *image)
{
    sw_numbers numbers;
    numbers.release = NULL;
    const sw_image_status status = sw_image_open(image, &numbers);
    if (status == SW_IMAGE_OK) sw_ecu_init_of(ecu, &numbers);
    if (status == SW_IMAGE_OK) sw_ecu_init_of(ecu, &ecu->numbers); /* again, as before power-off */
    if (status != SW_IMAGE_OK && numbers.release != NULL) return -1;
    return (int)status;
}
void places(const sw_ecu *ecu, const void **found)
{
    const sw_numbers *numbers = &ecu->numbers;
    found[0] = numbers->release;
    found[1] = numbers->program.weights;
    found[2] = numbers->program.hot;
#if SW_SENSOR_CHECK
    found[3] = numbers->estimator;
#endif
}
