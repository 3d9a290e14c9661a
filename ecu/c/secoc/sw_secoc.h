/* The authentication of frames as in AUTOSAR SecOC. A frame is refused before the E2E check if it is not authentic or
 * not fresh. This file corresponds to can_bridge/secoc/securing.py, which describes the frame:
 *
 *     protected part | zeros | freshness, 8 bytes | MAC, 8 bytes
 */
#ifndef SW_SECOC_H
#define SW_SECOC_H

#include <stdint.h>

#include "sw_cmac.h"

#define SW_SECOC_LONGEST 64u /* largest length of a frame, in bytes */

/* The bus key in use. Without a key no frame is authentic, and no frame may be sent. */
typedef struct {
    uint8_t is_given;
    sw_cmac_key cmac;
} sw_secoc;

/* The state of the receiver of one message. Counts saturate at their largest value. */
typedef struct {
    uint64_t freshness;     /* freshness value of the latest accepted frame; 0 before the first accepted frame */
    uint32_t not_authentic; /* number of frames refused because of their length or MAC */
    uint32_t not_fresh;     /* number of authentic frames refused because they were not fresh */
} sw_verifier;

/* The state of the sender: the freshness of its next frames. */
typedef struct {
    uint32_t trip;  /* number of power cycles, including this one; at least 1 */
    uint32_t count; /* number of frames that were sent of each message in this power cycle; saturates */
} sw_freshness;

/* Prepares a key. Returns 0, or 1 for a key of zeros, as in an empty memory; the node then has no key. */
int sw_secoc_begin(sw_secoc *secoc, const uint8_t key[SW_AES_BYTES]);

/* Returns whether a frame of `bytes` bytes is an authentic message of `length` bytes; stores the frame's freshness. */
int sw_secoc_is_authentic(const sw_secoc *secoc, const uint8_t *data, uint32_t bytes, uint32_t length, uint16_t data_id,
                          uint64_t *freshness);

/* Returns whether a frame is authentic and fresher than the latest accepted frame; if so, stores its freshness. */
int sw_secoc_accepts(sw_verifier *verifier, const sw_secoc *secoc, const uint8_t *data, uint32_t bytes, uint32_t length,
                     uint16_t data_id);

/* Writes freshness and MAC after the protected part and its zeros; all parts together have `length` bytes. */
void sw_secoc_secure(const sw_secoc *secoc, uint8_t *data, uint32_t length, uint16_t data_id,
                     const sw_freshness *freshness);

void sw_freshness_next(sw_freshness *freshness);

#endif
