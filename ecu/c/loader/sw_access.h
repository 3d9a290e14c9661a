/* The security access (ISO 14229-1, service 0x27): seeds, keys, wrong attempts, and the delay after wrong attempts.
 * This file corresponds to can_bridge/uds/security.py.
 *
 * A seed is valid for one answer. An attempt is counted in the store before the answer is checked. A tester therefore
 * gains no further attempt by switching the ECU off during the check.
 */
#ifndef SW_ACCESS_H
#define SW_ACCESS_H

#include <stdint.h>

#include "sw_cmac.h"
#include "sw_ecu_settings.h"
#include "sw_store.h"
#include "sw_uds_settings.h"

#define SW_SEED_BYTES 16u   /* length of a seed */
#define SW_ANSWER_BYTES 16u /* length of the tester's answer to a seed */

/* Writes `count` unpredictable bytes to `bytes`. Returns 0, or 1 if the source fails. */
typedef int (*sw_random)(void *context, uint8_t *bytes, uint32_t count);

typedef struct {
    uint8_t unlocked; /* unlocked security level; 0 if none is unlocked */
    uint8_t asked;    /* level whose seed was sent and is not answered yet; 0 if none */
    uint8_t seed[SW_SEED_BYTES];
    uint8_t is_closed[SW_LEVELS]; /* whether a delay of each level has begun since power-on */
    int64_t closed_until_ns[SW_LEVELS];
} sw_access;

/* Restarts the delay of each level that had too many wrong attempts before power-on. */
void sw_access_power_on(sw_access *access, const sw_store *store, int64_t now_ns);

/* Locks every level. Called at the end of a session. */
void sw_access_lock(sw_access *access);

/* Writes a new seed, or zeros if the level is unlocked already. Returns 0 or the refusal's SW_NRC_ code. */
uint8_t sw_access_seed(sw_access *access, int64_t now_ns, uint8_t level, sw_random random, void *context,
                       uint8_t seed[SW_SEED_BYTES]);

#if SW_XCP
/* Computes the answer to a level's seed of `length` bytes. The ECU and the tool share the key. */
void sw_access_answer(uint8_t level, const uint8_t key[SW_AES_BYTES], const uint8_t *seed, uint32_t length,
                      uint8_t answer[SW_ANSWER_BYTES]);
#endif

/* Unlocks the level of the latest seed if the tester's answer is correct. Returns 0 or the refusal's SW_NRC_ code. */
uint8_t sw_access_unlock(sw_access *access, sw_store *store, int64_t now_ns, uint8_t level,
                         const uint8_t key[SW_AES_BYTES], const uint8_t answer[SW_ANSWER_BYTES]);

#endif
