/* The unlocking of the calibration by XCP's seed and key, like XcpAccess in can_bridge/calibration/xcp.py. */
#ifndef SW_XCP_ACCESS_H
#define SW_XCP_ACCESS_H

#include <stdint.h>

#include "sw_access.h"
#include "sw_bytes.h"
#include "sw_ecu_settings.h"

#if SW_XCP

typedef struct {
    uint8_t is_unlocked;
    uint8_t has_seed;
    uint8_t unsent;    /* number of the seed's bytes that are not sent yet */
    uint8_t key_bytes; /* number of received bytes of the key */
    uint8_t seed[SW_XCP_SEED_LENGTH];
    uint8_t key[SW_ANSWER_BYTES];
} sw_xcp_access;

/* Locks the calibration, and discards the seed and a partly received key. */
void sw_xcp_access_lock(sw_xcp_access *access);

/* Answer GET_SEED and UNLOCK; the caller checks the commands' lengths. Return SW_XCP_DONE or an SW_XCP_ERROR_ code.
 * Every attempt needs a new seed. A wrong key is answered with ACCESS_LOCKED, and ends the connection.
 */
uint8_t sw_xcp_access_seed(sw_xcp_access *access, const uint8_t *data, sw_random random, void *context,
                           sw_answer *answer);
uint8_t sw_xcp_access_unlock(sw_xcp_access *access, const uint8_t *data, uint32_t length, const uint8_t *key);

#endif

#endif
