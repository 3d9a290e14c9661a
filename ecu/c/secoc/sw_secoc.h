/* Authenticated frames after AUTOSAR SecOC: what is not authentic or not fresh is refused before E2E looks at it. The twin
 * of can_bridge/secoc/securing.py, which draws the frame:
 *
 *     protected part | zeros | freshness, 8 bytes | MAC, 8 bytes
 */
#ifndef SW_SECOC_H
#define SW_SECOC_H

#include <stdint.h>

#include "sw_cmac.h"

#define SW_SECOC_LONGEST 64u /* bytes of a frame */

/* The bus' key in use. Without one nothing is authentic, and nothing may be sent. */
typedef struct {
    uint8_t is_given;
    sw_cmac_key cmac;
} sw_secoc;

/* What the receiver of one message must remember. Counts stop at their largest value. */
typedef struct {
    uint64_t freshness; /* of the latest accepted frame; 0 before the first */
    uint32_t not_authentic; /* frames refused because of length or MAC */
    uint32_t not_fresh;     /* authentic ones, repeated or recorded earlier */
} sw_verifier;

/* What the sender must remember: the freshness of its next frames. */
typedef struct {
    uint32_t trip;  /* power cycles, this one included; from 1 on */
    uint32_t count; /* frames of a message sent in this one; it stays at its largest value */
} sw_freshness;

/* Takes a key. Returns 0, or 1 for a key of zeros, which is an empty memory's; there is none then. */
int sw_secoc_begin(sw_secoc *secoc, const uint8_t key[SW_AES_BYTES]);

/* Whether a frame of `bytes` bytes is authentic as this message, which has `length`. Its freshness value, if it is. */
int sw_secoc_is_authentic(const sw_secoc *secoc, const uint8_t *data, uint32_t bytes, uint32_t length, uint16_t data_id,
                          uint64_t *freshness);

/* Whether it is accepted, which is remembered: authentic, and fresher than the latest one. */
int sw_secoc_accepts(sw_verifier *verifier, const sw_secoc *secoc, const uint8_t *data, uint32_t bytes, uint32_t length,
                     uint16_t data_id);

/* Writes freshness and MAC behind the protected part and the zeros that follow it, into `length` bytes in all. */
void sw_secoc_secure(const sw_secoc *secoc, uint8_t *data, uint32_t length, uint16_t data_id,
                     const sw_freshness *freshness);

void sw_freshness_next(sw_freshness *freshness);

#endif
