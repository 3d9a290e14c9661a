/* Which keys may sign releases (contract/release/key_list.py), and Ed25519 signatures. */
#ifndef SW_KEYS_H
#define SW_KEYS_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define SW_MOST_KEYS 16u
#define SW_KEY_LIST_BYTES (48u + 2u * SW_MOST_KEYS * 32u + 64u) /* of the longest list */

/* Whether a key is of small order: anyone can sign anything for it. */
int sw_key_is_weak(const uint8_t key[32]);

/* Whether a signature of these bytes is this key's; never by a key of small order. */
int sw_signature_is_good(const uint8_t signature[64], const uint8_t key[32], const uint8_t *data, uint32_t length);

/* Whether a list was signed by the root key and is in order. */
int sw_key_list_is_good(const uint8_t *data, uint32_t length, const uint8_t root[32]);

/* Of a list that is good, or of zeros, which stand for none: its version is 0, and no key is in it. */
uint32_t sw_key_list_version(const uint8_t *list);
int sw_key_is_allowed(const uint8_t *list, const uint8_t key[32]);
int sw_key_is_revoked(const uint8_t *list, const uint8_t key[32]);

#ifdef __cplusplus
}
#endif

#endif
