/* The programming through UDS: key lists, downloads and routines that use the store of releases. This file corresponds
 * to can_bridge/uds/ecu_services.py.
 *
 * Each function returns SW_UDS_DONE (0) or the refusal's SW_NRC_ code. Functions that begin long work may return
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
    uint8_t has_passed;    /* the running release passed its latest self-test, and no image was announced since */
    uint8_t has_confirmed; /* the release on trial has been confirmed since the last announcement */
    uint8_t has_keys;      /* whether a key list was accepted */
    uint8_t keys_digest[SW_SHA256_BYTES]; /* SHA-256 of the accepted list, to acknowledge a repeated list */
    uint16_t routine;                     /* routine that was begun last */
    uint8_t piece;                        /* number of self-test parts that have begun */
} sw_programming;

/* Returns whether an image is booted and has not been overwritten. */
int sw_programming_has_release(const sw_programming *programming);

/* Checks that a reset would not interrupt control. Control may have begun after the session began. */
uint8_t sw_programming_before_reset(const sw_programming *programming);

uint8_t sw_programming_take_keys(sw_programming *programming, const uint8_t *value, uint32_t length);

/* Begins a routine, and appends its status record to the answer. */
uint8_t sw_programming_begin(sw_programming *programming, uint32_t routine, const uint8_t *option, sw_answer *answer);

/* Executes the next part of the routine. */
uint8_t sw_programming_go_on(sw_programming *programming, sw_answer *answer);

/* Checks that the missing bytes of the announced image are exactly the `length` bytes from `offset` on. */
uint8_t sw_programming_download(const sw_programming *programming, uint32_t offset, uint32_t length);

#endif
