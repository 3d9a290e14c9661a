#include "sw_keys.h"

#include "sw_bytes.h"

#define MAGIC 8u
#define VERSION 8u
#define ALLOWED 12u
#define REVOKED 13u
#define RESERVED 14u
#define ROOT 16u
#define KEYS 48u
#define KEY 32u
#define SIGNATURE 64u

/* Whether keys ascend, so that none is there twice. */
static int ascend(const uint8_t *keys, uint32_t count)
{
    for (uint32_t i = 1; i < count; i++) {
        const uint8_t *key = &keys[i * KEY];
        uint32_t k = 0;
        while (k < KEY && key[k] == (key - KEY)[k]) k++;
        if (k == KEY || key[k] < (key - KEY)[k]) return 0;
    }
    return 1;
}

static int is_among(const uint8_t *keys, uint32_t count, const uint8_t *key)
{
    for (uint32_t i = 0; i < count; i++) {
        if (sw_bytes_equal(&keys[i * KEY], key, KEY)) return 1;
    }
    return 0;
}

static int are_in_order(const uint8_t *keys, uint32_t allowed, uint32_t revoked)
{
    const uint8_t *off = &keys[allowed * KEY];
    if (!ascend(keys, allowed) || !ascend(off, revoked)) return 0;
    for (uint32_t i = 0; i < allowed; i++) {
        if (sw_key_is_weak(&keys[i * KEY]) || is_among(off, revoked, &keys[i * KEY])) return 0;
    }
    return 1;
}

uint32_t sw_key_list_version(const uint8_t *list) { return sw_big_u32(&list[VERSION]); }

int sw_key_list_is_good(const uint8_t *data, uint32_t length, const uint8_t root[32])
{
    static const uint8_t magic[MAGIC] = {'S', 'W', 'K', 'E', 'Y', 'S', '0', '1'};
    if (length < KEYS + SIGNATURE || length > SW_KEY_LIST_BYTES || !sw_bytes_equal(data, magic, MAGIC)) return 0;
    if (!sw_bytes_equal(&data[ROOT], root, KEY)) return 0;
    if (!sw_signature_is_good(&data[length - SIGNATURE], root, data, length - SIGNATURE)) return 0;
    const uint32_t allowed = data[ALLOWED];
    const uint32_t revoked = data[REVOKED];
    if (sw_key_list_version(data) == 0u || allowed == 0u || allowed > SW_MOST_KEYS || revoked > SW_MOST_KEYS) return 0;
    if (data[RESERVED] != 0u || data[RESERVED + 1u] != 0u) return 0;
    if (length != KEYS + (allowed + revoked) * KEY + SIGNATURE) return 0;
    return are_in_order(&data[KEYS], allowed, revoked);
}

int sw_key_is_allowed(const uint8_t *list, const uint8_t key[32]) { return is_among(&list[KEYS], list[ALLOWED], key); }

int sw_key_is_revoked(const uint8_t *list, const uint8_t key[32])
{
    return is_among(&list[KEYS + KEY * list[ALLOWED]], list[REVOKED], key);
}
