/* The programming part of what the UDS server asks of the ECU, over the store of releases. The twin of
 * can_bridge/uds/ecu_services.py.
 *
 * Each function returns SW_UDS_DONE, which is 0, or the SW_NRC_ of the refusal; those that begin long work may return
 * SW_UDS_MORE.
 */
#ifndef SW_PROGRAMMING_H
#define SW_PROGRAMMING_H

#include <stdint.h>

#include "sw_answer.h"
#include "sw_store.h"
#include "sw_uds.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    uint8_t is_updating;   /* an image was announced since power-on: the jets stay shut until a reset */
    uint8_t has_passed;    /* the release that runs passed its latest self-test, since the last announcement */
    uint8_t has_confirmed; /* the release on trial was, since the last announcement */
    uint8_t has_keys;      /* whether a key list was taken */
    uint8_t keys_digest[SW_BLOCK_DIGEST_BYTES]; /* its SHA-256, to acknowledge it again */
} sw_programming;

/* The session ended: a transfer that is under way is dropped, and can be resumed after a reset. */
void sw_programming_leave(sw_node *node);

/* Before a reset: a session may have begun before the control did. */
uint8_t sw_programming_before_reset(const sw_node *node);

/* The value of an identifier, behind what the answer has. */
uint8_t sw_programming_read(sw_node *node, uint32_t number, sw_answer *answer);

uint8_t sw_programming_write(sw_node *node, uint32_t number, const uint8_t *value, uint32_t length);

/* Runs a routine; its status record goes behind what the answer has. */
uint8_t sw_programming_routine(sw_node *node, uint32_t number, const uint8_t *option, sw_answer *answer);

/* Bytes of the announced image from `offset` on will come, `length` of them. */
uint8_t sw_programming_download(const sw_node *node, uint32_t offset, uint32_t length);

uint8_t sw_programming_append(sw_node *node, const uint8_t *data, uint32_t length);

/* SHA-256. */
void sw_programming_digest(const uint8_t *data, uint32_t length, uint8_t digest[SW_BLOCK_DIGEST_BYTES]);

/* The refusal for what the store answers. */
uint8_t sw_programming_refusal(sw_store_result result);

/* --- sw_self_test.c --- */

/* Runs the controller of the release on what must lead to a finite plan within the action limit, piece by piece. */
uint8_t sw_self_test(sw_node *node, sw_answer *answer);

#ifdef __cplusplus
}
#endif

#endif
