/* Authenticated frames: any bytes, any state of the receiver. A MAC is any value, but the same for the same frame. */
#include "prove.h"

#include "sw_secoc.c"

static uint8_t mac[SW_AES_BYTES];

void sw_cmac(const sw_cmac_key *key, const uint8_t *message, uint32_t length, uint8_t to[SW_AES_BYTES])
{
    (void)key, (void)(uint8_t)(message[0] | message[length - 1u]);
    for (int i = 0; i < SW_AES_BYTES; i++) to[i] = mac[i];
}

void sw_cmac_prepare(sw_cmac_key *prepared, const uint8_t key[SW_AES_BYTES])
{
    prepared->whole[0] = (uint8_t)(key[0] | key[SW_AES_BYTES - 1]);
}

static void any_mac(void)
{
    uint8_t any[SW_AES_BYTES];
    for (int i = 0; i < SW_AES_BYTES; i++) mac[i] = any[i];
}

/* A frame that is taken has the right length and the right MAC, and is fresher than any before; so it is taken once. */
void any_frame(void)
{
    sw_secoc secoc;
    sw_verifier verifier;
    uint8_t data[SW_SECOC_LONGEST];
    const uint32_t bytes = nondet_uint();
    any_mac();
    ASSUME(bytes <= SW_SECOC_LONGEST);
    const sw_verifier before = verifier;
    const int accepted = sw_secoc_accepts(&verifier, &secoc, data, bytes, LENGTH, 1);
    if (!accepted) {
        PROVE(verifier.freshness == before.freshness);
        PROVE(verifier.not_authentic >= before.not_authentic && verifier.not_fresh >= before.not_fresh);
        return;
    }
    PROVE(secoc.is_given && bytes == LENGTH && verifier.freshness > before.freshness);
    for (uint32_t i = 0; i < MAC_BYTES; i++) PROVE(data[LENGTH - MAC_BYTES + i] == mac[i]);
    PROVE(!sw_secoc_accepts(&verifier, &secoc, data, bytes, LENGTH, 1));
    PROVE(verifier.not_fresh >= before.not_fresh);
}

/* What one node sends, another one with the same key takes, if it has heard nothing as fresh. */
void any_sent(void)
{
    sw_secoc secoc;
    sw_verifier verifier;
    sw_freshness freshness;
    uint8_t data[SW_SECOC_LONGEST];
    any_mac();
    ASSUME(secoc.is_given && verifier.freshness < ((uint64_t)freshness.trip << 32 | freshness.count));
    const uint32_t count = freshness.count;
    sw_secoc_secure(&secoc, data, LENGTH, 1, &freshness);
    PROVE(sw_secoc_accepts(&verifier, &secoc, data, LENGTH, LENGTH, 1));
    PROVE(verifier.freshness == ((uint64_t)freshness.trip << 32 | count));
    sw_freshness_next(&freshness);
    PROVE(freshness.count > count || count == UINT32_MAX);
}

void any_key(void)
{
    sw_secoc secoc;
    uint8_t key[SW_AES_BYTES];
    const int failed = sw_secoc_begin(&secoc, key);
    PROVE((failed == 0) == (secoc.is_given != 0u));
    if (key[0] != 0u || key[SW_AES_BYTES - 1] != 0u) PROVE(secoc.is_given);
}
