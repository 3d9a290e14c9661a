#include "sw_release.h"

#include "sw_bytes.h"
#include "sw_crypto.h"

#define KEY 32u
#define SIGNATURE_BYTES 64u

/* --- The key list --- */

#define LIST_MAGIC 8u
#define LIST_VERSION 8u
#define LIST_ALLOWED 12u
#define LIST_REVOKED 13u
#define LIST_RESERVED 14u
#define LIST_ROOT 16u
#define LIST_KEYS 48u

/* Returns whether the keys ascend, so that no key occurs twice. */
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

uint32_t sw_key_list_version(const uint8_t *list) { return sw_big_u32(&list[LIST_VERSION]); }

int sw_key_list_is_good(const uint8_t *data, uint32_t length, const uint8_t root[32])
{
    static const uint8_t magic[LIST_MAGIC] = {'S', 'W', 'K', 'E', 'Y', 'S', '0', '1'};
    if (length < LIST_KEYS + SIGNATURE_BYTES || length > SW_KEY_LIST_BYTES) return 0;
    if (!sw_bytes_equal(data, magic, LIST_MAGIC)) return 0;
    if (!sw_bytes_equal(&data[LIST_ROOT], root, KEY)) return 0;
    if (!sw_signature_is_good(&data[length - SIGNATURE_BYTES], root, data, length - SIGNATURE_BYTES)) return 0;
    const uint32_t allowed = data[LIST_ALLOWED];
    const uint32_t revoked = data[LIST_REVOKED];
    if (sw_key_list_version(data) == 0u || allowed == 0u || allowed > SW_MOST_KEYS || revoked > SW_MOST_KEYS) return 0;
    if (data[LIST_RESERVED] != 0u || data[LIST_RESERVED + 1u] != 0u) return 0;
    if (length != LIST_KEYS + (allowed + revoked) * KEY + SIGNATURE_BYTES) return 0;
    return are_in_order(&data[LIST_KEYS], allowed, revoked);
}

int sw_key_is_allowed(const uint8_t *list, const uint8_t key[32])
{
    return is_among(&list[LIST_KEYS], list[LIST_ALLOWED], key);
}

int sw_key_is_revoked(const uint8_t *list, const uint8_t key[32])
{
    return is_among(&list[LIST_KEYS + KEY * list[LIST_ALLOWED]], list[LIST_REVOKED], key);
}

/* --- The header of a release --- */

#define MAGIC 8u
#define LENGTH 8u
#define HEADER_LENGTH 12u
#define PAYLOAD 16u
#define LAYOUT 48u
#define DBC 80u
#define DIGEST 112u
#define SECURITY_VERSION 144u
#define PERIOD 148u
#define POINT 156u
#define VEHICLE_END 192u
#define HARDWARE 192u
#define NAME 256u
#define RESERVED 320u
#define SIGNER 416u
#define SIGNATURE 448u
#define SHA256 32u

static uint32_t little_u32(const uint8_t *data)
{
    return ((uint32_t)data[3] << 24) | ((uint32_t)data[2] << 16) | ((uint32_t)data[1] << 8) | (uint32_t)data[0];
}

static int all_zero(const uint8_t *data, uint32_t length)
{
    uint32_t found = 0;
    for (uint32_t i = 0; i < length; i++) found |= data[i];
    return found == 0u;
}

uint32_t sw_name_length(const uint8_t field[SW_NAME_BYTES])
{
    uint32_t length = 0;
    while (length < SW_NAME_BYTES && field[length] != 0u) {
        if (field[length] < 0x20u || field[length] > 0x7eu) return 0;
        length++;
    }
    return all_zero(&field[length], SW_NAME_BYTES - length) ? length : 0u;
}

static sw_verdict signer_verdict(const uint8_t *header, const uint8_t *keys)
{
    if (all_zero(&header[SIGNER], SW_HEADER_BYTES - SIGNER)) return SW_VERDICT_UNSIGNED;
    if (!sw_signature_is_good(&header[SIGNATURE], &header[SIGNER], header, SIGNATURE)) return SW_VERDICT_BAD_SIGNATURE;
    if (sw_key_is_allowed(keys, &header[SIGNER])) return SW_VERDICT_GOOD;
    return sw_key_is_revoked(keys, &header[SIGNER]) ? SW_VERDICT_REVOKED_KEY : SW_VERDICT_UNKNOWN_KEY;
}

static int content_is_in_order(const uint8_t *header, const uint8_t *payload_sha256)
{
    return sw_bytes_equal(&header[PAYLOAD], payload_sha256, SHA256) && all_zero(&header[RESERVED], SIGNER - RESERVED)
           && (header[HARDWARE] == 0u ? all_zero(&header[HARDWARE], SW_NAME_BYTES)
                                      : sw_name_length(&header[HARDWARE]) > 0u)
           && sw_name_length(&header[NAME]) > 0u;
}

static sw_verdict fit_verdict(const uint8_t *header, const sw_rules *rules, uint32_t least_security_version)
{
    if (!sw_bytes_equal(&header[DBC], rules->dbc, SHA256)) return SW_VERDICT_WRONG_DBC;
    if (!sw_bytes_equal(&header[LAYOUT], rules->layout, SHA256)) return SW_VERDICT_WRONG_BUILD;
    if (header[HARDWARE] != 0u && !sw_bytes_equal(&header[HARDWARE], rules->hardware, SW_NAME_BYTES)) {
        return SW_VERDICT_WRONG_HARDWARE;
    }
    if (!sw_bytes_equal(&header[PERIOD], rules->vehicle, POINT - PERIOD)) return SW_VERDICT_WRONG_PERIOD;
    if (!sw_bytes_equal(&header[POINT], &rules->vehicle[POINT - PERIOD], VEHICLE_END - POINT)) {
        return SW_VERDICT_WRONG_VEHICLE;
    }
    return little_u32(&header[SECURITY_VERSION]) < least_security_version ? SW_VERDICT_TOO_OLD : SW_VERDICT_GOOD;
}

sw_verdict sw_release_judge(const uint8_t header[SW_HEADER_BYTES], uint32_t length, const uint8_t payload_sha256[32],
                            const uint8_t *keys, const sw_rules *rules, uint32_t least_security_version)
{
    static const uint8_t magic[MAGIC] = {'S', 'W', 'C', 'T', 'R', 'L', '0', '1'};
    if (length < SW_HEADER_BYTES || !sw_bytes_equal(header, magic, MAGIC) || little_u32(&header[LENGTH]) != length
        || little_u32(&header[HEADER_LENGTH]) != SW_HEADER_BYTES) {
        return SW_VERDICT_DAMAGED;
    }
    const sw_verdict verdict = signer_verdict(header, keys);
    if (verdict != SW_VERDICT_GOOD) return verdict;
    if (!content_is_in_order(header, payload_sha256)) return SW_VERDICT_DAMAGED;
    return fit_verdict(header, rules, least_security_version);
}

void sw_release_read(const uint8_t header[SW_HEADER_BYTES], sw_release_facts *facts)
{
    facts->security_version = little_u32(&header[SECURITY_VERSION]);
    sw_bytes_copy(facts->digest, &header[DIGEST], SHA256);
    facts->name_length = (uint8_t)sw_name_length(&header[NAME]);
    sw_bytes_copy(facts->name, &header[NAME], SW_NAME_BYTES);
    sw_bytes_copy(facts->signer, &header[SIGNER], 32);
}
