/* Programming by diagnosis: key lists, downloads and routines over the store of releases. The twin of
 * can_bridge/uds/ecu_services.py.
 *
 * Each function returns SW_UDS_DONE, which is 0, or the SW_NRC_ of the refusal; those that begin long work may return
 * SW_UDS_MORE.
 */
#ifndef SW_PROGRAMMING_H
#define SW_PROGRAMMING_H

#include <stdint.h>

#include "sw_bytes.h"
#include "sw_crypto.h"
#include "sw_ecu_state.h"
#include "sw_request.h"
#include "sw_store.h"

typedef struct {
    sw_ecu *ecu;
    sw_store *store;
    const sw_vehicle_request *request;
    uint8_t is_updating;   /* an image was announced since power-on: the jets stay shut until a reset */
    uint8_t has_passed;    /* the release that runs passed its latest self-test, since the last announcement */
    uint8_t has_confirmed; /* the release on trial was, since the last announcement */
    uint8_t has_keys;      /* whether a key list was taken */
    uint8_t keys_digest[SW_SHA256_BYTES]; /* its SHA-256, to acknowledge it again */
    uint16_t routine; /* that was begun last */
    uint8_t piece;    /* of a self-test */
} sw_programming;

/* Whether the image that was booted still stands where it was. */
int sw_programming_has_release(const sw_programming *programming);

/* Looks whether a reset interrupts no control: a session may have begun before the control did. */
uint8_t sw_programming_before_reset(const sw_programming *programming);

uint8_t sw_programming_take_keys(sw_programming *programming, const uint8_t *value, uint32_t length);

/* Begins a routine; its status record goes behind what the answer has. */
uint8_t sw_programming_begin(sw_programming *programming, uint32_t routine, const uint8_t *option, sw_answer *answer);

/* Does one more piece of it. */
uint8_t sw_programming_go_on(sw_programming *programming, sw_answer *answer);

/* Looks whether `length` bytes of the announced image are what is missing from `offset` on. */
uint8_t sw_programming_download(const sw_programming *programming, uint32_t offset, uint32_t length);

#endif
