/* The functions that find the parameters in an image, and check each index and each bound among the parameters. */
#include "sw_image.h"

#include <stddef.h>

#define LENGTH 8 /* offset of the image's length, which has 4 bytes */
#define LAYOUT 48

#define BOUNDARY 64u /* the largest alignment of any member */

const uint8_t sw_layout_sha256[32] = SW_LAYOUT_SHA256;

/* Limits of some numbers in a payload. There are `groups` groups of `run` numbers each. The first group begins at the
 * offset `place`; each following group begins `stride` bytes later.
 */
typedef struct {
    uint32_t place, run;
    uint16_t groups, stride;
    uint32_t type;
    double least, most;
} sw_limits;

enum { INT8, UINT8, INT32, FLOAT, DOUBLE };

static const sw_limits limits[] = SW_LIMITS;

static uint32_t length_of(const uint8_t *image)
{
    const uint8_t *field = &image[LENGTH];
    return (uint32_t)field[0] | ((uint32_t)field[1] << 8) | ((uint32_t)field[2] << 16) | ((uint32_t)field[3] << 24);
}

/* --- Limits of single numbers; NaN is outside all limits --- */

#define WITHIN(NAME, TYPE, BOUND)                                                                 \
    static int NAME(const TYPE *values, uint32_t count, double lowest, double highest)            \
    {                                                                                             \
        const BOUND least = (BOUND)lowest, most = (BOUND)highest;                                 \
        int within = 1;                                                                           \
        for (uint32_t i = 0; i < count; i++) within &= (values[i] >= least) & (values[i] <= most); \
        return within;                                                                            \
    }

WITHIN(int8_within, int8_t, int32_t)
WITHIN(uint8_within, uint8_t, int32_t)
WITHIN(int32_within, int32_t, int32_t)
WITHIN(float_within, float, float)
WITHIN(double_within, double, double)

static int are_within(const void *values, const sw_limits *of)
{
    if (of->type == INT8) return int8_within((const int8_t *)values, of->run, of->least, of->most);
    if (of->type == UINT8) return uint8_within((const uint8_t *)values, of->run, of->least, of->most);
    if (of->type == INT32) return int32_within((const int32_t *)values, of->run, of->least, of->most);
    if (of->type == FLOAT) return float_within((const float *)values, of->run, of->least, of->most);
    return double_within((const double *)values, of->run, of->least, of->most); /* the values have the type DOUBLE */
}

/* --- Limits of several numbers together --- */

/* Checks that every filter ends within the past, and that all filters together have SW_PRIOR_FILTER_ROWS weights. */
static int filters_fit(const sw_weights *weights)
{
    int fit = 1;
#if defined(SW_PRIOR_FILTERS)
    int32_t rows = 0;
    for (int f = 0; f < SW_PRIOR_FILTERS; f++) {
        fit &= weights->prior_filter_rows[f][0] + weights->prior_filter_rows[f][1] <= SW_PRIOR_MEMORY;
        rows += weights->prior_filter_rows[f][1];
    }
    fit &= rows == SW_PRIOR_FILTER_ROWS;
#else
    (void)weights;
#endif
    return fit;
}

/* Checks that the speeds rise, and that the past is long enough for the window at the slowest speed. */
static int speeds_fit(const sw_release *release)
{
    int fit = 1;
    for (int i = 1; i < SW_RESTING_SPEEDS; i++) fit &= release->resting[i][0] > release->resting[i - 1][0];
#if SW_PAST > 0
    const int rows = release->slowest >= 1.0 ? SW_PAST : SW_PAST - 1;
    fit &= (double)SW_WINDOW / release->slowest <= (double)rows;
#endif
    return fit;
}

static int can_run(const sw_payload *payload)
{
    const uint8_t *bytes = (const uint8_t *)payload;
    int within = 1;
    for (uint32_t i = 0; i < sizeof limits / sizeof limits[0]; i++) {
        for (uint32_t group = 0; group < limits[i].groups; group++) {
            within &= are_within(&bytes[limits[i].place + group * (uint32_t)limits[i].stride], &limits[i]);
        }
    }
    return within && filters_fit(&payload->weights) && speeds_fit(&payload->release);
}

sw_image_status sw_image_open(const uint8_t *image, sw_numbers *numbers)
{
    /* The image may be longer: after the parameters, a text describes the layout for tools. */
    uint32_t differing = length_of(image) < SW_IMAGE_HEADER + sizeof(sw_payload) ? 1u : 0u;
    for (int i = 0; i < 32; i++) differing |= (uint32_t)image[LAYOUT + i] ^ (uint32_t)sw_layout_sha256[i];
    if (differing != 0u) return SW_IMAGE_OTHER_BUILD;
    if ((uintptr_t)image % BOUNDARY != 0u) return SW_IMAGE_MISALIGNED;
    const sw_payload *payload = (const sw_payload *)(const void *)&image[SW_IMAGE_HEADER];
    if (!can_run(payload)) return SW_IMAGE_BAD_NUMBERS;
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
