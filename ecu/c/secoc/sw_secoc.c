#include "sw_secoc.h"

#define ID_BYTES 2u
#define FRESHNESS_BYTES 8u
#define MAC_BYTES 8u

int sw_secoc_begin(sw_secoc *secoc, const uint8_t key[SW_AES_BYTES])
{
    uint32_t any = 0;
    for (int i = 0; i < SW_AES_BYTES; i++) any |= key[i];
    secoc->is_given = (uint8_t)(any != 0u);
    sw_cmac_prepare(&secoc->cmac, key);
    return any != 0u ? 0 : 1;
}

/* Computes the MAC of a frame of `length` bytes. The MAC covers all bytes before it, and the unsent data ID. */
static void mac_of(const sw_secoc *secoc, const uint8_t *data, uint32_t length, uint16_t data_id,
                   uint8_t mac[SW_AES_BYTES])
{
    uint8_t covered[ID_BYTES + SW_SECOC_LONGEST - MAC_BYTES];
    covered[0] = (uint8_t)((uint32_t)data_id >> 8);
    covered[1] = (uint8_t)(data_id & 0xffu);
    for (uint32_t i = 0; i < length - MAC_BYTES; i++) covered[ID_BYTES + i] = data[i];
    sw_cmac(&secoc->cmac, covered, ID_BYTES + length - MAC_BYTES, mac);
}

int sw_secoc_is_authentic(const sw_secoc *secoc, const uint8_t *data, uint32_t bytes, uint32_t length, uint16_t data_id,
                          uint64_t *freshness)
{
    const uint8_t *sent = &data[length - FRESHNESS_BYTES - MAC_BYTES];
    uint8_t mac[SW_AES_BYTES];
    uint32_t different = 0;
    if (!secoc->is_given || bytes != length) return 0;
    mac_of(secoc, data, length, data_id, mac);
    /* The time of the comparison must not depend on the number of equal bytes. */
    for (uint32_t i = 0; i < MAC_BYTES; i++) different |= (uint32_t)mac[i] ^ sent[FRESHNESS_BYTES + i];
    *freshness = 0;
    for (uint32_t i = 0; i < FRESHNESS_BYTES; i++) *freshness = *freshness << 8 | sent[i];
    return different == 0u;
}

static uint32_t one_more(uint32_t count) { return count < UINT32_MAX ? count + 1u : count; }

int sw_secoc_accepts(sw_verifier *verifier, const sw_secoc *secoc, const uint8_t *data, uint32_t bytes, uint32_t length,
                     uint16_t data_id)
{
    uint64_t freshness;
    if (!sw_secoc_is_authentic(secoc, data, bytes, length, data_id, &freshness)) {
        verifier->not_authentic = one_more(verifier->not_authentic);
        return 0;
    }
    if (freshness <= verifier->freshness) {
        verifier->not_fresh = one_more(verifier->not_fresh);
        return 0;
    }
    verifier->freshness = freshness;
    return 1;
}

void sw_secoc_secure(const sw_secoc *secoc, uint8_t *data, uint32_t length, uint16_t data_id,
                     const sw_freshness *freshness)
{
    uint8_t *sent = &data[length - FRESHNESS_BYTES - MAC_BYTES];
    uint8_t mac[SW_AES_BYTES];
    for (uint32_t i = 0; i < FRESHNESS_BYTES; i++) {
        const uint32_t half = i < FRESHNESS_BYTES / 2u ? freshness->trip : freshness->count;
        sent[i] = (uint8_t)(half >> (8u * (3u - i % 4u)) & 0xffu);
    }
    mac_of(secoc, data, length, data_id, mac);
    for (uint32_t i = 0; i < MAC_BYTES; i++) sent[FRESHNESS_BYTES + i] = mac[i];
}

void sw_freshness_next(sw_freshness *freshness) { freshness->count = one_more(freshness->count); }
