/* An image whose numbers are altered, one patch after another, opened and, where that succeeds, run: for sanitisers.
 *
 * From stdin: bytes of the image and the image; periods, and of each its time and its frames (time, identifier, length,
 * data); then patches: how many changes, and of each its place, its length and its bytes. A line for each: the status.
 */
#define _POSIX_C_SOURCE 200112L
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "sw_image.h"

#define MOST 128

typedef struct {
    int64_t now_ns;
    int count;
    sw_frame frames[4];
} period;

static period periods[MOST];
static sw_ecu ecu;

static int taken(void *to, size_t length) { return fread(to, 1, length, stdin) == length; }

static uint32_t number(void)
{
    uint32_t found = 0;
    return taken(&found, 4) ? found : UINT32_MAX;
}

int main(void)
{
    const uint32_t length = number();
    const uint32_t room = (length + 63u) / 64u * 64u;
    uint8_t *sound = malloc(length);
    void *image = NULL;
    sw_frame sent[SW_FRAMES_OUT];
    if (sound == NULL || !taken(sound, length) || posix_memalign(&image, 64, room) != 0) return 2;
    const uint32_t count = number();
    for (uint32_t k = 0; k < count && k < MOST; k++) {
        if (!taken(&periods[k].now_ns, 8)) return 3;
        periods[k].count = (int)number();
        for (int i = 0; i < periods[k].count; i++) {
            sw_frame *frame = &periods[k].frames[i];
            if (!taken(&frame->timestamp_ns, 8)) return 4;
            frame->id = number();
            frame->length = (uint8_t)number();
            frame->is_fd = SW_FRAMES_FD;
            if (!taken(frame->data, frame->length)) return 5;
        }
    }
    for (uint32_t changes = number(); changes != UINT32_MAX; changes = number()) {
        sw_numbers numbers;
        memcpy(image, sound, length);
        for (uint32_t i = 0; i < changes; i++) {
            const uint32_t place = number(), bytes = number();
            if (!taken((uint8_t *)image + place, bytes)) return 6;
        }
        const sw_image_status status = sw_image_open(image, &numbers);
        int drove = 0;
        if (status == SW_IMAGE_OK) {
            sw_ecu_init_of(&ecu, &numbers);
            for (uint32_t k = 0; k < count; k++) {
                (void)sw_ecu_step(&ecu, periods[k].now_ns, periods[k].frames, periods[k].count, sent);
                drove |= ecu.trace.planned;
            }
        }
        printf("%d %d\n", (int)status, drove);
    }
    free(sound);
    free(image);
    return 0;
}
