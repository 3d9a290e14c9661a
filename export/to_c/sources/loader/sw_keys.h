/* Which keys may sign releases (contract/release/key_list.py), and Ed25519 signatures. */
#ifndef SW_KEYS_H
#define SW_KEYS_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define SW_MOST_KEYS 16u
#define SW_KEY_LIST_BYTES (48u + 2u * SW_MOST_KEYS * 32u + 64u) /* of the longest list */

typedef struct {
    uint32_t version; /* 0: this ECU has no list, and takes nothing */
    uint8_t allowed, revoked;
    uint8_t keys[2u * SW_MOST_KEYS][32]; /* those that may sign, then those that are revoked */
} sw_key_list;

/* Whether a key is of small order: anyone can sign anything for it. */
int sw_key_is_weak(const uint8_t key[32]);

/* Whether a signature of these bytes is this key's; never by a key of small order. */
int sw_signature_is_good(const uint8_t signature[64], const uint8_t key[32], const uint8_t *data, uint32_t length);

/* Whether a list was signed by the root key and is in order; `list` is written only then. */
int sw_key_list_decode(const uint8_t *data, uint32_t length, const uint8_t root[32], sw_key_list *list);

int sw_key_is_allowed(const sw_key_list *list, const uint8_t key[32]);
int sw_key_is_revoked(const sw_key_list *list, const uint8_t key[32]);

#ifdef __cplusplus
}
#endif

#endif
