/* Which image may run: the header as it lies in the flash, and key lists, of any bytes. Signatures are assumed: a good one
 * is what sw_signature_is_good says it is.
 */
#include "prove.h"

#ifdef WHOLE_BYTES
#include "sw_bytes.h"
#else
#include "bytes_model.h"
#endif
#include "sw_release.c"

#define KEYS_MOST 2u
#define LIST_MOST (LIST_KEYS + 2u * KEYS_MOST * KEY + SIGNATURE_BYTES)

static int is_genuine; /* the signature */
static int was_asked;

int sw_signature_is_good(const uint8_t signature[64], const uint8_t key[32], const uint8_t *data, uint32_t length)
{
    (void)(uint8_t)(signature[0] | signature[63] | key[0] | key[31] | data[0] | data[length - 1u]);
    was_asked = length >= SIGNATURE || data != NULL;
    return is_genuine;
}

int sw_key_is_weak(const uint8_t key[32]) { return (void)(key[0] | key[31]), nondet_int() != 0; }

/* GOOD is said of none that is unsigned, of another's key, older than the least version, or for another ECU. */
void any_image(void)
{
    uint8_t header[SW_HEADER_BYTES], payload[SHA256], keys[SW_KEY_LIST_BYTES];
    sw_rules rules;
    const uint32_t length = nondet_uint(), least = nondet_uint();
    is_genuine = nondet_int();
    ASSUME(keys[LIST_ALLOWED] <= KEYS_MOST && keys[LIST_REVOKED] <= KEYS_MOST);
    const sw_verdict verdict = sw_release_judge(header, length, payload, keys, &rules, least);
    if (verdict != SW_VERDICT_GOOD) return;
    PROVE(is_genuine && was_asked);
    PROVE(little_u32(&header[SECURITY_VERSION]) >= least);
    PROVE(little_u32(&header[LENGTH]) == length && length >= SW_HEADER_BYTES);
#ifdef WHOLE_BYTES
    PROVE(sw_key_is_allowed(keys, &header[SIGNER]));
    PROVE(sw_bytes_equal(&header[PAYLOAD], payload, SHA256));
    PROVE(sw_bytes_equal(&header[DBC], rules.dbc, SHA256) && sw_bytes_equal(&header[LAYOUT], rules.layout, SHA256));
#endif
    sw_release_facts facts;
    sw_release_read(header, &facts);
    PROVE(facts.name_length > 0u && facts.name_length <= SW_NAME_BYTES);
    PROVE(facts.security_version >= least);
}

/* At the end of its array, so that a byte too many is out of bounds. */
void any_key_list(void)
{
    uint8_t room[LIST_MOST], root[KEY];
    const uint32_t length = nondet_uint();
    is_genuine = nondet_int();
    ASSUME(length <= LIST_MOST);
    const uint8_t *list = &room[LIST_MOST - length];
    if (!sw_key_list_is_good(list, length, root)) return;
    PROVE(is_genuine && sw_key_list_version(list) > 0u);
    PROVE(list[LIST_ALLOWED] > 0u && list[LIST_ALLOWED] <= SW_MOST_KEYS && list[LIST_REVOKED] <= SW_MOST_KEYS);
    PROVE(length == LIST_KEYS + (list[LIST_ALLOWED] + list[LIST_REVOKED]) * KEY + SIGNATURE_BYTES);
}
